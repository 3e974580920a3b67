"""The joint tree of a rigged mesh: one root, names that USD takes, chains, and which joints mirror each other."""

import re
from collections.abc import Container
from dataclasses import replace
from itertools import combinations, pairwise
from operator import eq

import numpy as np

from mmocap_warp.body.skeleton import Pair
from mmocap_warp.formats.rigged.rigged_mesh import RiggedMesh, parents_first, reorder, skinned

_LONGEST_CHAIN = 5  # number of joints that are searched together, at most
_MIRRORED = 0.02  # how far mirrored joints may be apart, as a share of the skeleton's extent
_BARE = 1e-3  # a root that less skin follows is none, as a share of all


def skin_below(mesh: RiggedMesh) -> np.ndarray:
    """(joint,) how much skin follows each joint or one that hangs on it, as a sum of weights."""
    total = skin_of(mesh)
    for joint in range(len(mesh.joints) - 1, 0, -1):
        if mesh.parent[joint] >= 0:
            total[mesh.parent[joint]] += total[joint]
    return total


def skin_of(mesh: RiggedMesh) -> np.ndarray:
    """(joint,) how much skin follows each joint itself, as a sum of weights."""
    return np.bincount(mesh.influence.ravel(), mesh.weight.ravel(), len(mesh.joints))


def with_named_joints(mesh: RiggedMesh) -> RiggedMesh:
    """The mesh with names of joints that can be printed and differ, whatever a format makes of blanks and marks."""
    names: dict[str, str] = {}  # by what the strictest formats leave of them
    for joint in mesh.joints:  # a + joins the names of a pair
        name = "".join(letter if letter.isprintable() and letter != "+" else "_" for letter in joint).strip() or "joint"
        free = (name if i == 1 else f"{name}_{i}" for i in range(1, len(mesh.joints) + 1))
        name = next(each for each in free if re.sub(r"\W", "_", each) not in names)
        names[re.sub(r"\W", "_", name)] = name
    return replace(mesh, joints=tuple(names.values()))


def with_parents(mesh: RiggedMesh, parents: dict[str, str]) -> RiggedMesh:
    """The mesh with some joints hung on others, by name; a ValueError for one that there is not, or a circle."""
    number = {name: joint for joint, name in enumerate(mesh.joints)}
    parent = list(mesh.parent)
    for joint, above in parents.items():
        for name in (joint, above):
            if name not in number:
                raise ValueError(f"there is no joint {name!r}; there are {', '.join(mesh.joints)}")
        parent[number[joint]] = number[above]
    return reorder(replace(mesh, parent=tuple(parent)))


_LOOSE = 0.05  # a joint that moves farther about another is not held by it; as a share of the mesh's extent
_STEADIER = 0.4  # another joint must leave at most so much of a joint's motion for it to be hung there


def with_moving_parents(mesh: RiggedMesh, kept: Container[str] = ()) -> RiggedMesh:
    """The mesh with joints hung on what they move with, where they leave the joint that they hang on.

    Rigs for animators hang feet on the root and let inverse kinematics bring them to the shins: the file's motions show
    what holds them. A joint goes to the one in whose axes its place varies least, the clearest case first. What moves
    no skin is detached, and a root that the only joint on it leaves gives its skin to that joint. Joints in ``kept``
    and those that slide by their file stay where they are.
    """
    if not mesh.motions:
        return mesh
    limit, skin = _LOOSE * float(np.ptp(mesh.vertex, axis=0).max()), skin_below(mesh)
    world = all_frames(mesh)
    parent, notes = list(mesh.parent), list(mesh.notes)
    roots = [joint for joint, above in enumerate(parent) if above < 0]
    trunk = max(roots, key=lambda joint: skin[joint])
    # How much the places of joints vary in the axes of each other joint, of those that leave what they hang on.
    varies: dict[int, np.ndarray] = {}
    for joint in range(len(parent)):
        above = parent[joint] if joint not in roots else trunk
        if joint == trunk or joint in mesh.axes or mesh.joints[joint] in kept:
            continue
        strays = _strays(world, joint)
        if strays[:, above].max() >= limit:
            if skin[joint] > 0:
                varies[joint] = np.sqrt((strays**2).mean(axis=0))
                varies[joint] /= max(varies[joint][above], 1e-9 * limit)
                varies[joint][skin == 0] = np.inf
            else:
                parent[joint] = -1
    while varies:
        for joint, share in varies.items():  # none hangs on itself
            below = {joint}
            for other in parents_first(parent):
                below |= {other} if parent[other] in below else set()
            share[list(below)] = np.inf
        joint = min(varies, key=lambda joint: varies[joint].min())
        holder = int(varies[joint].argmin())
        if varies.pop(joint)[holder] >= _STEADIER:
            break
        was = f", not with {mesh.joints[parent[joint]]}" if parent[joint] >= 0 else ""
        notes.append(f"{mesh.joints[joint]} moves with {mesh.joints[holder]}{was}: hung on it")
        parent[joint] = holder
    # A root that stays behind is no part of the body.
    influence = mesh.influence
    shown = [joint for joint, above in enumerate(parent) if above == trunk and skin[joint] > 0]
    if len(shown) == 1 and _strays(world, shown[0])[:, trunk].max() >= limit:
        influence = np.where(influence == trunk, shown[0], influence)
    return reorder(replace(mesh, parent=tuple(parent), influence=influence, notes=tuple(notes)))


