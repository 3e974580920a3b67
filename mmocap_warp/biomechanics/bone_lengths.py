"""Lengths of a subject's bones, for any skeleton."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mmocap_warp.body.model import Subject


class Length(NamedTuple):
    """Of a bone [m]; its standard deviation is NaN where the body's fit does not tell."""

    length: float
    sigma: float


def bone_lengths(subject: Subject) -> dict[str, Length]:
    """From each joint's centre to that of the joint above it, named after both, such as ``LHip to LKnee``."""
    skeleton, place = subject.body.skeleton, subject.body.joint_rest.astype(float)
    sigma = _told_sigma(subject)
    lengths = {}
    for parent, number in skeleton.bones:
        joint = skeleton.joints[number]
        if joint not in skeleton.attached:
            length = float(np.linalg.norm(place[number] - place[parent]))
            lengths[f"{skeleton.joints[parent]} to {joint}"] = Length(length, sigma.get(joint, np.nan))
    return lengths


def _told_sigma(subject: Subject) -> dict[str, float]:
    """By the joint at a bone's lower end. A fit names left and right together: ``body.bone.LKnee+RKnee.sigma``."""
    start, end = "body.bone.", ".sigma"
    return {
        joint: float(value)
        for name, value in subject.provenance.items()
        if name.startswith(start) and name.endswith(end)
        for joint in name.removeprefix(start).removesuffix(end).split("+")
    }
