"""A :class:`BodyModel` of a rigged character or robot, with its motions and what was done to get there."""

from dataclasses import dataclass, replace

import numpy as np

from mmocap_warp.body.model import BodyModel, BodyMotion, SkinMesh
from mmocap_warp.body.rotations import applied, axis_vector, continuous_zyx_angles, nearest_rotation, transposed
from mmocap_warp.body.skeleton import TRANSLATION, Pair, Skeleton
from mmocap_warp.cameras.rig import UP_AXES
from mmocap_warp.errors import input_errors
from mmocap_warp.formats.rigged.rigged_mesh import RiggedMesh, RiggedMotion
from mmocap_warp.rigging.decimation import decimate
from mmocap_warp.rigging.importing import closing, joint_tree
from mmocap_warp.rigging.importing.freedom import Freedom, freedom_of, held_as_seen, propose, without_fine_joints
from mmocap_warp.rigging.importing.joints_file import GivenJoints, with_given
from mmocap_warp.rigging.importing.proof import SAME_OUTLINE, Outline, strays, worst_outline
from mmocap_warp.rigging.start_poses import learnt

TRIANGLES = 2600
"""Of a tracking mesh, by default; as many as a shipped person's has."""
SKIN_TRIANGLES = 60_000
"""Of the mesh that is shown, by default: finer skin slows everything that poses it."""

_SPREAD = 0.2  # how far a joint is from the bind pose when a recording starts, as a standard deviation [rad]
_WIDEST_SPREAD = 1.0  # the same of a joint that may begin anywhere, at most [rad]
_LEAST_SHIFT, _WIDEST_SHIFT = 0.001, 1.0  # the same of a joint that slides, at least and at most [m]
_NEGLIGIBLE = 5e-4  # share of a vertex's weight that may be dropped without a note
_PART_TRIANGLES, _PART_CELLS = 500, 16  # a robot's part of more triangles is wrapped, on a grid of so many cells
_SMALLEST, _LARGEST = 0.0005, 100.0  # length of what can be filmed [m]
_LEAST_SKIN = 4  # number of triangles that a closed mesh has at least


@dataclass(frozen=True, eq=False)
class Imported:
    """A body that was made of a file."""

    body: BodyModel
    freedom: list[Freedom]  # of its joints, in their order
    proposed: list[Freedom]  # the same as a joints file proposes it, in the axes of the file's bind pose
    parents: dict[str, str]  # the names of joints that hang on others than in the file, and of those
    motions: dict[str, BodyMotion]  # its animations by name
    notes: tuple[str, ...]  # what was done or left out, a line each
    fault: str  # why the body is not the file's; empty where it is
    outline: Outline  # where its tracking mesh is least like the file's skin