_SAME_PLACE = 0.01  # a joint is where it is bound if motions have it nearer to there; as a share of the mesh's extent
_FAR = 4  # times as far it is put where it turns even if it leaves that place by more


def with_usual_bones(mesh: RiggedMesh, kept: Container[str] = ()) -> RiggedMesh:
    """The mesh with its joints where its motions turn them, and bones as long as they mostly have them.

    Bones of a body keep their lengths. A joint that leaves its place is put where it turns, if there is such a place:
    toys' legs swing about hips that are no joints. Some files bind ends without skin anywhere. Joints in ``kept`` and
    those that slide by their file stay where they are bound.
    """
    world, turning, bind, other = all_frames(mesh), mesh.bind.copy(), mesh.bind.copy(), []
    limit = _SAME_PLACE * float(np.ptp(mesh.vertex, axis=0).max())
    for joint, above in enumerate(mesh.parent[1:], 1):
        shift, local = np.eye(4), np.linalg.inv(turning[above]) @ turning[joint]
        if len(world) and joint not in mesh.axes and mesh.joints[joint] not in kept:
            seen = np.linalg.inv(world[:, above]) @ world[:, joint]
            offset, (pivot, strays) = seen[:, :3, 3] - np.median(seen[:, :3, 3], axis=0), _pivot(seen)
            leaves = float(np.linalg.norm(offset)) / np.sqrt(len(seen))
            if leaves > limit and (strays < limit or leaves > max(_FAR * limit, 2 * strays)):
                shift[:3, 3] = pivot
                turning[joint], world[:, joint] = turning[joint] @ shift, world[:, joint] @ shift
            local, usual = local @ shift, np.median(seen @ shift, axis=0)[:3, 3]
            if np.linalg.norm(usual - local[:3, 3]) > limit:
                local[:3, 3] = usual
                other.append(joint)
        bind[joint] = bind[above] @ local
    if not other and np.array_equal(turning, mesh.bind):
        return mesh
    said = [f"bones to {name_list(mesh, other)} are as its motions have them, not as its bind pose"] * bool(other)
    moved = iter(np.split(world, np.cumsum([len(motion.world) for motion in mesh.motions.values()])))
    motions = {name: replace(motion, world=next(moved)) for name, motion in mesh.motions.items()}
    vertex = skinned(replace(mesh, bind=turning), bind)
    return replace(mesh, bind=bind, vertex=vertex, motions=motions, notes=(*mesh.notes, *said))


def _pivot(seen: np.ndarray) -> tuple[np.ndarray, float]:
    """(3,) the point of a joint that moves least in all of its transforms (frame, 4, 4), and how far that strays."""
    matrix = np.concatenate([seen[:, :3, :3], np.tile(-np.eye(3), (len(seen), 1, 1))], axis=2).reshape(-1, 6)
    found = np.linalg.lstsq(matrix, -seen[:, :3, 3].ravel(), rcond=1e-3)[0]
    return found[:3], float(np.linalg.norm(matrix @ found + seen[:, :3, 3].ravel())) / np.sqrt(len(seen))


def all_frames(mesh: RiggedMesh) -> np.ndarray:
    """(frame, joint, 4, 4) all motions, one after the other."""
    return np.concatenate([np.zeros((0, *mesh.bind.shape)), *(motion.world for motion in mesh.motions.values())])


