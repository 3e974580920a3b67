"""A person whom all cameras see from behind is not taken for one seen from the front."""

from __future__ import annotations

import numpy as np
from one_frame import fit_observation
from random_scenes import perfect_masks
from synthetic import ring_rig
from walk_scene import walking

from mmocap_warp.body.model import Subject
from mmocap_warp.body.posing import Poser
from mmocap_warp.body.shape_space import heading_rotation, upright_base
from mmocap_warp.fitting.subject_fit import FitConfig
from mmocap_warp.formats.usd.usd_body import read_body
from mmocap_warp.masks.observation import Observation
from mmocap_warp.scenes import ROOT


def left(subject: Subject) -> np.ndarray:
    """Where the left hip is, seen from the right one: a unit vector (3,)."""
    skeleton = subject.body.skeleton
    joints = Poser(subject.body, subject.root_base).joint_transforms(subject.pose)[0, :, :3, 3]
    across = joints[skeleton.index("LHip")] - joints[skeleton.index("RHip")]
    return across / np.linalg.norm(across)


def test_a_person_seen_from_behind_is_not_taken_for_one_seen_from_the_front(monkeypatch):
    monkeypatch.setattr("mmocap_warp.fitting.subject_fit._ROUNDS", 1)  # over the limbs, which matter less here
    man = read_body(ROOT / "bodies" / "adult_man.usdc")
    ring = ring_rig(cameras=8, size=(160, 120))
    rig = ring.select(ring.names[:2])
    pose = walking().poses[25].copy()
    pose[:6] = 0.0, 0.95, 0.0, 0.0, 0.0, 0.0
    true = Subject(man, upright_base(rig.up) @ heading_rotation(np.pi + 0.5), pose, {})
    assert (rig.R[:, 2] @ true.root_base[:, 2] > 0.7).all()  # his face is turned away from both cameras
    observation = Observation.from_masks(list(perfect_masks(true, rig, pose)))
    found = fit_observation(man, rig, observation, FitConfig(headings=4, finalists=2, evaluations=300, device="cpu"))
    assert left(found) @ left(true) > 0.8
