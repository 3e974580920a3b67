"""A data folder as MakeHuman's, of a figure of boxes: every file that making a body reads, small and known exactly."""

from __future__ import annotations

import gzip
import itertools
import json
from pathlib import Path

import numpy as np
from make_body import _BONE, _LOCAL_TARGETS
from makehuman import MacroSliders, macro_weights
from person_skeleton import JOINTS, PARENT

from mmocap_warp.body.model import BodyModel

UNITS_PER_METRE = 10.0
FINGERS = "LeftHandIndex1"
"""A bone that starts no joint of ours and carries half of the left hand's weight."""

MACROS: dict[str, tuple[float, float, float]] = {
    "maxheight": (0.0, 0.15, 0.0),
    "minheight": (0.0, -0.15, 0.0),
    "maxweight": (0.2, 0.0, 0.3),
    "minweight": (-0.1, 0.0, -0.1),
    "maxmuscle": (0.1, 0.0, 0.0),
    "minmuscle": (-0.1, 0.0, 0.0),
    "female": (-0.05, 0.0, 0.02),
    "old": (0.0, -0.02, 0.0),
}
"""By how much of its distance from the origin each slider's end moves a vertex, in x, y and z."""


def write_target(folder: Path, name: str, lines: str) -> None:
    """Write ``targets/<name>.target.gz``."""
    path = folder / "targets" / f"{name}.target.gz"
    path.parent.mkdir(parents=True, exist_ok=True)
    with gzip.open(path, "wt", compresslevel=1) as file:
        file.write(lines)


def write_makehuman(folder: Path, body: BodyModel) -> None:
    """Write a data folder from which a young man of average build is made as ``body``, its lowest vertex on the ground.

    Other builds are this one stretched by ``MACROS``; a local target stretches it by ``local_stretch``.
    """
    vertex = np.concatenate([body.skin.rest, *(joint + _CUBE for joint in body.joint_rest)]) * UNITS_PER_METRE
    _write_mesh(folder, body, vertex)
    _write_rig(folder, body)
    for name in _macro_targets():
        _write_stretch(folder, f"macrodetails/{name}", vertex, _macro_stretch(name))
    for parts in _LOCAL_TARGETS.values():
        for part, sign in itertools.product(parts, ("incr", "decr")):
            _write_stretch(folder, f"{part}-{sign}", vertex, local_stretch(f"{part}-{sign}"))


def local_stretch(name: str) -> np.ndarray:
    """What a local target does, as in ``MACROS``: each something else, and the opposite for ``decr``."""
    part, sign = name.rsplit("-", 1)
    amount = 0.01 * (1 + sorted(itertools.chain(*_LOCAL_TARGETS.values())).index(part))
    return np.array([amount, 0.0, amount]) * (1 if sign == "incr" else -1)


_CUBE = 0.01 * np.array([(-1.0, 0, 0), (1.0, 0, 0), (0, 0, -1.0), (0, 0, 1.0)])  # a joint's, about its centre [m]


def _macro_targets() -> set[str]:
    """Every macro target that some person needs."""
    ends = (0.0, 0.5, 1.0)
    ages = (0.0, 0.1875, 0.5, 1.0)
    people = itertools.product((0.0, 1.0), ages, ends, ends, ends, ends)
    return {
        name
        for gender, age, height, weight, muscle, proportions in people
        for name in macro_weights(MacroSliders(gender, age, height, weight, muscle, proportions))
    }


def _macro_stretch(name: str) -> np.ndarray:
    """What a macro target does: height has targets of its own, ancestry and proportions do nothing here."""
    path, _, build = name.rpartition("/")
    heights = path == "height"
    if not heights and not build.startswith("universal-"):
        return np.zeros(3)
    ends = [MACROS[end] for end in MACROS if end in build.split("-") and end.endswith("height") == heights]
    return np.sum(ends, axis=0) if ends else np.zeros(3)


def _write_stretch(folder: Path, name: str, vertex: np.ndarray, stretch: np.ndarray) -> None:
    moved = vertex * stretch
    lines = (f"{v} {x!r} {y!r} {z!r}\n" for v, (x, y, z) in enumerate(moved.tolist()) if x or y or z)
    write_target(folder, name, "# made up\n" + "".join(lines))


def _write_mesh(folder: Path, body: BodyModel, vertex: np.ndarray) -> None:
    skin = len(body.skin.rest)
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertex.tolist()]
    lines += ["g body", *(_face(corners) for corners in body.skin.face)]
    for j, joint in enumerate(JOINTS):
        lines += [f"g joint-{_BONE[joint]}", _face(skin + 4 * j + np.arange(4))]
    (folder / "3dobjs").mkdir(parents=True)
    (folder / "3dobjs" / "base.obj").write_text("\n".join(lines) + "\n")


def _face(corners: np.ndarray) -> str:
    return "f " + " ".join(f"{v + 1}/1" for v in corners.tolist())


def _write_rig(folder: Path, body: BodyModel) -> None:
    bones = {
        _BONE[joint]: {
            "parent": "" if parent < 0 else _BONE[JOINTS[parent]],
            "head": {"strategy": "CUBE", "cube_name": f"joint-{_BONE[joint]}"},
        }
        for joint, parent in zip(JOINTS, PARENT, strict=True)
    }
    hand = _BONE["LWrist"]
    bones[FINGERS] = {"parent": hand, "head": {"strategy": "VERTEX", "vertex_index": 0}}
    weights: dict[str, list] = {bone: [] for bone in bones}
    for v, (joints, parts) in enumerate(zip(body.skin.joint.tolist(), body.skin.weight.tolist(), strict=True)):
        for joint, part in zip(joints, parts, strict=True):
            bone = _BONE[JOINTS[joint]]
            if bone == hand:
                weights[FINGERS].append([v, part / 2])
                part /= 2
            weights[bone].append([v, part])
    for pairs in weights.values():
        pairs[:] = [pair for pair in pairs if pair[1]]
    rigs = folder / "rigs" / "standard"
    rigs.mkdir(parents=True)
    (rigs / "rig.cmu_mb.json").write_text(json.dumps(bones))
    (rigs / "weights.cmu_mb.json").write_text(json.dumps({"weights": weights}))
