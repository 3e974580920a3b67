"""By how much a body's stated standard deviations are too large or too small: learnt on made people."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mmocap_warp.body.model import BodyModel
from mmocap_warp.body.skeleton import TRANSLATION, Skeleton
from mmocap_warp.formats.toml_table import load_toml
from mmocap_warp.scenes import ROOT


@dataclass(frozen=True, eq=False)
class DeviationFactors:
    """What stated standard deviations are multiplied by.

    Attributes:
        joint: (joint, 3) of the joints' centres along the body's axes: to its left, up, and ahead.
        angle: (joint, 3) of the joints' angles.
    """

    joint: np.ndarray
    angle: np.ndarray

    @property
    def coordinate(self) -> np.ndarray:
        """(coordinate,) of a pose; one for its translation, which is the root's centre."""
        return np.concatenate([np.ones(TRANSLATION), self.angle.ravel()])


def deviation_factors(body: BodyModel) -> DeviationFactors | None:
    """Those of a shipped body, and of what was fitted from it; None for one that they were not learnt for.

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
    return DeviationFactors(
        *(np.array([(of | as_stated)[name] for name in skeleton.joints], float) for of in (joint, angle))
    )


def factors_toml(skeleton: Skeleton, factors: DeviationFactors, made_with: str) -> str:
    """The text of such a file; ``made_with`` is its first line, a comment."""
    lines = [f"# {made_with}"]
    for name, values, what in (
        ("joint", factors.joint, "of the centres, along the body's axes: to its left, up, ahead"),
        ("angle", factors.angle, "of Rx, Ry, Rz"),
    ):
        lines += ["", f"[{name}] # {what}"]
        lines += [
            f"{joint} = [{', '.join(f'{value:.2f}' for value in of_joint)}]"
            for joint, of_joint in zip(skeleton.joints, values, strict=True)
        ]
    return "\n".join(lines) + "\n"
