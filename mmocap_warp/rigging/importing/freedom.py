"""How an imported joint moves: as its file says, or as bones and skin suggest."""

import itertools
import re
from dataclasses import dataclass, replace

import numpy as np

from mmocap_warp.body.rotations import continuous_zyx_angles, nearest_rotation, transposed
from mmocap_warp.body.skeleton import Pair
from mmocap_warp.formats.rigged.rigged_mesh import RiggedMesh, skinned
from mmocap_warp.rigging.importing.joint_tree import all_frames, chains, name_list, skin_below, skin_of

_UPRIGHT = np.cos(np.radians(10.0))  # a joint whose axis its motions tilt by more on average is no hinge
_FLAT = 0.2  # bones lie in a plane if they leave it by less than this share of what they leave a line by
_BENT, _BENT_ALONE = 0.05, 0.1  # a limb that leaves a line by this share of its length has a plane
_STRAIGHT = np.radians(10.0)  # a hinge opens this far beyond a straight limb
_CLOSED = np.radians(150.0)  # a hinge closes this far from a straight limb
_EITHER_WAY = np.radians(10.0)  # a limb that is bent by less may bend either way
_HINGE = np.radians(120.0)  # limit of a hinge that may bend either way
_END = np.radians(150.0)  # limit of a hinge at a limb's end, such as a paw's, which folds either way
_SWING, _TWIST = np.radians(80.0), np.radians(45.0)  # limits of the joint at which a limb begins
_SPINE = np.radians(45.0)  # limit of spines, necks and tails, about each axis
_TRAVEL = 0.02  # a joint that slides by less is not searched, as a share of the mesh's extent
_MARGIN = np.radians(10.0)  # limits are wider than what motions show
_FARTHEST = np.radians([180.0, 85.0, 180.0])  # that any angle may be; at 90 the middle one would lock the others


@dataclass(frozen=True)
class Freedom:
    """How a joint moves."""

    frame: np.ndarray  # (3, 3), columns are its axes in the body's: hinges and sliders have x, else y is the bone's
    free: str  # axes that are searched, such as ``xyz``, ``x`` or none
    limits: np.ndarray  # (3, 2), lowest and highest angle about each axis [rad], or shift along it [m]
    origin: str  # where this is from: ``file``, ``derived``, ``given``, or why it is proposed
    slides: bool = False  # whether it slides along its axes instead of turning about them


