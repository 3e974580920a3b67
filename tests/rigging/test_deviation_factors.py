"""Factors of stated standard deviations: of the bodies that they were learnt for, and of no other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from deviations import factors_toml
from other_bodies import quadruped

from mmocap_warp.body.mirroring import mirrored_joints
from mmocap_warp.body.rest_space import RestSpace
from mmocap_warp.rigging import shipped as module
from mmocap_warp.rigging.shipped import DEFAULT_BODY, DeviationFactors, deviation_factors, load_body


@pytest.fixture(scope="module")
def man():
    return load_body(DEFAULT_BODY)


def test_the_default_body_has_factors_that_are_the_same_on_both_sides(man):
    factors = deviation_factors(man)
    assert factors is not None
    for values in (factors.joint, factors.angle):
        assert values.shape == (len(man.skeleton.joints), 3)
        assert ((values > 0.3) & (values < 3.0)).all()
        for group in mirrored_joints(man).values():
            assert (values[list(group)] == values[group[0]]).all()
    held = np.setdiff1d(np.arange(man.skeleton.coordinates), man.skeleton.searched())
    assert (factors.coordinate[held] == 1.0).all()
    assert (factors.coordinate[:3] == 1.0).all()


def test_a_body_that_is_fitted_from_it_has_the_same(man):
    fitted = RestSpace(man).model(np.full(len(RestSpace(man).names), 0.01))
    np.testing.assert_array_equal(deviation_factors(fitted).joint, deviation_factors(man).joint)


def test_factors_say_less_of_a_body_that_departs_further_than_those_they_were_learnt_on(man):
    usual, learnt, far = (deviation_factors(man, departure) for departure in (1.0, 2.0, 4.0))
    np.testing.assert_array_equal(learnt.joint, usual.joint)
    np.testing.assert_allclose(far.joint, np.sqrt(usual.joint))
    np.testing.assert_allclose(far.angle, np.sqrt(usual.angle))


def test_other_bodies_have_none(man):
    assert deviation_factors(quadruped()) is None
    assert deviation_factors(replace(quadruped(), name=man.name)) is None


def test_what_is_written_is_read(man, tmp_path, monkeypatch):
    rng = np.random.default_rng(0)
    factors = DeviationFactors(*rng.uniform(0.5, 2.0, (2, len(man.skeleton.joints), 3)).round(2))
    (tmp_path / "bodies").mkdir()
    text = factors_toml(man.skeleton, factors, "made here")
    (tmp_path / "bodies" / f"{man.name}.deviations.toml").write_text(text, encoding="utf-8")
    monkeypatch.setattr(module, "ROOT", tmp_path)
    found = deviation_factors(man)
    np.testing.assert_array_equal(found.joint, factors.joint)
    np.testing.assert_array_equal(found.angle, factors.angle)
    assert text.startswith("# made here\n")
