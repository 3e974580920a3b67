"""Move the joint centres of a shipped person to another joint set's, and measure skin and angles of both bodies.

``python instruments/moved_centres.py FOLDER`` writes the body as ``moved.usdc``, which ``--body`` of ``mmocap fit`` and
``track`` takes, bends its joints (a table and ``bends.png``), and films the built-in walk of both bodies and tracks it
with both. Centres move in the bind pose and in each shape target, axes and limits follow as in ``make_body.py``, and
weights stay. docs/measures.md says what was found.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from make_body import joint_frames, joint_limits
from person_skeleton import human_skeleton
from walk_scene import walking, write_walk

from mmocap_warp.biomechanics.joint_angles import joint_angles
from mmocap_warp.body.joint_sets import JointSet, joint_set
from mmocap_warp.body.model import BodyModel
from mmocap_warp.body.posing import Poser
from mmocap_warp.body.skeleton import TRANSLATION
from mmocap_warp.commands.track import fit, track
from mmocap_warp.formats.usd.usd_body import write_body
from mmocap_warp.result.marker_errors import triangulated
from mmocap_warp.rigging.shipped import load_body

# Bends of the left side: the joint, the axis, the angle from the bind pose [degrees].
_BENDS = {
    "elbow": ("LElbow", "y", -90),
    "wrist": ("LWrist", "z", 50),
    "shoulder": ("LShoulder", "z", 60),
    "hip": ("LHip", "x", -100),
    "knee": ("LKnee", "x", 120),
    "ankle": ("LAnkle", "x", 30),
}
_NEAR = 0.15  # the skin that is as near to the joint at rest is judged [m]
_SCALE, _VIEW = 700.0, 0.3  # of the picture: pixels a metre; half a bend's width [m]
_ANGLES = (
    ("Hip", "flexion"),
    ("Hip", "adduction"),
    ("Hip", "internal_rotation"),
    ("Knee", "flexion"),
    ("Ankle", "dorsiflexion"),
    ("Elbow", "flexion"),
)


def moved(body: BodyModel, to: JointSet, kinds: list[str]) -> BodyModel:
    """The body whose joints of some kinds, such as Hip, have the set's places, in the bind pose and in every shape."""
    names = np.array(body.skeleton.joints)
    points = [row for row, joint in enumerate(to.counterpart) if joint > 0 and names[joint][1:] in kinds]
    joint, place, shape_joint = to.counterpart[points], body.joint_rest.copy(), body.shape_joint.copy()
    by_skin = np.einsum("pv,svk->spk", to.vertex_weight[points], body.shape_vertex[:, to.vertex])
    shape_joint[:, joint] = by_skin + np.einsum("pj,sjk->spk", to.joint_weight[points], body.shape_joint)
    place[joint] = to.at_rest(body)[points]
    frame, elbow, knee = joint_frames(place.astype(float))
    skeleton = human_skeleton(frame, joint_limits(elbow, knee))
    return replace(body, skeleton=skeleton, joint_rest=place, shape_joint=shape_joint)


def bent(body: BodyModel, joint: str, axis: str, angle: float) -> np.ndarray:
    """The skin (vertex, 3) with one joint bent by an angle [degrees] from the bind pose, its root where it was."""
    pose = np.zeros((1, body.skeleton.coordinates))
    pose[0, :TRANSLATION] = body.joint_rest[0]
    pose[0, TRANSLATION + 3 * body.skeleton.index(joint) + "xyz".index(axis)] = np.radians(angle)
    return Poser(body, np.eye(3)).vertices(pose)[0].astype(float)


def volume(skin: np.ndarray, body: BodyModel) -> float:
    """What the closed tracking mesh holds [m3]."""
    a, b, c = skin[body.tracking_vertex][body.tracking_face].swapaxes(0, 1)
    return float(np.einsum("fi,fi->", a, np.cross(b, c)) / 6)