def freedom_of(mesh: RiggedMesh, pairs: tuple[Pair, ...]) -> list[Freedom]:
    """The freedom of each joint of a mesh in the body's axes, whose mirrored pairs are known.

    A joint without skin below it has none. The root is free, but for a robot that is one chain: an arm stands on its
    base.

    Where the file says nothing: the joints of a limb after its first are hinges about the normal of the plane in which
    its bones lie, and bend on from there; the first joint of a limb, and all of those in the plane of symmetry, turn
    about three axes. A limb whose bones lie on a line has no plane: all its joints turn about three axes.

    A joint that slides is searched if its file gives it a travel that masks can show; else it is held, and its frame
    and limits are those that it has once it is freed. What the file says nothing of turns as far as its motions show.
    """
    place, skin, below = mesh.bind[:, :3, 3], skin_of(mesh), skin_below(mesh)
    ends = _ends(mesh, place, skin)
    least_travel = _TRAVEL * float(np.ptp(mesh.vertex, axis=0).max())
    in_pairs = {joint for _, *sides in pairs for joint in sides}
    # Animators' handles move no skin of their own, nor does any motion turn them: they are held.
    turns = _turns(mesh)
    still = (np.einsum("fjab,gjab->fgj", turns, turns[:1]) > 1 + 2 * np.cos(_STILL)).all(axis=(0, 1))
    handles = np.flatnonzero((skin == 0) & still) if len(turns) else ()
    # What bones suggest: limbs by their chains; all other joints turn as those of a spine do.
    derived: list[Freedom] = [_ball(place[j], ends[j], _SPINE, _SPINE) for j in range(len(mesh.joints))]
    for chain in filter(None, ([joint for joint in limb if joint not in handles] for limb in _limbs(mesh, pairs))):
        derived[chain[0]] = _ball(place[chain[0]], ends[chain[0]], _SWING, _TWIST)
        points = np.concatenate([place[chain], ends[chain[-1]][None]])
        paired = mesh.joints[chain[0]] in in_pairs  # a bend that both sides have is not there by chance
        normal = _plane_normal(points, _BENT if paired else _BENT_ALONE)
        for before, joint in itertools.pairwise(chain):
            derived[joint] = _ball(place[joint], ends[joint], _SWING, _TWIST)
            if normal is not None and (not len(turns) or normal @ turns[:, joint].mean(axis=0) @ normal > _UPRIGHT):
                derived[joint] = _hinge(place[before], place[joint], ends[joint], normal, joint not in mesh.parent)
    # What the file says comes first, and joints without skin are held.
    freedoms = []
    for joint, freedom in enumerate(derived):
        if joint == 0:
            free = "" if mesh.rigid and not mesh.roams and _is_one_chain(mesh) else "xyz"
            freedoms.append(Freedom(np.eye(3), free, np.tile([-np.inf, np.inf], (3, 1)), "derived"))
        elif joint in mesh.axes and not mesh.axes[joint].ball:
            how, limits = mesh.axes[joint], np.zeros((3, 2))
            limits[0] = how.lower, how.upper
            free = "x" if not how.slides or least_travel <= how.upper - how.lower < np.inf else ""
            frame = hinge_frame(how.axis, ends[joint] - place[joint])
            freedoms.append(Freedom(frame, free, limits, "file", how.slides))
        elif below[joint] == 0 or joint in handles:
            freedoms.append(Freedom(freedom.frame, "", np.zeros((3, 2)), "derived"))
        elif joint in mesh.axes:
            reach = np.minimum(mesh.axes[joint].upper, _FARTHEST)
            freedoms.append(replace(_ball(place[joint], ends[joint], *reach[:2]), origin="file"))
        elif len(turns):  # it turns as far as its motions show; a hinge stays one
            own = freedom.frame.T @ turns[:, joint] @ freedom.frame
            angles = continuous_zyx_angles(own, np.tile([-np.pi, np.pi], (3, 1)))
            reach = np.concatenate([angles - _MARGIN, angles + _MARGIN, freedom.limits.T]).clip(-_FARTHEST, _FARTHEST)
            limits = np.stack([reach.min(axis=0), reach.max(axis=0)], axis=1)
            limits[[axis not in freedom.free for axis in "xyz"]] = 0.0
            freedoms.append(replace(freedom, limits=limits))
        else:
            freedoms.append(freedom)
    return freedoms


def _limbs(mesh: RiggedMesh, pairs: tuple[Pair, ...]) -> list[list[int]]:
    """The chains of joints that do not lie in the plane of symmetry; of a mesh without pairs all of them."""
    aside = np.abs(mesh.bind[:, 0, 3] - mesh.bind[0, 0, 3]) >= 0.02 * float(np.ptp(mesh.bind[:, :3, 3], axis=0).max())
    return [chain for chain in chains(mesh.parent) if not pairs or aside[chain].any()]


def _turns(mesh: RiggedMesh) -> np.ndarray:
    """(frame, joint, 3, 3) rotation of each joint from its bind pose in what it hangs on, in all motions."""
    turned = all_frames(mesh)[..., :3, :3] @ transposed(mesh.bind[:, :3, :3])
    return transposed(turned[:, list(mesh.parent)]) @ turned


def held_as_seen(mesh: RiggedMesh, freedom: list[Freedom]) -> tuple[RiggedMesh, list[Freedom]]:
    """The mesh with joints that are held bound as its motions have them on average, and the freedom of its joints.

    A fist of held fingers stays a fist: an open hand is not what is filmed.
    """
    world, bind = all_frames(mesh)[..., :3, :3], mesh.bind.copy()
    held = [joint for joint, how in enumerate(freedom) if joint and not how.free and joint not in mesh.axes]
    if not held or not len(world):
        return mesh, freedom
    for joint, above in enumerate(mesh.parent[1:], 1):
        local = np.linalg.inv(mesh.bind[above]) @ mesh.bind[joint]
        if joint in held:
            local[:3, :3] = nearest_rotation((transposed(world[:, above]) @ world[:, joint]).mean(axis=0))
        bind[joint] = bind[above] @ local
    turned = bind[:, :3, :3] @ transposed(mesh.bind[:, :3, :3])
    moved = [replace(how, frame=turn @ how.frame) for how, turn in zip(freedom, turned, strict=True)]
    return replace(mesh, bind=bind, vertex=skinned(mesh, bind)), moved


MOST_SEARCHED = 100
"""Coordinates that a tracker searches at most; the root's six are among them."""
_FINE_NAMES = re.compile(r"thumb|index|middle|ring|pinky|finger|eye|brow|lash|lip|jaw|tongue|teeth|twist|roll", re.I)
_FINE_SKIN = 0.08  # a joint of such a name is held where its skin is smaller than this share of the mesh's extent