def imported(
    mesh: RiggedMesh,
    name: str,
    *,
    up: str | None = None,
    facing: str | None = None,
    scale: float = 1.0,
    triangles: int = TRIANGLES,
    skin_triangles: int = SKIN_TRIANGLES,
    joints: GivenJoints | None = None,
) -> Imported:
    """A body of what a file holds.

    Args:
        mesh: as the file has it.
        name: the body's, a valid USD prim name.
        up, facing: the file's axes, such as ``+z``; None for those of its format.
        scale: what lengths are multiplied by, besides the file's unit.
        triangles: at most, of the tracking mesh; four at least.
        skin_triangles: at most, of the mesh that is shown.
        joints: what a joints file says in place of what is derived.

    Raises:
        ValueError: axes that cannot be, or joints from which no body can be made.
        InputError: the joints file names what there is not.
    """
    # The mesh in the body's axes, with one tree of named joints and one vertex for each place.
    given = joints or GivenJoints("")
    mesh = in_body_axes(joint_tree.with_named_joints(mesh), up or mesh.up, facing or mesh.facing, scale)
    hung = _parents(mesh)
    with input_errors(given.source, "{error}", "name joints that lead to the root by [joints.NAME] parent", ValueError):
        mesh = joint_tree.with_parents(mesh, given.parents)
    mesh = joint_tree.with_moving_parents(mesh, given.parents)
    mesh = closing.weighted(closing.welded(joint_tree.with_one_root(mesh)))
    if len(mesh.face) < _LEAST_SKIN:
        raise ValueError("the mesh has no triangles of any area")
    pairs = joint_tree.mirrored_pairs(mesh)
    if not pairs and not mesh.rigid and facing is None:
        mesh, pairs = _facing_aside(mesh)
    # How its joints move, and the closed mesh that is tracked.
    mesh = joint_tree.with_usual_bones(mesh, [name for name, joint in given.joints.items() if joint.slides])
    pairs = max(pairs, joint_tree.mirrored_pairs(mesh), key=len)
    freedom, held_notes = without_fine_joints(mesh, freedom_of(mesh, pairs))
    freedom = with_given(freedom, mesh.joints, given)
    proposed, proposals = propose(mesh, pairs, freedom)
    mesh, freedom = held_as_seen(mesh, freedom)
    place = mesh.bind[:, :3, 3]
    skin, tracking_vertex, tracking_face, skin_notes = _skin(mesh, triangles, skin_triangles)
    notes = [*mesh.notes, *_size_note(mesh, scale), *held_notes, *proposals]
    if held := [name for name, how in zip(mesh.joints, freedom, strict=True) if how.slides and not how.free]:
        notes.append(f"{', '.join(held)} slide by too little to be seen, or without limits: held at zero")
    notes += skin_notes
    if not pairs and not mesh.rigid and joint_tree.has_sides(mesh.joints):
        notes.append("names tell left from right, but no joints mirror each other: it may stand askew, or be posed")
    if joint_tree.sides_crossed(pairs):
        notes.append("names say left of what lies to the right: the body may face the other way (--facing)")
    body = BodyModel(
        name=name, skeleton=_skeleton(mesh, pairs, freedom, given.stands), joint_rest=place.astype(np.float32),
        skin=skin, tracking_vertex=tracking_vertex, tracking_face=tracking_face,
        shape_names=(), shape_vertex=np.zeros((0, len(skin.rest), 3), np.float32),
        shape_joint=np.zeros((0, len(place), 3), np.float32),
        marker_names=(), marker_vertex=np.zeros(0, np.int32),
        attribution=mesh.attribution or "The file that it was imported from states no makers and no licence.",
        rigid=mesh.rigid if given.rigid is None else given.rigid,
    )  # fmt: skip
    # The file's animations as poses of that body. A body that stands begins as far from its bind pose as they go.
    motions, apart = {}, {}
    for label, motion in mesh.motions.items():
        motions[label], apart[label] = body_motion(body, mesh.bind, motion)
    if motions and body.skeleton.stands and not body.rigid:
        seen = learnt(body.skeleton, np.concatenate([motion.pose for motion in motions.values()]), 0.0)
        spread = np.clip(seen.spread, body.skeleton.spread, _WIDEST_SPREAD)
        body = replace(body, skeleton=replace(body.skeleton, spread=spread))
    motion_notes, fault = strays(body, mesh, apart)
    outline = worst_outline(body, mesh, motions)
    notes += motion_notes
    if outline.overlap < SAME_OUTLINE:
        notes.append(f"outline {outline.view}: overlaps the file's skin by {outline.overlap:.3f} only")
    parents = {name: above for name, above in _parents(mesh).items() if hung.get(name) != above}
    return Imported(body, freedom, proposed, parents, motions, tuple(notes), fault, outline)


def _facing_aside(mesh: RiggedMesh) -> tuple[RiggedMesh, tuple[Pair, ...]]:
    """The mesh turned by a quarter if that gives it left-right pairs, and those: few files say how they face."""
    for facing in ("+x", "-x"):
        turned = in_body_axes(mesh, mesh.up, facing, 1.0)
        pairs = joint_tree.mirrored_pairs(turned)
        if len(pairs) > 1 and not joint_tree.sides_crossed(pairs):
            return replace(turned, notes=(*mesh.notes, "its left and right show that it faces aside: turned")), pairs
    return mesh, ()


def _parents(mesh: RiggedMesh) -> dict[str, str]:
    """The name of what each joint hangs on, by its own; without roots."""
    return {name: mesh.joints[above] for name, above in zip(mesh.joints, mesh.parent, strict=True) if above >= 0}


def _size_note(mesh: RiggedMesh, scale: float) -> list[str]:
    """A line where the mesh is smaller or larger than what is filmed: many files state no unit, or a wrong one."""
    size = float(np.ptp(mesh.vertex, axis=0).max())
    if _SMALLEST <= size <= _LARGEST:
        return []
    unit, metres = ("centimetres", 0.01) if size > _LARGEST else ("metres", 1000.0)
    return [f"it is {size:.3g} m long: give --scale {metres * scale:g} if its file is in {unit}"]


