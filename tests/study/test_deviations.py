"""Factors of standard deviations: found where there are some, one where there are none, judged on others."""

from __future__ import annotations

import numpy as np
import pytest
from deviations import Stated, as_factors, cross_judged, learnt, stated, summary, table
from made_people import made_clip, made_person

from mmocap_warp.rigging.shipped import DEFAULT_BODY, load_body
from mmocap_warp.study.sequences import CLIPS

BODY = load_body(DEFAULT_BODY)
JOINTS = BODY.skeleton.joints
QUANTITIES = 3 * len(JOINTS) + len(BODY.skeleton.searched()) - 3


def people(count: int, too_wide: np.ndarray, seed: int = 0) -> list[Stated]:
    """Errors of normal distribution, said to be ``too_wide`` (quantity,) times as large."""
    rng = np.random.default_rng(seed)
    sigma = rng.uniform(0.5, 2.0, (count, 1, QUANTITIES))
    error = sigma * rng.standard_normal((count, 5, QUANTITIES))
    return [Stated(each, np.tile(width * too_wide, (5, 1))) for each, width in zip(error, sigma, strict=True)]


def test_factors_make_deviations_right_on_people_they_were_not_learnt_on():
    left, right, alone = (3 * JOINTS.index(name) for name in ("LKnee", "RKnee", "Neck"))
    too_wide = np.ones(QUANTITIES)
    too_wide[[left, right]], too_wide[alone] = 0.5, 2.5
    each = people(300, too_wide)
    everybody = each[0].followed_by(*each[1:])
    factor = learnt(everybody, BODY)
    assert factor[left] == factor[right] == pytest.approx(2.0, rel=0.08)
    assert factor[alone] == pytest.approx(1 / 2.5, rel=0.15)
    assert (np.abs(np.delete(factor, [left, right, alone]) - 1) < 0.12).all()  # what is right is left
    assert everybody.as_asked.sum() == QUANTITIES - 3
    judged = cross_judged(each, BODY)
    assert judged.error.shape == everybody.error.shape
    assert judged.as_asked.all()
    assert f"{QUANTITIES} of {QUANTITIES} as asked" in summary(judged, BODY)
    assert "**" not in table(judged, BODY)
    assert table(everybody, BODY).count("**") == 6
    found = as_factors(factor, BODY)
    assert found.joint[JOINTS.index("LKnee"), 0] == factor[left]
    assert found.angle.shape == (len(JOINTS), 3)


def test_people_are_the_same_whenever_they_are_made():
    assert made_person(4) == made_person(4)
    assert made_person(4).base == "adult_woman"
    assert len({made_person(number).stretch for number in range(6)}) == 6


@pytest.mark.nightly
def test_a_person_is_followed_near_to_the_truth_and_that_is_what_is_stated():
    person = stated(made_clip(0), 0, BODY)
    assert person.error.shape == person.sigma.shape == (5, QUANTITIES)
    assert np.abs(person.error[:, : 3 * len(JOINTS)]).mean() < 0.01
    assert (person.sigma > 0).all()
    assert (np.abs(person.error) <= 2 * person.sigma).mean() > 0.8


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["Uneven/Walking", "Skirt/Walking"])
def test_what_is_stated_of_people_outside_the_family_holds(name: str) -> None:
    person, joints = stated(CLIPS[name], 0, BODY), slice(3 * len(JOINTS))
    assert (np.abs(person.error) <= 2 * person.sigma)[:, joints].mean() > 0.9
