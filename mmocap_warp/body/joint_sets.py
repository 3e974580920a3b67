"""Joints by other definitions than the body's own: tables of linear combinations of skin vertices and joints.

A table is a text in TOML; docs/formats.md describes it. It comes with the program, with the body, or in a user's file.
"""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mmocap_warp.body.model import BodyModel, Subject
from mmocap_warp.body.posing import Poser, blocks, skin_positions
from mmocap_warp.errors import InputError, input_errors
from mmocap_warp.scenes import ROOT
from mmocap_warp.whole_file import read_text

RIG = "rig"
"""The set that every body has: its own joints."""

_FOLDER = ROOT / "bodies" / "joint_sets"
_POSES_AT_ONCE = 256  # poses whose skin is posed together; 13,000 vertices of each take 160 KB
_MAX_WEIGHT = 1e9  # of a term
_SUM_TOLERANCE = 1e-3  # a point's weights must sum to one within this, or it would not move with the body


@dataclass(frozen=True, eq=False)
class JointSet:
    """Points of a body, each the sum of weighted skin vertices and joints."""

    name: str  # of the set
    names: tuple[str, ...]  # one per point
    vertex: np.ndarray  # (vertex,) int, the skin's vertices that it uses
    vertex_weight: np.ndarray  # (point, vertex) float64
    joint_weight: np.ndarray  # (point, joint) float64
    # (point,) int, the joint that carries the rest body's point rigidly; -1 for one that follows the skin.
    carrier: np.ndarray
    counterpart: np.ndarray  # (point,) int, the body's joint that the point is another definition of; -1 for none

    def at_rest(self, body: BodyModel) -> np.ndarray:
        """The points of the body in its bind pose, (point, 3) float64 [m]."""
        return np.asarray(self.vertex_weight @ body.skin.rest[self.vertex] + self.joint_weight @ body.joint_rest)

    def centred(self, body: BodyModel) -> BodyModel:
        """The body whose joints have their counterparts' places in the bind pose: for measures, not to be posed."""
        place, stand = body.joint_rest.copy(), self.counterpart >= 0
        place[self.counterpart[stand]] = self.at_rest(body)[stand]
        return replace(body, joint_rest=place)

    def positions(self, subject: Subject, pose: np.ndarray) -> np.ndarray:
        """The points in the world for full poses (n, coordinate): (n, point, 3) float64 [m]."""
        body, rigid = subject.body, self.carrier >= 0
        joint = self.carrier[rigid]
        # A rigid point keeps its place in the axes of the joint that carries it.
        offset = self.at_rest(body)[rigid] - body.joint_rest[joint]
        own = np.einsum("pba,pb->pa", body.skeleton.frame[joint].astype(float), offset)
        followed = np.flatnonzero(self.vertex_weight[~rigid].any(axis=0))
        weight = self.vertex_weight[~rigid][:, followed]
        poser, places = Poser(body, subject.root_base), np.empty((len(pose), len(self.names), 3))
        for block in blocks(len(pose), _POSES_AT_ONCE):
            world = poser.joint_transforms(pose[block]).astype(float)
            turned = np.einsum("fpab,pb->fpa", world[:, joint][..., :3, :3], own)
            places[block, rigid] = turned + world[:, joint][..., :3, 3]
            skin = skin_positions(subject, pose[block], self.vertex[followed])
            places[block, ~rigid] = weight @ skin + self.joint_weight[~rigid] @ world[:, :, :3, 3]
        return places

    def of_runs(self, subject: Subject, pose: np.ndarray) -> np.ndarray:
        """The points for poses (run, frame, coordinate): (run, frame, point, 3) float64 [m]."""
        return self.positions(subject, pose.reshape(-1, pose.shape[2])).reshape(*pose.shape[:2], -1, 3)

    def axes(self, body: BodyModel) -> np.ndarray:
        """(point,) int, the joint in whose axes each point's offset is constant: its counterpart's parent, or its own.

        Without a counterpart, it is the joint that carries the point or most of the skin that the point follows.
        """
        skin, parent = body.skin, np.maximum(np.array(body.skeleton.parent), 0)
        by_skin = np.zeros((len(self.vertex), len(parent)))
        np.add.at(by_skin, (np.arange(len(self.vertex))[:, None], skin.joint[self.vertex]), skin.weight[self.vertex])
        followed = (self.vertex_weight @ by_skin + self.joint_weight).argmax(axis=1)
        own = np.where(self.carrier >= 0, self.carrier, followed)
        return np.where(self.counterpart >= 0, parent[self.counterpart], own)