def _skeleton(mesh: RiggedMesh, pairs: tuple[Pair, ...], freedom: list[Freedom], stands: bool | None) -> Skeleton:
    """The body's skeleton. A robot stands, and so does a body with a left and a right side; a hand does not.

    A body that stands begins near its bind pose. Robots, and bodies that do not stand, begin anywhere in their limits.
    """
    stands = (mesh.rigid or bool(pairs)) if stands is None else stands
    near_bind = stands and not mesh.rigid
    sliding = tuple(name for name, how in zip(mesh.joints, freedom, strict=True) if how.slides)
    parts, part = joint_tree.parts_of(mesh.joints, mesh.parent, sliding)
    angles = [TRANSLATION + 3 * j + "xyz".index(axis) for j, how in enumerate(freedom) for axis in how.free]
    searched = np.array([*(range(TRANSLATION) if freedom[0].free else ()), *angles], np.int32)
    if not len(searched):
        raise ValueError("no joint can move; free one in a joints file")
    return Skeleton(
        joints=mesh.joints, parent=mesh.parent, pairs=pairs, sliding=sliding, stands=stands,
        frame=np.stack([how.frame for how in freedom]).astype(np.float32),
        limits=np.stack([how.limits for how in freedom]).astype(np.float32),
        spread=np.array([_SPREAD, *(_spread(how, near_bind) for how in freedom[1:])]),
        models={len(searched): searched}, parts=parts, part=part,
    )  # fmt: skip


def _spread(freedom: Freedom, near_bind: bool) -> float:
    """How far a joint begins from the bind pose [rad, m]: a little, or anywhere within its widest limits.

    A joint that slides begins anywhere.
    """
    if near_bind and not freedom.slides:
        return _SPREAD
    widths = [np.ptp(np.clip(freedom.limits["xyz".index(axis)], -np.pi, np.pi)) for axis in freedom.free]
    least, most = (_LEAST_SHIFT, _WIDEST_SHIFT) if freedom.slides else (_SPREAD, _WIDEST_SPREAD)
    return float(np.clip(max(widths, default=0.0) / np.sqrt(12), least, most))


def _skin(mesh: RiggedMesh, triangles: int, skin_triangles: int) -> tuple[SkinMesh, np.ndarray, np.ndarray, list[str]]:
    """The full mesh, the tracking mesh's vertices in it and its triangles, and what was done."""
    notes = []
    joint, weight, dropped = closing.four_influences(mesh)
    if dropped > _NEGLIGIBLE:
        notes.append(f"vertices follow at most four joints: up to {100 * dropped:.1f} % of one's weight was dropped")
    # A closed surface; its new vertices follow the joints of a vertex beside them.
    surface = None if mesh.rigid else closing.closed_pieces(mesh.vertex, mesh.face)
    surface = surface or _close_parts(mesh)
    notes += [f"tracking mesh: {surface.done}"] if surface.done else []
    vertex = np.concatenate([mesh.vertex, surface.added])
    beside = np.concatenate([np.arange(len(mesh.vertex)), surface.beside])
    # Skin that is too fine to show is replaced by the closed surface, which is made coarser to be tracked.
    face, shown = surface.face, mesh.face
    too_fine = len(shown) > skin_triangles
    if too_fine and len(face) > skin_triangles:
        kept, coarser = decimate(vertex, face, skin_triangles)
        face = kept[coarser]
    if too_fine:
        notes.append(f"skin: {len(shown)} triangles are too many to show; {len(face)} of the closed mesh stand in")
        shown = face
    if len(face) > triangles:
        kept, coarser = decimate(vertex, face, triangles)
        face = kept[coarser]
        notes.append(f"tracking mesh: {len(surface.face)} triangles made {len(face)}")
    # The full mesh has the vertices of both.
    kept = np.unique(face)
    chosen = np.union1d(shown if too_fine else np.arange(len(mesh.vertex)), kept)
    chosen_face, follows = np.searchsorted(chosen, shown).astype(np.int32), beside[chosen]
    skin = SkinMesh(vertex[chosen].astype(np.float32), chosen_face, joint[follows], weight[follows])
    return skin, np.searchsorted(chosen, kept).astype(np.int32), np.searchsorted(kept, face).astype(np.int32), notes


