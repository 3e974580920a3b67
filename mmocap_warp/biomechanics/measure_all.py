"""All measures of a result, run by run."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mmocap_warp.biomechanics.joint_angles import by_joint, held_angles, joint_angles, joints_left_out, own_angles
from mmocap_warp.biomechanics.segments import Sex, centre_of_mass, skin_place
from mmocap_warp.biomechanics.steps import Foot, Walking, feet_of, feet_on_floor, walking
from mmocap_warp.body.joint_sets import JointSet
from mmocap_warp.body.model import BodyModel, Subject
from mmocap_warp.body.posing import Poser
from mmocap_warp.errors import UsageError
from mmocap_warp.result.excerpt import before_smoothing
from mmocap_warp.result.result import Result


class Length(NamedTuple):
    """The length of a bone [m]; its standard deviation is NaN where the body's fit does not give it."""

    length: float
    sigma: float


def bone_lengths(subject: Subject, joint_set: JointSet | None = None) -> dict[str, Length]:
    """From each joint's centre to that of the joint above it, named after both, such as ``LHip to LKnee``.

    The points of a set stand for the joints that they are other definitions of.
    """
    skeleton = subject.body.skeleton
    place = (subject.body if joint_set is None else joint_set.centred(subject.body)).joint_rest.astype(float)
    # Standard deviations by a bone's lower joint. A fit names both sides: `body.bone.LKnee+RKnee.sigma`.
    start, end = "body.bone.", ".sigma"
    sigma = {
        joint: float(value)
        for name, value in subject.provenance.items()
        if name.startswith(start) and name.endswith(end)
        for joint in name.removeprefix(start).removesuffix(end).split("+")
    }
    lengths = {}
    for parent, number in skeleton.bones:
        joint = skeleton.joints[number]
        if joint not in skeleton.attached:
            length = float(np.linalg.norm(place[number] - place[parent]))
            lengths[f"{skeleton.joints[parent]} to {joint}"] = Length(length, sigma.get(joint, np.nan))
    return lengths


@dataclass(frozen=True)
class RunMeasures:
    """The measures of one run."""

    run: int  # its number
    joints: np.ndarray  # (frame, joint, 3), joint centres in the world [m]
    # (frame, joint, 3), their standard deviations along the world's axes [m]; None where they are not known.
    joint_sigma: np.ndarray | None
    # By joint and name, (frame,) each [degrees]; of a body that is no person, by axis of the joint's frame.
    angles: dict[str, dict[str, np.ndarray]]
    # By joint that slides and axis of its frame, (frame,) each, from the bind pose [m].
    shifts: dict[str, dict[str, np.ndarray]]
    feet: dict[str, Foot]  # by side; of a body that is no person, by joint
    walking: Walking  # steps and strides
    centre_of_mass: np.ndarray | None  # (frame, 3) in the world [m]; None where the body lacks joints of a person


@dataclass(frozen=True)
class Measures:
    """What was measured of a result."""

    result: Result  #: of which
    raw: bool  #: whether it was the track before it was smoothed
    sex: Sex | None  #: whose shares of mass were taken; None for the mean of both
    runs: tuple[RunMeasures, ...]  #: that were measured
    left_out: tuple[str, ...]  #: what the body has no joints for
    held: tuple[str, ...] = ()  #: a person's angles that the model does not search, such as ``LElbow pronation``
    files: tuple[Path, ...] = ()  #: the tables and plots that were written
    #: whose points the table of joints, the lengths and the long axes of limbs have; None for the body's own joints
    joint_set: JointSet | None = None

    @property
    def seconds(self) -> np.ndarray:
        """(frame,), from the recording's frame 0 on."""
        return self.result.frame_numbers / self.result.fps

    @cached_property
    def shown(self) -> RunMeasures:
        """The best of the runs that were measured."""
        return {run.run: run for run in self.runs}.get(self.result.best_run, self.runs[0])

    @cached_property
    def lengths(self) -> dict[str, Length]:
        """Lengths of the bones from joint centre to joint centre, named after both."""
        return bone_lengths(self.result.subject, self.joint_set)


def measure(
    result: Result, run: int | None = None, raw: bool = False, sex: Sex | None = None, joint_set: JointSet | None = None
) -> Measures:
    """Joint angles, contacts, steps and centre of mass of every frame, of all runs unless one is named.

    ``sex`` says whose shares of mass the segments have, None the mean of both; ``joint_set`` whose centres the table of
    joints, the lengths and the angles go by, None the body's own joints. Raises a ValueError for no such run (a
    UsageError), or no track before it was smoothed.
    """
    if run is not None and not 0 <= run < len(result.pose):
        raise UsageError(f"--run must be 0 to {len(result.pose) - 1}, got {run}")
    track = before_smoothing(result) if raw else result
    chosen = range(len(track.pose)) if run is None else [run]
    held = _angles_not_searched(track, track.pose[chosen[0], 0])
    centred = result.subject.body if joint_set is None else joint_set.centred(result.subject.body)
    measured = tuple(_measure_run(track, number, sex, held, centred) for number in chosen)
    body, first = result.subject.body, measured[0]
    left_out = [f"angles of {joint}" for joint in joints_left_out(body)]
    left_out += [f"contacts of the {name} foot" for name in feet_of(body) if name not in first.feet]
    left_out += ["centre of mass"] if first.centre_of_mass is None else []
    names = tuple(f"{joint} {name}" for joint, name in held)
    return Measures(result, raw, sex, measured, tuple(left_out), names, joint_set=joint_set)


def _measure_run(
    result: Result, run: int, sex: Sex | None, held: list[tuple[str, str]], centred: BodyModel
) -> RunMeasures:
    subject, body, pose = result.subject, result.subject.body, result.pose[run]
    transforms = Poser(body, subject.root_base).joint_transforms(pose)
    joints = transforms[:, :, :3, 3].astype(float)
    seconds, up = result.frame_numbers / result.fps, result.cameras.up_vector
    feet = feet_on_floor(subject, pose, seconds, up)
    # The heel is a person's rearmost skin of the foot; of a paw or a shank without a foot, the lowest strikes first.
    heel = {
        name: skin_place(body, transforms, joint, (0.0, 0.0, -1.0) if name in ("left", "right") else (0.0, -1.0, 0.0))
        for name, joint in feet_of(body).items()
        if name in feet
    }
    angles = {
        joint: {name: angle for name, angle in own.items() if (joint, name) not in held}
        for joint, own in joint_angles(centred, transforms).items()
    }
    angles = {joint: own for joint, own in angles.items() if own}
    return RunMeasures(
        run=run,
        joints=joints,
        joint_sigma=None if result.joint_sigma is None else result.joint_sigma[run],
        angles=angles or own_angles(body.skeleton, pose, result.config.get("dof")),
        shifts=by_joint(body.skeleton, body.skeleton.searched_shifts(result.config.get("dof")), pose),
        feet=feet,
        walking=walking(feet, heel, joints[:, 0], seconds, up),
        centre_of_mass=centre_of_mass(body, transforms, sex),
    )


def _angles_not_searched(result: Result, pose: np.ndarray) -> list[tuple[str, str]]:
    """A person's joint angles, by joint and name, that the model holds still: they would tell only the bind pose."""
    body, model = result.subject.body, result.config.get("dof")
    if model is None:
        return []
    searched = body.skeleton.searched_angles(model)
    turned = np.repeat(pose[None], len(searched) + 1, axis=0)
    turned[np.arange(len(searched)), searched] += np.radians(1.0)  # the last pose stays as it is
    return held_angles(joint_angles(body, Poser(body, result.subject.root_base).joint_transforms(turned)))