def joint_set(name: str | Path, body: BodyModel) -> JointSet:
    """A body's joint set: ``rig``, one of the body or the program, or a .toml file; an InputError for no such set."""
    skeleton, known = body.skeleton, body.joint_sets
    if name == RIG:
        number, none = np.arange(len(skeleton.joints)), np.zeros(0, int)
        return JointSet(RIG, skeleton.joints, none, np.zeros((len(number), 0)), np.eye(len(number)), number, number)
    if Path(name).suffix == ".toml":
        return parse_joint_set(read_text(name, "give a TOML text file"), body, name, Path(name).stem)
    if name in known:
        return parse_joint_set(known[str(name)], body, f"joint set {name} of {body.name}", str(name))
    file = _FOLDER / f"{name}.toml"
    if not file.is_file():
        names = ", ".join([RIG, *known, *sorted(each.stem for each in _FOLDER.glob("*.toml"))])
        raise InputError("joint set", f"there is no '{name}'", f"name one of {names}, or a .toml file")
    return parse_joint_set(read_text(file, "install the package again"), body, file, str(name))


def parse_joint_set(text: str, body: BodyModel, source: str | Path, name: str = "") -> JointSet:
    """A body's set of a table in TOML; an InputError, which names ``source``, if it is none or of another body."""
    with input_errors(source, "is not valid TOML: {error}", "correct that line", ValueError, RecursionError):
        table = tomllib.loads(text)
    landmarks, points, vertices = (table.get(key, {}) for key in ("landmarks", "joints", "vertices"))
    count = len(body.skin.rest)
    if vertices not in ({}, count):
        problem = f"is for a skin of {vertices} vertices, and that of {body.name} has {count}"
        raise InputError(source, problem, f"name another set, such as {RIG}")
    if set(table) - {"landmarks", "joints", "vertices"} or not isinstance(points, dict) or not points:
        raise InputError(source, "has no joints or unknown keys", "give vertices, [landmarks] and [joints] alone")
    if not isinstance(landmarks, dict):
        raise InputError(source, "landmarks is no table", "give each landmark a vertex or a list of vertices")
    return _Rows(body, landmarks, source).joint_set(name, points)


class _Rows:
    """Fills the matrices of a set, a point of the body a row, by landmarks' vertices; errors name ``source``."""

    def __init__(self, body: BodyModel, landmarks: Mapping[str, Any], source: object) -> None:
        self._skeleton, self._count, self._source = body.skeleton, len(body.skin.rest), source
        self._landmarks = {name: value if isinstance(value, list) else [value] for name, value in landmarks.items()}
        for name, vertices in self._landmarks.items():
            if not vertices or not all(type(each) is int and 0 <= each < self._count for each in vertices):
                raise self._error(name, f"is no vertex, or list of vertices, of 0 to {self._count - 1}")

    def joint_set(self, name: str, points: Mapping[str, Any]) -> JointSet:
        """The set of the table ``[joints]``."""
        skin = np.zeros((len(points), self._count))
        joint = np.zeros((len(points), len(self._skeleton.joints)))
        carrier, counterpart = (np.full(len(points), -1) for _ in range(2))
        for row, (point, entry) in enumerate(points.items()):
            if not isinstance(entry, dict) or set(entry) - {"of", "on", "is"} or not set(entry) & {"of", "is"}:
                raise self._error(point, "is no table of 'of', 'on' and 'is'")
            carrier[row], counterpart[row] = (
                self._joint(point, entry[key]) if key in entry else -1 for key in ("on", "is")
            )
            self._add(point, entry.get("of", {entry.get("is"): 1}), skin[row], joint[row])
        used = np.flatnonzero(skin.any(axis=0))
        return JointSet(name, tuple(points), used, skin[:, used], joint, carrier, counterpart)

    def _add(self, point: str, terms: Any, skin: np.ndarray, joint: np.ndarray) -> None:
        """Add weighted landmarks, vertices (``v12``) and joints of the body to a point's rows."""
        if not isinstance(terms, dict) or not all(
            type(weight) in (int, float) and abs(weight) < _MAX_WEIGHT for weight in terms.values()
        ):
            raise self._error(point, "does not give each of its terms a number")
        for term, weight in terms.items():
            number = int(term[1:]) if term[:1] == "v" and term[1:].isdecimal() and len(term) < 12 else -1
            if term in self._landmarks:
                np.add.at(skin, self._landmarks[term], weight / len(self._landmarks[term]))
            elif 0 <= number < self._count:
                skin[number] += weight
            else:
                joint[self._joint(point, term)] += weight
        total = skin.sum() + joint.sum()
        if not abs(total - 1) < _SUM_TOLERANCE:
            raise self._error(point, f"has weights that sum to {total:.4g}, not 1")

    def _joint(self, point: str, name: Any) -> int:
        if name not in self._skeleton.joints:
            raise self._error(point, f"names {name!r}, which is no landmark, no vertex and no joint of the body")
        return self._skeleton.joints.index(name)

    def _error(self, point: str, problem: str) -> InputError:
        return InputError(self._source, f"'{point}' {problem}", "docs/formats.md has an example")
