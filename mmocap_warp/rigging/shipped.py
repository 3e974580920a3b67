"""Bodies by name: those that ship with the package, or a file of one's own; and how sure a shipped one's fits are.

By how much a body's stated standard deviations are too large or too small was learned on made people.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mmocap_warp.body.model import BodyModel
from mmocap_warp.body.skeleton import TRANSLATION
from mmocap_warp.errors import InputError
from mmocap_warp.formats.sandbox import trust
from mmocap_warp.formats.toml_table import load_toml
from mmocap_warp.scenes import ROOT

_FOLDERS = ("bodies", "characters")  # folders of people, and of other bodies
_LEARNT_DEPARTURE = 2.0  # of the people that factors were learnt on, at most

DEFAULT_BODY = "adult_man"
"""Where a fit starts if nobody says."""


def load_body(name: str | Path, source: object = "body") -> BodyModel:
    """A body by the name of a shipped one, such as ``adult_man``, or by the path of its USD file.

    Args:
        name: a name without an ending, or a path with one.
        source: where the name stands, for messages.

    Raises:
        InputError: no such body, or a file that holds none.
    """
    from mmocap_warp.formats.usd.usd_body import read_body  # USD takes a quarter of the start of what needs none

    file = body_file(name, source)
    if file.is_relative_to(ROOT):
        trust(file)  # it is as much part of the program as its code
    return read_body(file)


def body_file(name: str | Path, source: object = "body") -> Path:
    """The file of a body, by name or path as :func:`load_body` takes it."""
    if Path(name).suffix:
        return Path(name)
    shipped = [file for folder in _FOLDERS for file in sorted((ROOT / folder).glob("*.usdc"))]
    match = next((file for file in shipped if file.stem == str(name)), None)
    if match is None:
        known = ", ".join(file.stem for file in shipped)
        raise InputError(source, f"there is no body '{name}'", f"name a USD file, or one of {known}")
    return match


@dataclass(frozen=True, eq=False)
class DeviationFactors:
    """Factors of stated standard deviations."""

    joint: np.ndarray  # (joint, 3) of the joints' centres along the body's axes: to its left, up, and ahead
    angle: np.ndarray  # (joint, 3) of the joints' angles

    @property
    def coordinate(self) -> np.ndarray:
        """(coordinate,) the factors of a pose; 1 for its translation, which is the root's centre."""
        return np.concatenate([np.ones(TRANSLATION), self.angle.ravel()])


def deviation_factors(body: BodyModel, departure: float = 1.0) -> DeviationFactors | None:
    """The factors of a shipped body, and of bodies that were fitted from it; None where none were learned.

    The people that they were learnt on depart from the family by twice its standard deviations at most. Of a body with
    a larger ``departure`` they say less, and are the nearer to one.

    They stand beside the shipped bodies, in ``<name>.deviations.toml``, which says what it was made with.
    """
    path = ROOT / "bodies" / f"{body.name}.deviations.toml"
    if not path.is_file():
        return None
    table = load_toml(path)
    joint, angle = (table.take(name, dict) for name in ("joint", "angle"))
    skeleton = body.skeleton
    if set(joint) != set(skeleton.joints) - set(skeleton.attached) or set(angle) != set(joint):
        return None  # another body of that name
    as_stated = {name: [1.0, 1.0, 1.0] for name in skeleton.attached}  # of what is attached nothing was learnt
    factors = ([(of | as_stated)[name] for name in skeleton.joints] for of in (joint, angle))
    known = min(1.0, _LEARNT_DEPARTURE / departure)
    return DeviationFactors(*(np.array(each, float) ** known for each in factors))
