"""Bodies that are made, imported, exported, given limits and drawn: ``mmocap body``."""

import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from mmocap_warp.body.joint_sets import parse_joint_set
from mmocap_warp.body.model import BodyModel, BodyMotion, motion_named
from mmocap_warp.body.skeleton import Skeleton
from mmocap_warp.commands.caller import arguments_checked
from mmocap_warp.commands.inputs import result_from
from mmocap_warp.commands.outputs import new_file, releases_locks
from mmocap_warp.display.still_pictures import draw_body
from mmocap_warp.errors import InputError, UsageError, input_errors
from mmocap_warp.formats.exports.glb import write_body_glb
from mmocap_warp.formats.image_files import write_png
from mmocap_warp.formats.rigged.by_blender import read_fbx
from mmocap_warp.formats.rigged.gltf import read_gltf
from mmocap_warp.formats.rigged.mjcf import read_mjcf
from mmocap_warp.formats.rigged.rigged_mesh import RiggedMesh
from mmocap_warp.formats.rigged.urdf import read_urdf
from mmocap_warp.formats.rigged.usd_skel import read_usd_skel
from mmocap_warp.formats.usd.usd_body import read_body, read_motions, write_body
from mmocap_warp.formats.usd.usd_file import USD_SUFFIXES
from mmocap_warp.result.result import STATUS, Result
from mmocap_warp.rigging.importing.imported import Imported, body_from_file, imported
from mmocap_warp.rigging.importing.joints_file import read_joints_file, write_joints_file
from mmocap_warp.rigging.importing.proof import SAME_OUTLINE
from mmocap_warp.rigging.shipped import body_file
from mmocap_warp.rigging.start_poses import learnt
from mmocap_warp.whole_file import read_text


@dataclass(frozen=True, repr=False)
class BodyFile:
    """A body and what was written of it."""

    body: BodyModel  # the body
    file: Path  # what was written: the body, or a picture of it
    motions: dict[str, BodyMotion] = field(default_factory=dict)  # the body's own motions, by name

    def __repr__(self) -> str:
        return f"{self.file}: {len(self.body.skeleton.joints)} joints, {len(self.motions)} motions"


@dataclass(frozen=True, repr=False)
class LearntBody(BodyFile):
    """A body with limits as its joints were seen to turn."""

    before: Skeleton = field(kw_only=True)  # the skeleton with its earlier limits
    frames: int = field(kw_only=True)  # how many poses were seen


@releases_locks
def import_body(
    file: str | Path,
    output: str | Path,
    *,
    up: str | None = None,
    facing: str | None = None,
    scale: float = 1.0,
    triangles: int = 2600,
    skin_triangles: int = 60_000,
    joints: str | Path | None = None,
    write_joints: str | Path | None = None,
    meshes: str | Path | None = None,
    character: str | None = None,
    blender: str = "blender",
    joint_set: str | Path | None = None,
    name: str | None = None,
    attribution: str | None = None,
    force: bool = False,
) -> Imported:
    """Write a body of a rigged character (.glb, .gltf, .vrm, .usd, .usda, .usdc, .usdz, .fbx) or a robot (.urdf, .xml).

    Args:
        file: the character or robot.
        output: the body's file: .usdc, .usda or .usd.
        up: the file's axis that points up, such as +z. [default: what its format says]
        facing: the file's axis along which the body faces. [default: +z of glTF, +x of robots, +z or -y of USD]
        scale: what lengths are multiplied by, besides the unit that the file states.
        triangles: at most, of the mesh that is tracked.
        skin_triangles: at most, of the mesh that is shown.
        joints: a .toml file that says how joints turn; what it leaves out is derived.
        write_joints: write how joints turn to this .toml file, to be edited and given as joints.
        meshes: the folder of a robot's meshes. [default: its file's own]
        character: the name of who is meant, where the file holds several characters.
        blender: Blender's program, which is started without a window to read an .fbx.
        joint_set: a .toml table of further joints, which the body carries under that file's name.
        name: the body's name. [default: the output's name without ending]
        attribution: who made it, and under which licence. [default: what the file says]
        force: replace files that exist, and write a body that the file's own motions contradict.

    Returns:
        The body, its motions, and notes of what was done to it. No body is written where it has a ``fault`` and
        ``force`` is not set. A picture stands beside the body where its tracking mesh differs from the file's skin.

    Raises:
        UsageError: axes, a scale or numbers of triangles that cannot be.
        InputError: no body can be made of the file.
    """
    target = new_file(output, *USD_SUFFIXES, force=force)
    if target.resolve() == Path(file).resolve():
        raise InputError(file, "is the character that is read, of which a body keeps less", "write elsewhere")
    joints_target = None if write_joints is None else new_file(write_joints, ".toml", force=force)
    picture = new_file(target.with_suffix(".outline.png"), ".png", force=force)
    # Read the file, and check what was said of it.
    stated_joints = None if joints is None else read_joints_file(Path(joints))
    mesh = _read_rigged(Path(file), None if meshes is None else Path(meshes), character, blender)
    with arguments_checked():
        body_from_file(up or mesh.up, facing or mesh.facing)
    if not 0 < scale < np.inf or triangles < 4 or skin_triangles < triangles:
        raise UsageError(
            "--scale must be positive, --triangles at least 4, and --skin-triangles no fewer than --triangles; "
            f"got {scale:g}, {triangles} and {skin_triangles}"
        )
    # A body's name must be an identifier.
    identifier = re.sub(r"\W", "_", name or target.stem, flags=re.ASCII)
    identifier = identifier if identifier[:1].isalpha() else f"_{identifier}"
    with input_errors(file, "{error}", "change the file, or say how joints are with --joints", ValueError):
        made = imported(
            mesh, identifier, up=up, facing=facing, scale=scale, joints=stated_joints,
            triangles=triangles, skin_triangles=skin_triangles,
        )  # fmt: skip
    with suppress(InputError):  # another program's file
        if Path(file).suffix.lower() in USD_SUFFIXES and (lost := read_motions(file)):
            left = f"the new body does not have the motions of the one that was read: {', '.join(lost)}"
            made = replace(made, notes=(*made.notes, left))
    if attribution is not None:
        made = replace(made, body=replace(made.body, attribution=attribution))
    if joint_set is not None:
        text = read_text(joint_set, "give a TOML text file")
        parse_joint_set(text, made.body, Path(joint_set))
        made = replace(made, body=replace(made.body, joint_sets={Path(joint_set).stem: text}))
    if joints_target is not None:
        write_joints_file(joints_target, made.body, made.proposed, made.parents)
    if made.fault and not force:
        return made
    made = replace(made, notes=(*made.notes, *([made.fault] if made.fault else [])), fault="")
    write_body(target, made.body, made.motions)
    if made.outline.overlap < SAME_OUTLINE:
        write_png(picture, made.outline.picture)
    return made


