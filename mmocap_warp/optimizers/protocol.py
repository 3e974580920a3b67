"""What an optimizer is, to the search that drives it."""

from __future__ import annotations

from typing import Any, Protocol

import warp as wp

from mmocap_warp.kernels.optimizers.populations import SearchSpace


class Optimizer(Protocol):
    """Minimises a batched cost over a batch of independent runs; all of its state lives on the device.

    It is made for the budget of a whole search. Before the first search, ``plan`` gives it its share of the budget and
    returns the sizes of the generations. ``start`` begins a search. Then, for each size, ``ask(size)`` fills the first
    ``size`` particles of ``population``, the caller computes their costs (candidate = run * size + particle), and
    ``tell`` learns from them. A generation smaller than ``particles`` only spends the rest of the budget: ``tell`` is
    not called for it.

    Nothing that changes from one generation to the next is a number on the host. So a captured graph of a generation
    can be replayed.

    Attributes:
        space: its runs, what they search and how far, and their random streams.
        particles: size of a whole generation.
        population: (run, particle, dof) float32, the candidates.
        returns_best: whether the answer is the best candidate ever, which the caller keeps; otherwise it is the
            optimizer's own ``estimate``.
    """

    space: SearchSpace
    particles: int
    population: wp.array[wp.float32]
    returns_best: bool

    @property
    def memory(self) -> tuple[wp.array[Any], ...]:
        """Arrays, the run first, by which a search depends on the one before it; zeros before there was one."""

    def plan(self, evaluations: int) -> list[int]:
        """Take over the budget of every search from now on.

        Returns:
            Sizes of the generations that spend it; they never add up to more.
        """

    def start(self, pose: wp.array[wp.float32]) -> None:
        """Begin a search at ``pose`` (run, coordinate)."""

    def ask(self, particles: int) -> wp.array[wp.float32]:
        """Fill ``population`` and return it."""

    def tell(self, cost: wp.array[wp.float32]) -> None:
        """Learn from the costs (candidate,) of a whole generation; infinite costs are allowed, NaN is not."""

    def estimate(self, pose: wp.array[wp.float32]) -> None:
        """Write the answer's coordinates into ``pose`` (run, coordinate), where ``returns_best`` is False."""


def whole_generations(evaluations: int, particles: int) -> list[int]:
    """Sizes of whole generations, the last one cut to what is left."""
    whole, left = divmod(evaluations, particles)
    return [particles] * whole + ([left] if left else [])


def share_budget(evaluations: int, parts: int) -> list[int]:
    """Split a budget evenly; what does not divide goes to the first parts."""
    return [evaluations // parts + (i < evaluations % parts) for i in range(parts)]
