"""What the shipped robots do: ANYmal trots, and Panda picks something up and puts it down elsewhere."""

from __future__ import annotations

from mmocap_warp.body.body_motion import BodyMotion
from mmocap_warp.body.model import BodyModel
from mmocap_warp.synthesis.motion.key_poses import through_poses
from mmocap_warp.synthesis.motion.trot import Leg, Trot

ANYMAL = Trot(
    legs=(
        Leg("LF_HFE", "LF_KFE", bend=-1, phase=0.0),
        Leg("RF_HFE", "RF_KFE", bend=-1, phase=0.5),
        Leg("LH_HFE", "LH_KFE", bend=1, phase=0.5),
        Leg("RH_HFE", "RH_KFE", bend=1, phase=0.0),
    ),
    lowered=0.1,
    stride=0.4,
    rate=1.4,
    lift=0.1,
    bounce=0.01,
)


def anymal_motions(robot: BodyModel) -> dict[str, BodyMotion]:
    """``Trot``, 1.5 seconds at 0.56 m/s.

    Raises:
        ValueError: a body without ANYmal's joints.
    """
    return {"Trot": ANYMAL.motion(robot, 1.5, 60.0)}


def panda_motions(robot: BodyModel) -> dict[str, BodyMotion]:
    """``Pick``: it reaches down, lifts, turns, and puts down, in three seconds.

    Raises:
        ValueError: a body without Panda's joints.
    """

    def arm(*degrees: float) -> dict[str, float]:
        return {f"panda_joint{number}.Rx": angle for number, angle in enumerate(degrees, 1)}

    keys = (
        (0.0, arm(0, -30, 0, -130, 0, 100, 45)),
        (0.8, arm(35, 32, -5, -105, 5, 138, 80)),
        (1.3, arm(35, 5, -5, -105, 5, 112, 80)),
        (2.1, arm(-45, 10, 15, -100, -20, 115, 0)),
        (2.6, arm(-45, 38, 15, -92, -20, 130, 0)),
        (3.0, arm(-45, 15, 15, -100, -20, 115, 0)),
    )
    return {"Pick": through_poses(robot.skeleton, keys, 30.0)}
