"""What ``mm.track`` hands on to the fit before it."""

from __future__ import annotations

from dataclasses import replace

import pytest

import mmocap_warp as mm
from mmocap_warp.commands import track
from mmocap_warp.scenes import ROOT


class Fitted(Exception):
    """Ends a run where its fit would begin."""


@pytest.mark.parametrize(("given", "used"), [({}, 4), ({"seed": 7}, 7), ({"config": mm.TrackConfig(seed=9)}, 9)])
def test_a_seed_that_is_given_is_the_fits_too(given, used, monkeypatch):
    """Otherwise the scene's own of its [fit] table holds."""

    def fit_subject(scene, body, config, *_rest):
        raise Fitted(config.seed)

    monkeypatch.setattr(track, "fit_subject", fit_subject)
    scene = replace(mm.load_scene(ROOT / "walk", "0:2"), subject=None, fit={"seed": 4})
    with pytest.raises(Fitted, match=f"^{used}$"):
        mm.track(scene, **given)
