"""Filling the structs that launchers take: once, where their arrays are allocated, never for a launch."""

from typing import Any, TypeVar

Struct = TypeVar("Struct")


def filled(kind: type[Struct], **fields: Any) -> Struct:
    """A Warp struct with all of its fields; Warp itself leaves out what is not set, and takes names that it lacks.

    Raises:
        ValueError: fields are missing, or there are no such fields.
    """
    known: dict[str, Any] = kind.vars
    if fields.keys() != known.keys():
        raise ValueError(f"{kind.key} has the fields {sorted(known)}, got {sorted(fields)}")
    struct = kind()
    for name, value in fields.items():
        setattr(struct, name, value)
    return struct
