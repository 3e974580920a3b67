"""How joints move, as a short TOML file that people edit: written from what was found, read in its place."""

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from mmocap_warp.body.model import BodyModel
from mmocap_warp.errors import InputError, input_errors
from mmocap_warp.formats.toml_table import Table, load_toml, quoted, quoted_key
from mmocap_warp.rigging.importing.freedom import Freedom, hinge_frame
from mmocap_warp.whole_file import write_whole

_ABOUT = """\
# How the joints of {name} move. Read it with `mmocap body import --joints`; what is left out stays as it is derived.
# free: axes that are searched, of the joint's own frame: a hinge turns about x, else y runs along the bone.
# x, y, z: lowest and highest angle from the bind pose, in degrees; of a joint that slides, its shift in metres.
# slides = true: the joint slides along its axes instead of turning about them.
# Also: hinge = [1, 0, 0], the axis x of a joint in the body's axes (+X its left, +Y up, +Z ahead);
# parent = "name", what the joint hangs on. At the top: root = "fixed" for a base that stands still;
# rigid = true where bones' lengths, girths and scale are known, as a robot's are; stands = false where the body's +Y
# may point anywhere, as a hand's.
"""
_FREE = ("", "x", "y", "z", "xy", "xz", "yz", "xyz")


@dataclass(frozen=True, eq=False)
class GivenJoint:
    """What a joints file says of a joint; None where it says nothing."""

    free: str | None  # axes that are searched
    hinge: np.ndarray | None  # (3,) the axis x, in the body's axes
    limits: dict[str, tuple[float, float]]  # (axis, (lowest, highest)) [degrees; m of what slides]
    parent: str | None  # the joint that it hangs on
    slides: bool | None  # whether it slides instead of turning


@dataclass(frozen=True, eq=False)
class GivenJoints:
    """A joints file."""

    source: str  # the file, for errors
    fixed_root: bool | None = None  # whether the root stands still; None where the file is silent
    rigid: bool | None = None  # whether the body's shape is known; None where the file is silent
    stands: bool | None = None  # whether the body's +Y points up; None where the file is silent
    joints: dict[str, GivenJoint] = field(default_factory=dict)  # by name

    @property
    def parents(self) -> dict[str, str]:
        """The names of parents that the file gives, by joint."""
        return {name: joint.parent for name, joint in self.joints.items() if joint.parent is not None}


def read_joints_file(path: str | Path) -> GivenJoints:
    """Read a joints file."""
    table = load_toml(path)
    root = table.take_choice("root", ("free", "fixed"), None)
    rigid, stands = (table.take(key, bool, None) for key in ("rigid", "stands"))
    joints = {name: _read_joint(entry) for name, entry in table.take_tables_of("joints").items()}
    table.finish()
    return GivenJoints(str(path), None if root is None else root == "fixed", rigid, stands, joints)


def _read_joint(entry: Table) -> GivenJoint:
    free = entry.take_choice("free", _FREE, None)
    hinge = np.array(entry.take_numbers("hinge", (3,))) if entry.has("hinge") else None
    if hinge is not None and not hinge.any():
        remedy = "give the axis that the joint turns about or slides along"
        raise entry.error("hinge = [0, 0, 0] is no direction", remedy)
    limits = {}
    for axis in "xyz":
        if entry.has(axis):
            low, high = entry.take_numbers(axis, (2,))
            if low > high:
                raise entry.error(f"{axis} = [{low:g}, {high:g}] is upside down", "give the lower limit first")
            limits[axis] = (float(low), float(high))
    parent, slides = entry.take("parent", str, None), entry.take("slides", bool, None)
    entry.finish()
    return GivenJoint(free, hinge, limits, parent, slides)


def with_given(freedom: list[Freedom], joints: tuple[str, ...], given: GivenJoints) -> list[Freedom]:
    """The freedom of joints, as changed by a file; an InputError for no such joint, or a slide without limits."""
    freedoms = list(freedom)
    for name, joint in given.joints.items():
        if name not in joints:
            known = ", ".join(joints[:8]) + (" ..." if len(joints) > 8 else "")
            raise InputError(given.source, f"there is no joint '{name}'", f"name one of {known}")
        with input_errors(given.source, f"joint '{name}' {{error}}", "give its limits, in metres", ValueError):
            freedoms[joints.index(name)] = _with_given_joint(freedom[joints.index(name)], joint)
    if given.fixed_root is not None:
        freedoms[0] = replace(freedoms[0], free="" if given.fixed_root else "xyz", origin="given")
    return freedoms


def _with_given_joint(freedom: Freedom, joint: GivenJoint) -> Freedom:
    frame = freedom.frame if joint.hinge is None else hinge_frame(joint.hinge, freedom.frame[:, 1])
    free = freedom.free if joint.free is None else joint.free
    slides = freedom.slides if joint.slides is None else joint.slides
    as_it_was = slides == freedom.slides
    limits = freedom.limits.copy() if as_it_was else np.zeros((3, 2))
    for axis, between in joint.limits.items():
        limits["xyz".index(axis)] = between if slides else np.radians(between)
    for axis in free:
        if axis in joint.limits or (as_it_was and axis in freedom.free):
            continue
        if not slides:  # an axis that was held has no limits of its own
            limits["xyz".index(axis)] = (-np.pi / 2, np.pi / 2)
        elif not 0 < np.ptp(limits["xyz".index(axis)]) < np.inf:
            raise ValueError(f"slides along {axis} without limits")
    return Freedom(frame, free, limits, "given", slides)


def write_joints_file(path: str | Path, body: BodyModel, freedom: list[Freedom], parents: dict[str, str]) -> None:
    """Write how joints move, and what some hang on by their names, to be edited."""
    root = "free" if freedom[0].free else "fixed"
    rigid, stands = str(body.rigid).lower(), str(body.skeleton.stands).lower()
    lines = [_ABOUT.format(name=body.name), f'root = "{root}"\nrigid = {rigid}\nstands = {stands}\n']
    for joint, how in list(zip(body.skeleton.joints, freedom, strict=True))[1:]:
        lines.append(f'\n[joints.{quoted_key(joint)}]  # {how.origin}\nfree = "{how.free}"\n')
        if joint in parents:
            lines.append(f"parent = {quoted(parents[joint])}\n")
        if how.slides:
            lines.append("slides = true\n")
        if how.slides or how.origin[:5] in ("given", "hinge"):  # an axis that cannot be derived from bones
            along = ", ".join(f"{value:.6g}" for value in how.frame[:, 0].round(6) + 0.0)
            lines.append(f"hinge = [{along}]\n")
        for axis in "xyz" if how.slides else how.free:  # with a slider's held axis, for those who free it
            low, high = how.limits["xyz".index(axis)] if how.slides else np.degrees(how.limits["xyz".index(axis)])
            if np.isfinite([low, high]).all() and (axis in how.free or low < high):
                lines.append(f"{axis} = [{low:.4g}, {high:.4g}]\n")
    write_whole(Path(path), "".join(lines).encode())