def without_fine_joints(mesh: RiggedMesh, freedom: list[Freedom]) -> tuple[list[Freedom], list[str]]:
    """Freedom without joints that masks of the whole body do not show, and a line for each reason to hold some.

    Fingers, eyes and twist bones are known by their names and the extent of the skin that follows them. If more
    coordinates are left than a tracker searches, the joints with the least skin are held too.
    """
    extent, below, found, notes = float(np.ptp(mesh.vertex, axis=0).max()), skin_below(mesh), list(freedom), []

    def hold(joints: list[int], why: str) -> None:
        for joint in joints:
            found[joint] = replace(found[joint], free="", origin=f"held, {why}")
        if joints:
            said = f"{name_list(mesh, joints)}, {why}; free them in a joints file (--write-joints, --joints)"
            notes.append(f"held: {said}")

    def is_fine(joint: int) -> bool:
        own = mesh.vertex[((mesh.influence == joint) & (mesh.weight > 0.5)).any(axis=1)]
        return not len(own) or float(np.ptp(own, axis=0).max()) < _FINE_SKIN * extent

    free = [joint for joint, how in enumerate(found) if joint and how.free and how.origin == "derived"]
    hold([j for j in free if _FINE_NAMES.search(mesh.joints[j]) and is_fine(j)], "too fine for masks of the body")
    small, free = [], [joint for joint, how in enumerate(found) if joint in free or (joint and how.free == "xyz")]
    for joint in sorted(free, key=lambda joint: (below[joint], joint)):
        if 6 + sum(len(how.free) for j, how in enumerate(found) if j and j not in small) <= MOST_SEARCHED:
            break
        small.append(joint)
    hold([joint for joint in small if found[joint].free], f"as at most {MOST_SEARCHED} coordinates are searched")
    return found, notes


_STILL = np.radians(1.0)  # a joint that motions turn by less from its mean does not turn
_SHOWN = np.radians(20.0)  # a joint that they turn by more shows its axis,
_ASIDE = np.radians(2.0)  # and is a hinge if it leaves that axis by no more than this


def propose(mesh: RiggedMesh, pairs: tuple[Pair, ...], freedom: list[Freedom]) -> tuple[list[Freedom], list[str]]:
    """Freedom in which joints that no motion turns are held, and limbs' joints that turn about one axis are hinges.

    It is a proposal for a user to read, because motions show but a part of what a body does; a line says what it is.
    Both joints of a pair are so, or neither. Motions that turn fewer than half of the joints show too little.
    """
    from scipy.spatial.transform import Rotation

    seen = _turns(mesh)
    derived = [joint for joint, how in enumerate(freedom) if joint and how.free and how.origin == "derived"]
    in_limbs = {joint for limb in _limbs(mesh, pairs) for joint in limb[1:]}
    shown: dict[int, Freedom] = {}
    for joint in derived if len(seen) else []:
        turns = Rotation.from_matrix(seen[:, joint])
        vector, how, limits = turns.as_rotvec(), freedom[joint], np.zeros((3, 2))
        axis = np.linalg.svd(vector, full_matrices=False)[2][0]
        axis *= np.sign((vector @ axis).max() + (vector @ axis).min()) or 1.0  # it bends to the positive side
        about = vector @ axis
        limits[0] = (-_STRAIGHT, _CLOSED) if about.min() > -_EITHER_WAY else (-_HINGE, _HINGE)
        limits[0] = min(limits[0, 0], about.min() - _MARGIN), max(limits[0, 1], about.max() + _MARGIN)
        aside = np.linalg.norm(vector - np.outer(about, axis), axis=1).max()
        if (turns * turns.mean().inv()).magnitude().max() < _STILL:
            shown[joint] = replace(how, free="", origin="held, as no motion turns it")
        elif joint in in_limbs and how.free == "xyz" and np.ptp(about) > _SHOWN and aside < _ASIDE:
            frame = hinge_frame(axis, how.frame[:, 1])
            shown[joint] = Freedom(frame, "x", limits, "hinge, as motions turn it about one axis")
    other = {mesh.joints.index(one): mesh.joints.index(two) for _, *both in pairs for one, two in (both, both[::-1])}
    shown = {j: how for j, how in shown.items() if (two := shown.get(other.get(j, j))) and two.free == how.free}
    still, hinges = ([joint for joint, how in shown.items() if how.free == free] for free in ("", "x"))
    if 2 * len(still) > len(derived) or not shown:
        return freedom, []
    found = [shown.get(joint, how) for joint, how in enumerate(freedom)]
    said = [f"{name_list(mesh, each)} {what}" for each, what in ((still, "held"), (hinges, "hinges")) if each]
    were, are = (sum(len(how.free) for how in each) for each in (freedom, found))
    return found, [
        f"its motions propose: {', '.join(said)} ({were} -> {are} angles); --write-joints FILE.toml writes it to be "
        "edited, --joints FILE.toml reads it"
    ]


