"""The coordinates of a fit: a full pose, shape sliders, scale and heading in one vector."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mmocap_warp.body.model import BodyModel, Subject
from mmocap_warp.body.rotations import axis_vector, turn


def upright_base(up: str) -> np.ndarray:
    """(3, 3) rotation, world from body axes, that stands a body up along ``up`` (such as ``+z``), heading anywhere."""
    y, z = axis_vector(up), np.eye(3)[("xyz".index(up[1]) + 1) % 3]
    return np.stack([np.cross(y, z), y, z], axis=1)


def heading_rotation(heading: float) -> np.ndarray:
    """(3, 3) turn about the body's up axis [rad]."""
    return turn("y", heading)


def paired_targets(names: tuple[str, ...]) -> tuple[tuple[str, str, str | None], ...]:
    """Sliders of shape targets: per slider its name and its targets on the positive and the negative side."""
    found: list[tuple[str, str, str | None]] = []
    for name in names:
        stem = name.removesuffix("_incr")
        if name.endswith("_incr"):
            found.append((stem, name, f"{stem}_decr" if f"{stem}_decr" in names else None))
        elif not (name.endswith("_decr") and f"{name.removesuffix('_decr')}_incr" in names):
            found.append((name, name, None))
    return tuple(found)


@dataclass(frozen=True)
class ShapeSpace:
    """Coordinates ``pose, sliders, log(scale), heading`` of a body standing along ``up``.

    A slider pairs ``<name>_incr`` (positive values) with ``<name>_decr`` (negative ones); any other target is a
    slider of its own that has no negative side.
    """

    body: BodyModel  # the body at all sliders zero
    up: str  # the world's up axis

    @cached_property
    def sliders(self) -> tuple[tuple[str, str, str | None], ...]:
        """Per slider its name and its targets on the positive and the negative side."""
        return paired_targets(self.body.shape_names)

    def __len__(self) -> int:
        return self.body.skeleton.coordinates + len(self.sliders) + 2

    @property
    def slider_index(self) -> np.ndarray:
        """(slider,) positions of the sliders."""
        return self.body.skeleton.coordinates + np.arange(len(self.sliders))

    @property
    def scale_index(self) -> int:
        """Position of the logarithm of the scale."""
        return self.body.skeleton.coordinates + len(self.sliders)

    @property
    def shape_index(self) -> np.ndarray:
        """(parameter,) positions of what shapes the body; none of a rigid one."""
        return np.array([], int) if self.body.rigid else np.append(self.slider_index, self.scale_index)

    @property
    def heading_index(self) -> int:
        """Position of the heading [rad]."""
        return self.body.skeleton.coordinates + len(self.sliders) + 1

    def displacements(self, of: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of each slider at +1 and at -1, from per-target displacements (target, point, 3)."""
        moved = np.concatenate([of, np.zeros((1, *of.shape[1:]), of.dtype)])  # the last is of a side that has no target
        number: dict[str | None, int] = {name: i for i, name in enumerate(self.body.shape_names)}
        increase, decrease = (moved[[number.get(slider[side], -1) for slider in self.sliders]] for side in (1, 2))
        return increase, decrease

    def limits(self, pose_limits: np.ndarray) -> np.ndarray:
        """(coordinate, 2): the pose's limits, sliders to 1.5 times their targets, scale between 0.5 and 1.6."""
        one_sided = np.array([negative is None for _, _, negative in self.sliders], bool)
        sliders = np.stack([np.where(one_sided, 0.0, -1.5), np.full(len(one_sided), 1.5)], axis=1)
        return np.concatenate([pose_limits, sliders, np.log([[0.5, 1.6]]), [[-np.inf, np.inf]]])

    def subject(self, coordinate: np.ndarray, provenance: dict[str, str | float | int]) -> Subject:
        """The fitted body, base and pose of one coordinate vector."""
        weights: dict[str, float] = {}
        values = coordinate[self.slider_index]
        for (_, positive, negative), value in zip(self.sliders, values, strict=True):
            target = positive if value > 0 else negative
            if target is not None and value != 0:
                weights[target] = abs(float(value))
        scale = float(np.exp(coordinate[self.scale_index]))
        shape = {f"shape.{name}": float(v) for (name, _, _), v in zip(self.sliders, values, strict=True)}
        base = upright_base(self.up) @ heading_rotation(float(coordinate[self.heading_index]))
        pose = np.asarray(coordinate[: self.body.skeleton.coordinates], np.float64)
        return Subject(self.body.shaped(weights, scale), base, pose, provenance | shape | {"scale": scale})