def _strays(world: np.ndarray, joint: int) -> np.ndarray:
    """(frame, other joint): how far a joint is from its middle place in the axes of each other joint."""
    offset = world[:, joint, None, :3, 3] - world[:, :, :3, 3]
    local = np.einsum("fjba,fjb->fja", world[:, :, :3, :3], offset)
    return np.linalg.norm(local - np.median(local, axis=0), axis=2)


def with_one_root(mesh: RiggedMesh) -> RiggedMesh:
    """The mesh with one root, without joints that move no skin, and with notes of what was done.

    1. Where all joints hang on none, those whose names share a beginning are chains that hang on the first joint,
       unless motions show what they move with.
    2. Branches that no skin follows are left out, but for the end of a joint that skin follows.
    3. The root is the first joint that skin follows, by more than a few stray vertices, or on which several hang.
    4. Other joints that hang on none are hung on the root.

    Raises:
        ValueError: all joints hang on none, and their names do not show chains.
    """
    notes = list(mesh.notes)
    if len(mesh.joints) > 1 and all(parent < 0 for parent in mesh.parent) and not mesh.motions:
        mesh = with_parents(mesh, _chains_by_name(mesh.joints))
        notes.append(f"its joints hang side by side: chains are taken from their names and hang on {mesh.joints[0]}")
    # Which joints skin could show: those with skin at or below them, and the ends of joints that have skin.
    below, own = skin_below(mesh), skin_of(mesh)
    if not below.any():
        raise ValueError("no joint moves any skin")
    shown = (below > 0) | np.array([parent >= 0 and own[parent] > 0 for parent in mesh.parent])
    roots = [joint for joint, parent in enumerate(mesh.parent) if parent < 0 and below[joint] > 0]
    # The root is found from the top of the largest tree, past joints without skin from which one branch goes on.
    main, influence = max(roots, key=lambda joint: below[joint]), mesh.influence
    while own[main] < _BARE * own.sum():
        children = [joint for joint, parent in enumerate(mesh.parent) if parent == main and below[joint] > 0]
        if len(children) != 1:
            break
        influence = np.where(influence == main, children[0], influence)
        shown[main], main = False, children[0]
    # Further trees hang on it.
    stray = [joint for joint in roots if shown[joint] and below[joint] > 0 and joint != main]
    if stray:
        notes.append(f"{name_list(mesh, stray)} hang on no joint: hung on {mesh.joints[main]}")
    parent = list(mesh.parent)
    for joint in (main, *stray):
        parent[joint] = -1 if joint == main else main
    # The root comes first, then the others that are shown.
    order = [joint for joint in parents_first(parent) if shown[joint] and joint != main]
    left_out = [joint for joint in range(len(parent)) if not shown[joint]]
    if left_out:
        notes.append(f"{name_list(mesh, left_out)} move no skin: left out")
    return reorder(replace(mesh, parent=tuple(parent), influence=influence, notes=tuple(notes)), [main, *order])


def name_list(mesh: RiggedMesh, joints: list[int]) -> str:
    """Some joints' names, the first five of many."""
    names = [mesh.joints[joint] for joint in joints]
    return ", ".join(names) if len(names) <= 6 else f"{', '.join(names[:5])} and {len(names) - 5} more"


def _chains_by_name(joints: tuple[str, ...]) -> dict[str, str]:
    """Each joint's parent: the joint before it where both names begin with the same word, else the first joint."""
    words = [re.split(r"[^A-Za-z0-9]", joint)[0] for joint in joints]
    parents = {}
    for (before, name), (last, word) in zip(pairwise(joints), pairwise(words), strict=True):
        parents[name] = before if word == last and before != joints[0] else joints[0]
    if len(set(words)) == len(words):
        raise ValueError("all joints hang side by side; say in a joints file what each hangs on")
    return parents


def chains(parent: tuple[int, ...]) -> list[list[int]]:
    """Joints in chains in which each hangs on the one before; a chain ends where several hang on its last joint.

    The first holds the root. What a chain hangs on is the parent of its first joint.
    """
    children: list[list[int]] = [[] for _ in parent]
    for joint, above in enumerate(parent[1:], 1):
        children[above].append(joint)
    found, waiting = [], [0]
    while waiting:
        chain = [waiting.pop(0)]
        while len(children[chain[-1]]) == 1:
            chain += children[chain[-1]]
        found.append(chain)
        waiting += children[chain[-1]]
    return found