def _read_rigged(file: Path, meshes: Path | None, character: str | None, blender: str) -> RiggedMesh:
    readers: dict[str, Callable[[Path], RiggedMesh]] = {
        **dict.fromkeys((".glb", ".gltf", ".vrm"), lambda file: read_gltf(file, character)),
        ".fbx": lambda file: read_fbx(file, character, blender),
        ".urdf": lambda file: read_urdf(file, meshes),
        ".xml": lambda file: read_mjcf(file, meshes, character),
        **dict.fromkeys((*USD_SUFFIXES, ".usdz"), lambda file: read_usd_skel(file, character)),
    }
    if not file.is_file():
        raise InputError(file, "no such file", "check the path")
    kind = file.suffix.lower()
    if kind not in readers:
        raise InputError(file, "is of a kind that is not read", f"give a file that ends in {', '.join(readers)}")
    if (meshes and kind not in (".urdf", ".xml")) or (character and kind == ".urdf"):
        raise UsageError(f"a {kind} file takes no {'--character' if kind == '.urdf' else '--meshes'}")
    return readers[kind](file)


@releases_locks
def export_body(body: str | Path, output: str | Path, *, force: bool = False) -> BodyFile:
    """Write a body in its bind pose as glTF, with its own motions. As USD it is for other programs already.

    Args:
        body: a body's USD file, or a shipped body's name.
        output: the file: .glb.
        force: replace a file that exists.

    Raises:
        InputError: there is no such body, or the file cannot be written.
    """
    target, file = new_file(output, ".glb", force=force), body_file(str(body))
    read, motions = read_body(file), read_motions(file)
    write_body_glb(read, motions, target)
    return BodyFile(read, target, motions)


@releases_locks
def learn_body(
    body: str | Path,
    output: str | Path,
    *,
    motions: Sequence[str] = (),
    results: Sequence[Result | str | Path] = (),
    margin: float = 10.0,
    force: bool = False,
) -> LearntBody:
    """Write a body whose joints turn as far as motions and results show, and no farther.

    Args:
        body: a body's USD file, or a shipped body's name.
        output: the new body's file: .usdc, .usda or .usd.
        motions: some of the body's motions. [default: all, unless results are given]
        results: tracks of the same joints, of which all frames that were not lost count.
        margin: how far limits exceed the angles seen, at either end, in degrees.
        force: replace a file that exists.

    Raises:
        UsageError: a margin that cannot be.
        InputError: there is nothing to learn from, or a result of another body.
    """
    if not 0 <= margin <= 180:
        raise UsageError(f"--margin must be from 0 to 180 degrees, got {margin:g}")
    target, file = new_file(output, *USD_SUFFIXES, force=force), body_file(str(body))
    read, own = read_body(file), read_motions(file)
    # All poses of the motions and results that are wanted.
    poses = [motion_named(name, own, file).pose for name in motions or ([] if results else list(own))]
    poses += [_tracked_poses(result, read.skeleton) for result in results]
    if not poses:
        raise InputError(file, "has no motions", "give a --result to learn from")
    seen = np.concatenate(poses)
    body_learnt = replace(read, skeleton=learnt(read.skeleton, seen, float(np.radians(margin))))
    write_body(target, body_learnt, own)
    return LearntBody(body_learnt, target, own, before=read.skeleton, frames=len(seen))


def _tracked_poses(given: Result | str | Path, skeleton: Skeleton) -> np.ndarray:
    """(frame, coordinate) of a result's best run, where it was not lost."""
    result, path = result_from(given)
    source = path or "result"
    if result.subject.body.skeleton.joints != skeleton.joints:
        raise InputError(source, "has other joints than the body", "give a result of this body")
    lost = np.isin(result.status[result.best_run], [STATUS.index("lost"), STATUS.index("interpolated")])
    poses = result.pose[result.best_run][~lost]
    if not len(poses):
        raise InputError(source, "is lost in all frames", "give another result")
    return poses.astype(float)


@releases_locks
def show_body(body: str | Path, output: str | Path | None = None, *, force: bool = False) -> BodyFile:
    """Draw a body: tracking mesh, joints by name, the axes about which they turn or along which they slide, limits.

    Args:
        body: a body's USD file, or a shipped body's name.
        output: the picture's file, .png. [default: named after the body]
        force: replace a file that exists.

    Raises:
        InputError: there is no such body, or the picture cannot be written.
    """
    file = body_file(str(body))
    picture = new_file(output or Path(file.stem).with_suffix(".png"), ".png", force=force)
    read, motions = read_body(file), read_motions(file)
    draw_body(read, picture)
    return BodyFile(read, picture, motions)