def edges(face: np.ndarray) -> np.ndarray:
    """The edges (edge, 2) of triangles (face, 3), each once."""
    return np.unique(np.sort(face[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)


def crossings(skin: np.ndarray, body: BodyModel, near: np.ndarray) -> int:
    """How often edges of the tracking mesh go through its triangles, of those whose vertices are all near (vertex,)."""
    face = body.tracking_vertex[body.tracking_face]
    face = face[near[face].all(axis=1)]
    a, b, c = (skin[face[:, corner]] for corner in range(3))
    count = 0
    for first, second in edges(face):
        # The edge meets a triangle at start + t (end - start), or a + u (b - a) + v (c - a).
        along, away = skin[second] - skin[first], skin[first] - a
        across, turned = np.cross(along, c - a), np.cross(away, b - a)
        scale = ((b - a) * across).sum(axis=1)
        scale[scale == 0] = np.nan  # parallel, which is no crossing
        u, v, t = (away * across).sum(axis=1) / scale, turned @ along / scale, ((c - a) * turned).sum(axis=1) / scale
        apart = ~np.isin(face, (first, second)).any(axis=1)
        with np.errstate(invalid="ignore"):
            count += int((apart & (u >= 0) & (v >= 0) & (u + v <= 1) & (t >= 0) & (t <= 1)).sum())
    return count


def stretch(skin: np.ndarray, body: BodyModel, near: np.ndarray) -> float:
    """By how much near edges of the skin are longer or shorter than at rest: the rms of the factors' logarithm."""
    edge = edges(triangulated(body.skin.face))
    edge = edge[near[edge].all(axis=1)]
    now, rest = (np.linalg.norm(each[edge[:, 0]] - each[edge[:, 1]], axis=1) for each in (skin, body.skin.rest))
    return float(np.sqrt((np.log(now / rest) ** 2).mean()))


def drawn(skin: np.ndarray, body: BodyModel, middle: np.ndarray, title: str) -> np.ndarray:
    """The skin near a place, shaded, from the left."""
    size = int(2 * _VIEW * _SCALE)
    face = skin[triangulated(body.skin.face)]
    normal = np.cross(face[:, 1] - face[:, 0], face[:, 2] - face[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True) + 1e-12
    image = np.full((size, size, 3), 255, np.uint8)
    pixels = (face[..., [2, 1]] - middle[[2, 1]]) * [_SCALE, -_SCALE] + size / 2
    for number in np.argsort(face[..., 0].mean(axis=1)):
        if normal[number, 0] > 0:
            light = 60 + 180 * max(float(normal[number] @ (0.76, 0.46, 0.46)), 0)
            cv2.fillConvexPoly(image, (pixels[number] * 16).round().astype(np.int32), (light,) * 3, cv2.LINE_AA, 4)
    cv2.putText(image, title, (6, 20), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 0, 0), 1, cv2.LINE_AA)
    return image


def compare_skins(bodies: dict[str, BodyModel], picture: Path) -> None:
    """Print what each bend does to the skin of the bodies, and draw it."""
    own, other = bodies.values()
    rest = own.skin.rest.astype(float)
    print("bend              moved [mm]  volume [%]     stretch [%]    crossings")
    columns = []
    for name, (joint, axis, angle) in _BENDS.items():
        number = own.skeleton.index(joint)
        near = np.linalg.norm(rest - own.joint_rest[number], axis=1) < _NEAR
        skins = [bent(body, joint, axis, angle) for body in bodies.values()]
        way = 1000 * np.linalg.norm(own.joint_rest[number] - other.joint_rest[number])
        lost = [100 * (volume(skin, own) / volume(rest, own) - 1) for skin in skins]
        longer = [100 * stretch(skin, own, near) for skin in skins]
        crossed = [crossings(skin, own, near) for skin in skins]
        print(
            f"{name:9} {angle:4}°  {way:11.1f}   {lost[0]:5.2f}, {lost[1]:5.2f}   {longer[0]:5.1f}, {longer[1]:5.1f}"
            f"   {crossed[0]:4}, {crossed[1]}"
        )
        middle = skins[0][near].mean(axis=0)
        column = [drawn(skin, own, middle, f"{name}, {which}") for which, skin in zip(bodies, skins, strict=True)]
        columns.append(np.vstack(column))
    cv2.imwrite(str(picture), np.hstack(columns))


def anatomical(body: BodyModel, base: np.ndarray, pose: np.ndarray, to: JointSet) -> dict[str, dict[str, np.ndarray]]:
    """Angles [degrees] of poses by the centres of a set, as ``mmocap measure --joint-set`` takes them."""
    return joint_angles(to.centred(body), Poser(body, base).joint_transforms(pose))


def compare_angles(folder: Path, files: dict[str, str], to: str, kinds: list[str]) -> None:
    """Film the walk of a body with its own and one with moved centres, track both films with both, and print errors."""
    print("filmed  tracked  rms of", ", ".join(f"{joint} {name}" for joint, name in _ANGLES), "[degrees]")
    for filmed in files:
        made = walking()
        if filmed != "own":
            made = replace(made, body=moved(made.body, joint_set(to, made.body), kinds))
        scene = write_walk(folder / f"walk-{filmed}", made)
        truth = anatomical(made.body, made.root_base, made.poses, joint_set(to, made.body))
        for tracked, file in files.items():
            subject = fit(scene, file)
            pose = track(scene, subject).pose[0]
            found = anatomical(subject.body, subject.root_base, pose, joint_set(to, subject.body))
            off = [
                np.mean([np.sqrt(((found[s + joint][name] - truth[s + joint][name]) ** 2).mean()) for s in "LR"])
                for joint, name in _ANGLES
            ]
            print(f"{filmed:7} {tracked:8}", *(f"{each:.2f}" for each in off), flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="where the files are written")
    parser.add_argument("--body", default="adult_man")
    parser.add_argument("--joint-set", default="isb")
    parser.add_argument("--kinds", nargs="+", default=["Shoulder", "Elbow", "Wrist", "Hip", "Knee", "Ankle"])
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    body = load_body(given.body)
    other = moved(body, joint_set(given.joint_set, body), given.kinds)
    file = given.folder / "moved.usdc"
    write_body(file, other)
    compare_skins({"own": body, "moved": other}, given.folder / "bends.png")
    compare_angles(given.folder, {"own": given.body, "moved": str(file)}, given.joint_set, given.kinds)