def parts_of(
    joints: tuple[str, ...], parent: tuple[int, ...], sliding: tuple[str, ...] = ()
) -> tuple[tuple[str, ...], tuple[int, ...]]:
    """Names of the steps of a hierarchical search (the root, each chain, long ones in parts) and each joint's step.

    What slides at the end of a chain, as a gripper's fingers, is searched with the joint that carries it: the arm stays
    a limb, on which nothing hangs, and limbs are what the first frame's search draws anew.
    """
    names, part = [joints[0]], np.zeros(len(joints), int)
    for chain in chains(parent):
        chain = [joint for joint in chain if joint]
        carrier = parent[chain[0]] if chain else 0
        if carrier > 0 and chain[-1] not in parent and all(joints[joint] in sliding for joint in chain):
            part[chain] = part[carrier]
            continue
        pieces = -(-len(chain) // _LONGEST_CHAIN)
        for piece in np.array_split(chain, pieces) if pieces else []:
            part[piece] = len(names)
            names.append(joints[piece[0]])
    return tuple(names), tuple(part.tolist())


def mirrored_pairs(mesh: RiggedMesh) -> tuple[Pair, ...]:
    """Joints of a mesh in the body's axes that mirror each other across its plane of symmetry, the left (+X) first.

    They lie mirrored, hang on the same joint or on joints that mirror each other, and their names differ in the side
    and a number alone.
    """
    joints, parent, place = mesh.joints, mesh.parent, mesh.bind[:, :3, 3]
    middle, near = place[0, 0], _MIRRORED * float(np.ptp(place, axis=0).max())
    image = place * (-1, 1, 1) + (2 * middle, 0, 0)
    other: dict[int, int] = {0: 0}
    pairs: list[Pair] = []
    for left in range(1, len(joints)):
        aside = place[left, 0] - middle
        if aside < -near / 2 or left in other or parent[left] not in other:
            continue
        # Left and right may begin at one place in the middle; what is there and has one side is its own image.
        known = ("lr", "rl", "same") if aside > near / 2 else ("lr", "rl")
        candidates = [
            right
            for right in range(1, len(joints))
            if parent[right] == other[parent[left]]
            and right not in (left, *other)
            and np.linalg.norm(image[left] - place[right]) <= near
            and _sides(joints[left], joints[right]) in known
        ]
        if not candidates and aside <= near / 2 and other[parent[left]] == parent[left]:
            other[left] = left
        if candidates:
            right = min(candidates, key=lambda right: float(np.linalg.norm(image[left] - place[right])))
            other |= {left: right, right: left}
            pairs.append((_common_name(joints[left], joints[right]), joints[left], joints[right]))
    names = [name for name, *_ in pairs]
    return tuple((n if names.count(n) == 1 else f"{left}+{right}", left, right) for n, left, right in pairs)


def has_sides(joints: tuple[str, ...]) -> bool:
    """Whether names tell left joints from right ones."""
    return any(_sides(one, other) in ("lr", "rl") for one, other in combinations(joints, 2))


def sides_crossed(pairs: tuple[Pair, ...]) -> bool:
    """Whether names say left of what lies right, more often than not: the body faces the other way."""
    sides = [_sides(left, right) for _, left, right in pairs]
    return sum(side == "rl" for side in sides) > sum(side == "lr" for side in sides)


def _differing_parts(one: str, other: str) -> tuple[str, str, str, str]:
    """The common beginning and the common end of two names, and what is between in each."""
    one, other = (re.sub(r"[_.\-: ]*\d+$", "", joint) or joint for joint in (one, other))  # without a number at the end
    first = [*map(eq, one, other), False].index(False)  # where they begin to differ, and from the end
    last = [*map(eq, one[first:][::-1], other[first:][::-1]), False].index(False)
    return one[:first], one[len(one) - last :], one[first : len(one) - last], other[first : len(other) - last]


def _sides(one: str, other: str) -> str:
    """``lr`` or ``rl`` where two names differ in the side alone, ``same`` where they do not differ, else nothing."""
    *_, mine, others = _differing_parts(one, other)
    left_right = {("l", "r"): "lr", ("lef", "righ"): "lr", ("左", "右"): "lr"}
    sides = left_right | {pair[::-1]: "rl" for pair in left_right} | {("", ""): "same"}
    return sides.get((mine.lower(), others.lower()), "")


def _common_name(one: str, other: str) -> str:
    """What two joints are called together: their name without its side."""
    begin, end, mine, _ = _differing_parts(one, other)
    end = end[1:] if mine.lower() in ("lef", "righ") else end
    return re.sub(r"_+", "_", f"{begin}{end}").strip("_.-: ") or f"{one}+{other}"
