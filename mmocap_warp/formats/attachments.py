"""Things that a body carries, as a scene file's ``[[attach]]`` tables name them."""

import re
from dataclasses import dataclass
from pathlib import Path

from mmocap_warp.errors import InputError
from mmocap_warp.formats.toml_table import Table, quoted, quoted_path, toml_value

FIXED, ALL = "fixed", "all"
_FREE = (FIXED, "x", "y", "z", "xy", "xz", "yz", "xyz", ALL)
_ZERO = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Attachment:
    """A rigid thing, such as a racket."""

    name: str  # of its joint; a valid USD prim name
    mesh: Path  # its file
    joint: str | None = None  # the joint of the body that it hangs on; None where it is free in the world
    # Of the mesh's origin from the centre of that joint or of the root, along the body's axes in the bind pose [m]: to
    # its left, up, ahead.
    position: tuple[float, ...] = _ZERO
    rotation: tuple[float, ...] = _ZERO  # about the body's axes in the bind pose, x first, then y, then z [degrees]
    scale: float = 1.0  # what the mesh's lengths are multiplied by to be metres
    # ``fixed``; the mesh's own axes that it turns about, through its origin, such as ``x``; or ``all``, which lets it
    # turn and shift anywhere.
    free: str = ALL
    source: str = "attach"  # where it is described, for messages

    def wrong(self, problem: str, remedy: str) -> InputError:
        """The error of a thing that cannot be attached."""
        return InputError(self.source, f"'{self.name}': {problem}", remedy)


def take_attachments(file: Table, folder: Path) -> tuple[Attachment, ...]:
    """The ``[[attach]]`` tables of a file, whose paths count from ``folder``."""
    things: dict[str, Attachment] = {}
    for table in file.take_list("attach"):
        thing = _take_attachment(table, folder)
        if thing.name in things:
            raise table.error(f"there are two things named '{thing.name}'", "name each differently")
        things[thing.name] = thing
    return tuple(things.values())


def _take_attachment(table: Table, folder: Path) -> Attachment:
    name = table.take("name", str)
    if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name):
        raise table.error(f"name = {name!r} is no plain name", "use letters, digits and _")
    mesh = table.take_file("mesh", folder)
    joint = table.take("joint", str, None)
    free = table.take_choice("free", _FREE, ALL if joint is None else FIXED)
    if joint is None and free != ALL:
        raise table.error(f'free = "{free}" needs a joint that it hangs on', "add joint = ...")
    scale = table.take("scale", float, 1.0)
    if scale <= 0:
        raise table.error(f"scale = {scale:g} is not positive", "give the mesh's unit in metres, such as 0.001")
    position, rotation = (tuple(table.take_numbers(key, (3,), list(_ZERO))) for key in ("position", "rotation"))
    table.finish()
    return Attachment(name, mesh, joint, position, rotation, scale, free, f"{table.source}: [{table.name}]")


def attachment_lines(things: tuple[Attachment, ...], folder: Path) -> list[str]:
    """The lines of a scene file that say the same, for a file in ``folder``."""
    lines = []
    for thing in things:
        lines += ["", "[[attach]]", f"name = {quoted(thing.name)}", f"mesh = {quoted_path(thing.mesh, folder)}"]
        lines += [f"joint = {quoted(thing.joint)}"] if thing.joint is not None else []
        lines += [f"{key} = {toml_value(getattr(thing, key))}" for key in ("position", "rotation", "scale", "free")]
    return lines