def _close_parts(mesh: RiggedMesh) -> closing.ClosedMesh:
    """What follows each joint closed by itself: a robot's parts are hollow, and meet in joints."""
    follows = mesh.influence[mesh.face[:, 0], mesh.weight[mesh.face[:, 0]].argmax(axis=1)]
    names = np.unique(follows)
    made = [closing.closed(mesh.vertex, mesh.face[follows == joint], _PART_TRIANGLES, _PART_CELLS) for joint in names]
    changed = [joint for joint, part in zip(names, made, strict=True) if part.done]
    done = f"parts closed or wrapped in new surfaces: {joint_tree.name_list(mesh, changed)}" if changed else ""
    return closing.joined_meshes(made, len(mesh.vertex), done)


def body_motion(body: BodyModel, bind: np.ndarray, motion: RiggedMotion) -> tuple[BodyMotion, np.ndarray]:
    """Poses of a body whose joints turn and slide as a file's do, and (frame, joint) their distances from those [m].

    All three coordinates of every joint are taken, whether they are searched or not. Bones keep their lengths but for
    joints that slide; a file's may change. The motion is in the body's axes and metres, and ``bind`` (joint, 4, 4) is
    the body's space from the file's joints in the bind pose.
    """
    skeleton = body.skeleton
    frame, rest = skeleton.frame.astype(np.float64), body.joint_rest.astype(np.float64)
    turned = motion.world[..., :3, :3] @ transposed(bind[:, :3, :3])  # from the bind pose, in the body's axes
    frames, free = len(turned), np.tile([-np.inf, np.inf], (3, 1))
    pose = np.zeros((frames, skeleton.coordinates))
    pose[:, :3] = motion.world[:, 0, :3, 3]
    place = np.zeros((frames, len(rest), 3))
    for joint, parent in enumerate(skeleton.parent):
        above = np.eye(3) if parent < 0 else turned[:, parent]
        coordinates = skeleton.angles(skeleton.joints[joint])
        place[:, joint] = pose[:, :3] if parent < 0 else place[:, parent] + above @ (rest[joint] - rest[parent])
        if skeleton.slides[joint]:
            held, shift = above @ frame[joint], motion.world[:, joint, :3, 3] - place[:, joint]
            pose[:, coordinates] = applied(transposed(held), shift)
            place[:, joint] += shift
            turned[:, joint] = above
            continue
        own = frame[joint].T @ np.swapaxes(above, -1, -2) @ turned[:, joint] @ frame[joint]
        pose[:, coordinates] = continuous_zyx_angles(own, free)
    return BodyMotion(motion.fps, pose), np.linalg.norm(place - motion.world[:, :, :3, 3], axis=2)


def body_from_file(up: str, facing: str) -> np.ndarray:
    """(3, 3) rotation from a file's axes into a body's; a ValueError for axes that cannot be."""
    for name, axis in (("up", up), ("facing", facing)):
        if axis not in UP_AXES:
            raise ValueError(f"{name} must be one of {', '.join(UP_AXES)}, got {axis!r}")
    if up[1] == facing[1]:
        raise ValueError(f"facing must be across up, got facing {facing} and up {up}")
    upward, ahead = axis_vector(up) + 0.0, axis_vector(facing) + 0.0  # 0.0 makes zeros of negative zeros
    return np.stack([np.cross(upward, ahead), upward, ahead])


def in_body_axes(mesh: RiggedMesh, up: str, facing: str, scale: float) -> RiggedMesh:
    """The mesh in metres times ``scale``, +Y up and facing +Z; bind transforms and motions lose their own scale.

    The file's axes ``up`` and ``facing`` count instead of its format's. Raises a ValueError for axes that cannot be.
    """
    turn, size = body_from_file(up, facing), scale * mesh.metres
    axes = {}
    for joint, how in mesh.axes.items():
        longer = size if how.slides else 1.0
        axes[joint] = replace(how, axis=turn @ how.axis, lower=longer * how.lower, upper=longer * how.upper)

    def moved(transform: np.ndarray) -> np.ndarray:
        result = np.zeros_like(transform)
        result[..., :3, :3] = turn @ nearest_rotation(transform[..., :3, :3])
        result[..., :3, 3], result[..., 3, 3] = size * transform[..., :3, 3] @ turn.T, 1.0
        return result

    return replace(
        mesh,
        bind=moved(mesh.bind),
        vertex=size * mesh.vertex @ turn.T,
        axes=axes,
        motions={name: RiggedMotion(motion.fps, moved(motion.world)) for name, motion in mesh.motions.items()},
        up="+y",
        facing="+z",
        metres=1.0,
    )
