"""People at random, made as those of the nine sequences are: many, where three say too little."""

from __future__ import annotations

import numpy as np
from made_walks import walking_around
from sequence_motions import ACTIONS

from mmocap_warp.rigging.shipped import load_body
from mmocap_warp.study.sequences import SequencePlan, StudySequence, make_sequence
from mmocap_warp.synthesis.walkers import Person

_BODIES = ("adult_man", "adult_woman", "tall_slim_adult")
_SHAPED = 0.6  # the share of shape targets that a person has anything of
_MOST = 0.4  # of a shape target
_STRETCH, _MOST_STRETCH = 0.022, 0.05  # of each axis: as the three and the walker are stretched
_FRAMES = 210


def made_person(number: int) -> Person:
    """A shipped body with some of its shape targets to either side, stretched unequally."""
    rng = np.random.default_rng([number, 77])
    base = _BODIES[number % len(_BODIES)]
    known = load_body(base).shape_names
    stems = sorted({name.rsplit("_", 1)[0] for name in known if name.endswith("_incr")} - {"height", "age"})
    shape = {}
    for stem in stems:
        if rng.random() < _SHAPED:
            name = stem + ("_incr" if rng.random() < 0.5 else "_decr")
            if name in known:
                shape[name] = round(float(rng.uniform(0.05, _MOST)), 3)
    stretch = 1 + np.clip(rng.normal(0, _STRETCH, 3), -_MOST_STRETCH, _MOST_STRETCH)
    across, up, forward = np.round(stretch, 4).tolist()
    return Person(f"P{number}", base, shape, (across, up, forward), {}, 1.0)


def made_clip(number: int) -> StudySequence:
    """Such a person who walks, gestures or boxes before the study's cameras for three and a half seconds."""
    person = made_person(number)
    rng = np.random.default_rng([number, 78])
    actor = ("S1", "S2", "S3")[rng.integers(3)]
    walk = walking_around(rng.uniform(0.95, 1.2), rng.uniform(1, 1.25), rng.uniform(104, 118))
    motion = (walk, ACTIONS[f"{actor}/Gestures"], ACTIONS[f"{actor}/Box"])[(number // 3) % 3]
    plan = SequencePlan(person.name, _FRAMES, motion, float(rng.uniform(-3, 3)), 1000 + number)
    return make_sequence(person.name, plan, person)
