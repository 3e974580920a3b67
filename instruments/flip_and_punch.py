"""Scenes of somebody who turns a back flip, then punches fast: ``python instruments/flip_and_punch.py FOLDER``.

In ``open`` the arms reach for the knees while the body is in the air. In ``pressed`` the forearms are folded before the
chest from the take-off until the punch, where no outline shows them. Seven cameras, 60 frames a second, faulty masks,
the true body. ``python instruments/ablate.py RESULTS --clip FOLDER/pressed/scene.toml`` tracks them.
"""

from __future__ import annotations

import sys
from pathlib import Path

from least_jerk import through_poses

from mmocap_warp.body.model import BodyMotion
from mmocap_warp.formats.usd.usd_body import read_body
from mmocap_warp.rigging.shipped import body_file
from mmocap_warp.synthesis.any_body import recorded, write_recorded

Angles = dict[str, float]

_ARMS: dict[str, tuple[float, float, float, float]] = {  # the left shoulder's three angles, and the elbow's [degrees]
    "down": (51, 9, -17, 10),
    "guard": (27, -28, -41, -76),
    "knees": (50, -32, -50, 41),
    "pressed": (67, -11, -46, -64),
    "punch": (-18, -109, 51, 45),
    "up": (3, -14, 138, 48),
}
_LEGS: dict[str, tuple[float, float]] = {  # hips and knees [degrees]
    "crouched": (-75, 105),
    "straight": (-8, 16),
    "tucked": (-110, 120),
}


def pose(legs: str, left: str, right: str, turned: float, height: float) -> Angles:
    """Key pose, of both legs and each arm, turned backwards [degrees], with the pelvis so far above where it stands."""
    angles = {"Root.Rx": -turned, "Ty": height}
    for side, sign, arm in (("L", 1, left), ("R", -1, right)):
        x, y, z, elbow = _ARMS[arm]
        angles |= {f"{side}Shoulder.Rx": x, f"{side}Shoulder.Ry": sign * y, f"{side}Shoulder.Rz": sign * z}
        hip, knee = _LEGS[legs]
        angles |= {f"{side}Elbow.Ry": sign * elbow, f"{side}Hip.Rx": hip, f"{side}Knee.Rx": knee}
    return angles


def flip_and_punch(in_air: str) -> BodyMotion:
    """The motion, with the arms so while the body is in the air."""
    before, after = ("up", "down") if in_air == "knees" else (in_air, in_air)
    keys = (
        (0.0, pose("straight", "down", "down", 0, 0.0)),
        (0.4, pose("crouched", "down", "down", 0, -0.35)),
        (0.65, pose("straight", before, before, 15, 0.1)),
        (0.9, pose("tucked", in_air, in_air, 180, 0.5)),
        (1.15, pose("straight", after, after, 350, 0.05)),
        (1.35, pose("crouched", after, after, 360, -0.3)),
        (1.7, pose("straight", "guard" if in_air == "knees" else in_air, "guard", 360, 0.0)),
        (1.83, pose("straight", "punch", "guard", 360, 0.0)),
        (1.98, pose("straight", "guard", "guard", 360, 0.0)),
        (2.11, pose("straight", "guard", "punch", 360, 0.0)),
        (2.3, pose("straight", "guard", "guard", 360, 0.0)),
        (3.2, pose("straight", "guard", "guard", 360, 0.0)),
    )
    return through_poses(read_body(body_file("adult_man")).skeleton, keys, 60.0)


def _main(folder: Path) -> None:
    body = read_body(body_file("adult_man"))
    for name, in_air in (("open", "knees"), ("pressed", "pressed")):
        print(write_recorded(folder / name, recorded(body, flip_and_punch(in_air), 7), True))


if __name__ == "__main__":
    if len(sys.argv) != 2:
        raise SystemExit("usage: python instruments/flip_and_punch.py FOLDER")
    _main(Path(sys.argv[1]))
