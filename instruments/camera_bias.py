"""How far cameras end from the truth where everything begins at the truth, and whether that is as far as is stated.

``python instruments/camera_bias.py SEQUENCE...`` solves cameras, body and poses of twenty frames of made
sequences, from sound cameras and true poses with the generic body. What is off then is what faulty masks and another
body do. Around that answer the cost is quadratic, so it is known where each kind of parameter would end alone: of one
camera, and of all but the first, with one distance between cameras given. That takes ten seconds of one core each.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mmocap_warp.body.rest_space import RestSpace
from mmocap_warp.calibration.adjust.adjustment import FROM_FAR
from mmocap_warp.calibration.adjust.camera_changes import OFFSET, POSITION, ROTATION, Deviations
from mmocap_warp.calibration.adjust.camera_problem import CameraProblem, known_distance
from mmocap_warp.calibration.adjust.footage import Motion
from mmocap_warp.calibration.camera_check import CAUSES
from mmocap_warp.calibration.refine.refinement import STATED
from mmocap_warp.contour.frame.rooted import Rooting
from mmocap_warp.fitting.frame_fit import PRIOR
from mmocap_warp.rigging.shipped import load_body
from mmocap_warp.study.sequences import FPS, PLANS, SEQUENCES, StudySequence
from mmocap_warp.synthesis.walkers import PEOPLE

_FRAMES = 20
_DISTANCE = (0, 5)  # two cameras that stand opposite each other
_KINDS = ("rotation", "position", "focal length", "principal point", "time offset")  # the table's columns
_UNITS = (180 / np.pi, 1000.0, 100.0, 1.0, FPS)


@dataclass(frozen=True, eq=False)
class Bias:
    """Sound cameras after they were solved for.

    Attributes:
        change: (camera, parameter) what they were changed by.
        free: (camera, parameter) bool: what was solved for.
        information: (free parameter, free parameter) of one frame, with body and poses unknown.
    """

    change: np.ndarray
    free: np.ndarray
    information: np.ndarray

    def alone(self, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where parameters (camera, parameter) bool would end if all others were held, and their stated sigma."""
        at = np.flatnonzero(wanted[self.free])
        own = np.linalg.inv(self.information[np.ix_(at, at)])
        return own @ (self.information @ self.change[self.free])[at], STATED * np.sqrt(np.diag(own))


def solved(sequence: StudySequence, person: str) -> Bias:
    """Solve the cameras of a sequence of one of ``PEOPLE``."""
    space, rig = RestSpace(load_body(PEOPLE[person].base)), sequence.rig
    skeleton, frames = space.body.skeleton, np.linspace(0, sequence.frame_count - 1, _FRAMES).round().astype(int)
    rooting = Rooting(skeleton, sequence.subject.root_base, skeleton.searched())
    motion = Motion(rooting, rooting.enter(sequence.recording.poses), sequence.fps)
    observations = [sequence.observation(int(frame)) for frame in frames]
    sigma = Deviations().of(rig)
    sigma[0, [*range(6), OFFSET]] = 0.0
    one, other = _DISTANCE
    known = known_distance(rig, one, other, float(np.linalg.norm(rig.centres[one] - rig.centres[other])))
    problem = CameraProblem(rig, np.zeros(len(rig)), space, rooting, PRIOR, sigma, (known,))
    generic, none = np.zeros(len(space.names)), np.zeros(sigma.shape)
    solution = problem.solved(
        observations, motion.rooted[frames], motion.velocity(frames), generic, none, FROM_FAR, "cpu", 1
    )
    return Bias(solution.change, solution.free, np.linalg.inv(solution.covariance))


def cells(bias: Bias) -> tuple[list[str], np.ndarray]:
    """Of each kind the worst camera alone, and of all but the first together; and errors over stated sigma."""
    told, ratios = [], []
    for columns, unit in zip((CAUSES[kind] for kind in _KINDS), _UNITS, strict=True):
        worst, groups = [], [[k] for k in range(1, len(bias.change))]
        for cameras in (*groups, list(range(1, len(bias.change)))):
            wanted = np.zeros(bias.free.shape, bool)
            wanted[cameras, columns] = True
            off, sigma = bias.alone(wanted)
            worst.append(np.linalg.norm(off.reshape(len(cameras), -1), axis=1).max() * unit)
            ratios.append(off / sigma)
        digits = 1 if columns == POSITION else 3 if columns == ROTATION else 2
        told.append(f"{max(worst[:-1]):.{digits}f}, {worst[-1]:.{digits}f}")
    return told, np.concatenate(ratios)


def _main(names: Sequence[str]) -> None:
    print("| sequence | rotation [°] | position [mm] | focal [%] | centre [px] | time [frames] | in 2 sigma |")
    print("|---|---|---|---|---|---|---|")
    every = []
    for name in names:
        told, ratio = cells(solved(SEQUENCES[name], PLANS[name].person))
        every.append(ratio)
        print(f"| {' | '.join((name, *told))} | {(np.abs(ratio) <= 2).mean():.0%} |", flush=True)
    together = np.concatenate(every)
    print(f"\n{(np.abs(together) <= 2).mean():.1%} of {together.size} parameters are within 2 sigma")


if __name__ == "__main__":
    if len(sys.argv) < 2 or not set(sys.argv[1:]) <= set(PLANS):
        raise SystemExit(f"usage: python instruments/camera_bias.py SEQUENCE...; one of {', '.join(PLANS)}")
    _main(sys.argv[1:])
