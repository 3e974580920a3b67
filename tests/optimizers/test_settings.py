"""The optimizers' settings: what they are unless told, and that the last value allowed is allowed."""

from __future__ import annotations

from dataclasses import astuple

import pytest

from mmocap_warp.optimizers.annealed_filter import AnnealedFilterConfig
from mmocap_warp.optimizers.cma_es import CmaEsConfig
from mmocap_warp.optimizers.de import DeConfig
from mmocap_warp.optimizers.pso import PsoConfig


@pytest.mark.parametrize(
    ("settings", "values"),
    [
        (CmaEsConfig, (None, 1.0)),
        (DeConfig, (10, 5, 5, 5, 0.9, 0.5, True)),
        (PsoConfig, (10, 2.0, 2.0, 2.0, 0.1, 0.5)),
        (AnnealedFilterConfig, (10, 0.5, 0.5, True)),
    ],
)
def test_defaults_are_those_of_tables_2_and_3(settings, values):
    """In the order of the fields; the start, of which the tables say nothing, is one of DE's first members."""
    assert astuple(settings()) == values


@pytest.mark.parametrize(
    ("settings", "values"),
    [
        (CmaEsConfig, {"population": 2}),
        (DeConfig, {"population": 2, "placing": 1, "leading": 2, "correcting": 1, "crossover": 0.0, "factor": 2.0}),
        (DeConfig, {"crossover": 1.0}),
        (PsoConfig, {"population": 1, "phi_1": 0.0, "phi_2": 0.0, "inertia_max": 0.3, "inertia_min": 0.3}),
        (AnnealedFilterConfig, {"layers": 1, "survival": 1.0, "diffusion": 0.0}),
    ],
)
def test_the_last_value_that_is_allowed_is(settings, values):
    made = settings(**values)
    assert {name: getattr(made, name) for name in values} == values
