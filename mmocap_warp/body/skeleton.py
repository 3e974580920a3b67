"""A joint tree with its degrees of freedom: of a person, an animal, a robot; it belongs to a body and its USD file."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

TRANSLATION = 3
"""A pose begins with the root's place; three angles a joint follow."""

ROOT_ANGLES = slice(TRANSLATION, TRANSLATION + 3)
"""Where the root's angles stand in a pose."""

Pair = tuple[str, str, str]
"""What both are called together, such as ``wrists``; the left joint; the right joint."""


def coordinate_names(joints: tuple[str, ...], sliding: tuple[str, ...] = ()) -> tuple[str, ...]:
    """Names of a pose's values: ``Tx``, ``Ty``, ``Tz``, then ``<joint>.Rx`` ..., or ``<joint>.Tx`` ... if it slides."""
    own = (f"{joint}.{'T' if joint in sliding else 'R'}{axis}" for joint in joints for axis in "xyz")
    return ("Tx", "Ty", "Tz", *own)


@dataclass(frozen=True, eq=False)
class Skeleton:
    """Joints, the axes they turn about, and which of their angles are searched.

    A **pose** holds ``Tx Ty Tz`` [m], then ``Rx Ry Rz`` [rad] of each joint, in the joints' order: its **coordinates**.
    The first joint is the root and sits at the translation. Joint ``j`` turns by ``Rz @ Ry @ Rx`` (x first) about the
    axes in the columns of its frame. A hinge is a joint of which one angle alone is searched; its frame is chosen so
    that this is the angle about one of the axes. What a model does not search is held.

    A **sliding** joint does not turn: its three coordinates are by how much it is shifted along its axes [m]. Together
    with a joint that turns it holds what is free in space. Raises a ValueError where what is said of a field does not
    hold.
    """

    joints: tuple[str, ...]  # names, valid as USD prim names, all different
    parent: tuple[int, ...]  # (joint,) number of each joint's parent; parents come first, the root's is -1
    frame: np.ndarray  # (joint, 3, 3) float32, columns are the joint's axes in body space
    limits: np.ndarray  # (joint, axis, 2) float32, lowest and highest angle from the zero pose [rad]; infinite if free
    # (joint,) float64, how far the angles usually are from the zero pose when a recording starts, as a standard
    # deviation [rad].
    spread: np.ndarray
    # Searched coordinates (dof,) int32, ascending, of each model, by how many of them are the body's own, those of
    # attached joints left out; the first is the default.
    models: dict[int, np.ndarray]
    parts: tuple[str, ...]  # names of the steps of a hierarchical search, in their order
    part: tuple[int, ...]  # (joint,) the step that searches each joint; the root's also searches the translation
    pairs: tuple[Pair, ...] = ()  # joints that mirror each other; errors are taken over them where there are any
    sliding: tuple[str, ...] = ()  # names of the joints that slide; their limits and spread are lengths [m]
    # Names of joints that are no part of the body but carry a rigid thing of known size, such as a racket. None but
    # attached joints hang on them.
    attached: tuple[str, ...] = ()
    stands: bool = True  # whether the body's +Y points up, about, when a recording starts; a hand's points anywhere

    def __post_init__(self) -> None:
        count = len(self.joints)
        if not count or len(set(self.joints)) < count:
            raise ValueError(f"joints must be named, each differently, got {list(self.joints)}")
        is_tree = self.parent[:1] == (-1,) and all(0 <= p < j for j, p in enumerate(self.parent) if j)
        if len(self.parent) != count or not is_tree:
            raise ValueError(f"parent must start with -1 and name earlier joints after that, got {list(self.parent)}")
        for name, shape in (("frame", (count, 3, 3)), ("limits", (count, 3, 2)), ("spread", (count,))):
            if getattr(self, name).shape != shape:
                raise ValueError(f"{name} must be {shape}, got {getattr(self, name).shape}")
        if not np.all(self.limits[..., 0] <= self.limits[..., 1]):
            raise ValueError("limits must not have a lower limit above the upper one")
        if not np.all((self.spread > 0) & np.isfinite(self.spread)):
            raise ValueError("spread must be positive and finite")
        self._check_choices()

    def _check_choices(self) -> None:
        """What is searched, in which steps, and what mirrors what."""
        if not self.models:
            raise ValueError("models must name at least one set of coordinates to search")
        is_own = np.repeat([True, *~self.is_attached], 3)  # the translation is the body's own
        for number, index in self.models.items():
            ascends = len(index) > 0 and bool(np.all(np.diff(index) > 0))
            if not ascends or index[0] < 0 or index[-1] >= self.coordinates or is_own[index].sum() != number:
                last = self.coordinates - 1
                raise ValueError(f"models: {number} must be that many coordinates of 0 .. {last}, ascending")
        if len(self.part) != len(self.joints) or set(self.part) != set(range(len(self.parts))):
            raise ValueError(f"part must give each joint one of the {len(self.parts)} parts, and each part a joint")
        for name in ("sliding", "attached"):
            if not set(getattr(self, name)) <= set(self.joints):
                raise ValueError(f"{name} must be joints of this skeleton, got {list(getattr(self, name))}")
        if self.joints[0] in self.sliding or any(
            self.joints[parent] in self.attached and joint not in self.attached
            for joint, parent in zip(self.joints[1:], self.parent[1:], strict=True)
        ):
            raise ValueError("the root must not slide, and no joint of the body hang on an attached one")
        sides = [joint for _, *pair in self.pairs for joint in pair]
        if len(set(sides)) < len(sides) or not set(sides) <= set(self.joints):
            raise ValueError(f"pairs must be of different joints of this skeleton, got {list(self.pairs)}")

    @property
    def coordinates(self) -> int:
        """Length of a pose."""
        return TRANSLATION + 3 * len(self.joints)

    @cached_property
    def root_is_fixed(self) -> bool:
        """Whether the root stands still, as the base of a robot arm: the default model searches nothing of it."""
        return bool((self.searched() >= ROOT_ANGLES.stop).all())

    def with_free_root(self) -> Self:
        """The same joints, with one model: the default one's coordinates, and all of the root's."""
        searched = np.union1d(np.arange(ROOT_ANGLES.stop), self.searched()).astype(np.int32)
        limits = self.limits.copy()
        limits[0] = -np.inf, np.inf
        return replace(self, limits=limits, models={len(searched): searched})

    @cached_property
    def coordinate_names(self) -> tuple[str, ...]:
        """See :func:`coordinate_names`."""
        return coordinate_names(self.joints, self.sliding)

    @cached_property
    def slides(self) -> np.ndarray:
        """(joint,) bool, whether each slides."""
        return np.isin(self.joints, self.sliding)

    @cached_property
    def is_length(self) -> np.ndarray:
        """(coordinate,) bool, whether each is a length [m], not an angle [rad]."""
        return np.repeat([True, *self.slides], 3)

    def units(self, length: float) -> np.ndarray:
        """(coordinate,) the unit of each, where that of lengths is ``length`` [m] and that of angles a radian."""
        return np.asarray(np.where(self.is_length, length, 1.0))

    def in_unit(self, unit: float) -> Self:
        """The skeleton with what its sliding joints may do in a unit [m]."""
        by = np.where(self.slides, np.float32(unit), np.float32(1))
        return replace(self, limits=self.limits / by[:, None, None], spread=self.spread / by)

    @cached_property
    def is_attached(self) -> np.ndarray:
        """(joint,) bool, whether each is attached."""
        return np.isin(self.joints, self.attached)

    @cached_property
    def carrier(self) -> np.ndarray:
        """(joint,) int, the body's joint on which each attached joint hangs; of the body's own joints, itself."""
        carrier: list[int] = []
        for joint, parent in enumerate(self.parent):
            carrier.append(carrier[parent] if self.is_attached[joint] else joint)
        return np.array(carrier)

    @cached_property
    def coordinate_limits(self) -> np.ndarray:
        """(coordinate, 2) float64, lowest and highest value; the translation is free."""
        free = np.tile([-np.inf, np.inf], (TRANSLATION, 1))
        return np.concatenate([free, self.limits.reshape(-1, 2).astype(float)])

    @cached_property
    def bones(self) -> tuple[tuple[int, int], ...]:
        """Bones of a fixed length, as the numbers of the upper and the lower joint; sliding joints have none."""
        pairs = zip(self.parent, range(len(self.parent)), self.slides, strict=True)
        return tuple((parent, joint) for parent, joint, slides in pairs if parent >= 0 and not slides)

    @cached_property
    def depth(self) -> np.ndarray:
        """(joint,) int, how many joints lie above each."""
        return self.below.sum(axis=0) - 1

    @cached_property
    def below(self) -> np.ndarray:
        """(joint, joint) bool, whether the second is the first or hangs on it."""
        below = np.eye(len(self.parent), dtype=bool)
        for joint, parent in enumerate(self.parent[1:], 1):
            below[:, joint] |= below[:, parent]
        return below

    @cached_property
    def evaluation_groups(self) -> dict[str, tuple[str, ...]]:
        """Groups of joints whose errors are evaluated: the pairs, or each joint alone where there are no pairs.

        Of a person these are the joints that every source of truth defines alike. Attached joints are none of them.
        """
        own = [name for name in self.joints if name not in self.attached]
        return {name: (left, right) for name, left, right in self.pairs} or {name: (name,) for name in own}

    @cached_property
    def ends(self) -> tuple[str, ...]:
        """Evaluated joints that no other joint of the body hangs on, such as wrists and ankles."""
        above = {parent for joint, parent in enumerate(self.parent) if not self.is_attached[joint]}
        return tuple(
            name for group in self.evaluation_groups.values() for name in group if self.joints.index(name) not in above
        )

    def index(self, joint: str) -> int:
        """Number of a joint; a ValueError if none has that name."""
        if joint not in self.joints:
            raise ValueError(f"joint must be one of {list(self.joints)}, got {joint!r}")
        return self.joints.index(joint)

    def angles(self, joint: str) -> slice:
        """Where a joint's three angles stand in a pose."""
        first = TRANSLATION + 3 * self.index(joint)
        return slice(first, first + 3)

    def side(self, joint: str) -> str:
        """``left``, ``right``, or ``middle`` for a joint that has no mirror image, in the skeleton's pairs."""
        sides = {name: side for _, *pair in self.pairs for name, side in zip(pair, ("left", "right"), strict=True)}
        return sides.get(joint, "middle")

    def searched(self, model: int | None = None) -> np.ndarray:
        """Coordinates that a model searches, (dof,) int32, ascending.

        A model is known by its number of degrees of freedom; it is the default one where omitted. Raises a ValueError
        for no such model.
        """
        number = self.model_number(model)
        if number not in self.models:
            raise ValueError(f"dof must be one of {list(self.models)}, got {model}")
        return self.models[number]

    def searched_angles(self, model: int | None = None) -> np.ndarray:
        """The angles that a model searches, without the root's: (angle,) int32, ascending."""
        searched = self.searched(model)
        return searched[(searched >= ROOT_ANGLES.stop) & ~self.is_length[searched]]

    def searched_shifts(self, model: int | None = None) -> np.ndarray:
        """The shifts of the body's own joints that a model searches: (shift,) int32, ascending."""
        searched = self.searched(model)
        joint = np.maximum((searched - TRANSLATION) // 3, 0)
        return searched[self.slides[joint] & ~self.is_attached[joint]]

    def model_number(self, model: int | None = None) -> int:
        """The number of a model, the default one where omitted."""
        return next(iter(self.models)) if model is None else model

    def searched_by_part(self, model: int | None = None) -> dict[str, np.ndarray]:
        """A model's searched coordinates by part, in order, without empty parts; a ValueError for no such model."""
        index = self.searched(model)
        part = np.asarray(self.part)[np.maximum((index - TRANSLATION) // 3, 0)]  # the translation goes with the root
        return {name: index[part == i] for i, name in enumerate(self.parts) if (part == i).any()}

    def moved_by(self, index: np.ndarray) -> np.ndarray:
        """(joint,) bool: the joints whose transforms change with coordinates ``index`` of a pose."""
        turned = np.maximum((np.asarray(index) - TRANSLATION) // 3, 0)  # the translation moves what the root moves
        return np.asarray(self.below[turned].any(axis=0))