def _is_one_chain(mesh: RiggedMesh) -> bool:
    """Whether at most one joint that turns hangs on the root, or on what slides on it: a lift may carry two arms."""
    base = {0}
    for joint, above in enumerate(mesh.parent):
        if above in base and joint in mesh.axes and mesh.axes[joint].slides:
            base.add(joint)
    return sum(above in base and joint not in base for joint, above in enumerate(mesh.parent)) <= 1


def hinge_frame(axis: np.ndarray, along: np.ndarray) -> np.ndarray:
    """(3, 3) columns: a hinge's axis, the direction nearest to ``along`` (3,) across it, and what completes them."""
    x = axis / np.linalg.norm(axis)
    across = along - (along @ x) * x
    if np.linalg.norm(across) < 1e-3 * max(float(np.linalg.norm(along)), 1e-9):
        across = np.eye(3)[np.abs(x).argmin()]
        across = across - (across @ x) * x
    y = across / np.linalg.norm(across)
    return np.stack([x, y, np.cross(x, y)], axis=1)


def _ends(mesh: RiggedMesh, place: np.ndarray, skin: np.ndarray) -> np.ndarray:
    """(joint, 3) where each joint's bone ends: at the mean of its child joints; without any, at the end of its skin."""
    ends = place.copy()
    for joint in range(len(place)):
        children = [child for child, parent in enumerate(mesh.parent) if parent == joint]
        if children:
            ends[joint] = place[children].mean(axis=0)
        elif skin[joint] > 0:
            weight = (mesh.weight * (mesh.influence == joint)).sum(axis=1)
            centre = weight @ mesh.vertex / weight.sum()
            ends[joint] = 2 * centre - place[joint]  # skin reaches about as far beyond its middle as before it
    return ends


def _plane_normal(points: np.ndarray, bent: float) -> np.ndarray | None:
    """(3,) normal of the plane in which points (n, 3) lie; None where they lie on a line, or in no plane.

    They must leave a line by the share ``bent`` of its length.
    """
    if len(points) < 3:
        return None
    _, spread, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=True)
    spread = np.append(spread, 0.0)[:3]
    return None if spread[1] < bent * spread[0] or spread[2] > _FLAT * spread[1] else axes[2]


def _hinge(before: np.ndarray, at: np.ndarray, end: np.ndarray, normal: np.ndarray, last: bool) -> Freedom:
    """A hinge about the plane's normal, turned so that positive angles close the bend that the bones have."""
    upper, lower = at - before, end - at
    bend = np.arctan2(normal @ np.cross(upper, lower), upper @ lower - (upper @ normal) * (lower @ normal))
    axis = normal if bend >= 0 else -normal
    if last:
        low, high = -_END, _END
    elif abs(bend) < _EITHER_WAY:
        low, high = -_HINGE, _HINGE
    else:
        low, high = -abs(bend) - _STRAIGHT, max(_CLOSED - abs(bend), _STRAIGHT)
    limits = np.zeros((3, 2))
    limits[0] = low, high
    return Freedom(hinge_frame(axis, lower), "x", limits, "derived")


def _ball(at: np.ndarray, end: np.ndarray, swing: float, twist: float) -> Freedom:
    """Three angles, the middle one about the bone: it turns least, and a quarter turn of it would lock the others."""
    bone = end - at
    length = float(np.linalg.norm(bone))
    y = bone / length if length > 1e-9 else np.array([0.0, 1.0, 0.0])
    sideways = np.array([1.0, 0.0, 0.0]) if abs(y[0]) < 0.9 else np.array([0.0, 0.0, 1.0])
    x = sideways - (sideways @ y) * y
    x /= np.linalg.norm(x)
    limits = np.array([[-swing, swing], [-twist, twist], [-swing, swing]])
    return Freedom(np.stack([x, y, np.cross(x, y)], axis=1), "xyz", limits, "derived")
