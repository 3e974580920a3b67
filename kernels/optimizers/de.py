"""Differential evolution with role differentiation and malleable mating on the device, a batch of runs at a time.

Fig. 5, Eq. 15 and Eq. 16 of the paper, with its open points as settled in ``docs/algorithms.md``. Every member R, the
receiver, gets a trial U that takes its place if it is better. Each of the trial's coordinates is the receiver's own or
that of a donor, a step from a placing member P along the difference of a leading member L and a correcting member C::

    worst    C . . . . . L    best                U_i = x_P,i + F (x_L,i - x_C,i)   with chance CR, and for one i
             P ---> U     (F = 1/2)                   = x_R,i                       else

P and L are among the best members, C among the worst. How near L and C shall be to P is the strength of mating, a
whole number alpha each: the nearest (alpha > 0) or the farthest (alpha < 0) of |alpha| candidates chosen at random.
A trial inherits P's alphas, each altered by -1, 0 or 1; so they are selected along with the coordinates.

The random numbers of a generation are sampled first, as ``uniform`` (run, particle, number): one number for each dof,
then the forced dof, the placing member, two alterations, the candidates for leading and those for correcting. What
follows is a function of them.
"""

from typing import Any

import warp as wp

from mmocap_warp.kernels.optimizers.populations import SearchSpace, advance, random_stream
from mmocap_warp.kernels.structs import allocated

wp.set_module_options({"enable_backward": False})

_ALPHA_MAX = wp.constant(4)  # alphas are whole numbers in -_ALPHA_MAX .. _ALPHA_MAX
_Barred = wp.types.vector(length=3 + _ALPHA_MAX, dtype=wp.int32)  # receiver, placing, leading; earlier candidates
_RECEIVER = wp.constant(0)
_PLACING = wp.constant(1)
_LEADING = wp.constant(2)
_CANDIDATE = wp.constant(3)


@wp.struct
class DeParameters:
    """What does not change during a search."""

    placing: int  # N_P, how many of the best may place
    leading: int  # N_L, how many of the best may lead
    correcting: int  # N_C, how many of the worst may correct
    crossover: float  # CR
    factor: float  # F
    include_start: int  # 1: the start is one of the first population


@wp.struct
class DeState:
    """The members of each run, and the trials that may take their places."""

    center: wp.array2d[wp.float32]  # (run, dof) of the box that is searched
    member: wp.array3d[wp.float32]  # (run, particle, dof)
    member_cost: wp.array2d[wp.float32]  # (run, particle)
    alpha: wp.array2d[wp.vec2i]  # (run, particle) alpha_L, alpha_C of the members
    order: wp.array2d[wp.int32]  # (run, rank) members, the best first
    generation: wp.array[wp.int32]  # (run,) generations learnt from
    uniform: wp.array3d[wp.float32]  # (run, particle, number) random, in [0, 1)
    parents: wp.array2d[wp.vec3i]  # (run, particle) placing, leading and correcting member of the trials
    altered: wp.array2d[wp.vec2i]  # (run, particle) alpha_L', alpha_C' of the trials
    trial: wp.array3d[wp.float32]  # (run, particle, dof)


def make_state(population: wp.array[wp.float32]) -> Any:
    """Arrays for a search that writes its candidates to ``population`` (run, particle, dof)."""
    runs, particles, dofs = population.shape
    by_member = dict.fromkeys(("member_cost", "alpha", "order", "parents", "altered"), (runs, particles))
    shapes = by_member | {"member": population.shape, "center": (runs, dofs), "generation": runs}
    shapes["uniform"] = (runs, particles, dofs + 4 + 2 * _ALPHA_MAX)
    return allocated(DeState, population.device, trial=population, **shapes)


@wp.kernel
def _start(
    space: SearchSpace,
    pose: wp.array2d[wp.float32],  # (run, coordinate)
    # out
    state: DeState,
) -> None:
    run, k = wp.tid()
    for i in range(space.index.shape[0]):
        state.member[run, k, i] = pose[run, space.index[i]]
    state.member_cost[run, k] = wp.inf
    state.alpha[run, k] = wp.vec2i(0, 0)
    state.order[run, k] = k
    if k == 0:
        state.generation[run] = 0
        for i in range(space.index.shape[0]):
            state.center[run, i] = pose[run, space.index[i]]


def start(space: SearchSpace, pose: wp.array[wp.float32], state: DeState) -> None:
    """Begin anew around ``center = pose[:, index]``; it stands in for members until the first ones are told."""
    wp.launch(_start, state.order.shape, [space, pose], [state], device=pose.device)


@wp.kernel
def _sample_uniform(
    space: SearchSpace,
    # out
    state: DeState,
) -> None:
    run, k = wp.tid()
    random = random_stream(space, run, k)
    for n in range(state.uniform.shape[2]):
        state.uniform[run, k, n] = wp.randf(random)


def sample_uniform(space: SearchSpace, particles: int, state: DeState) -> None:
    """Sample the random numbers ``U[0, 1)`` of the first ``particles`` trials."""
    runs = state.order.shape[0]
    wp.launch(_sample_uniform, (runs, particles), [space], [state], device=space.seed.device)
    advance(space.counter, particles)


@wp.func
def _pick(uniform: float, count: int) -> int:
    """A uniform whole number in 0 .. count - 1; the product may round up to ``count``."""
    return wp.min(int(uniform * float(count)), count - 1)


@wp.func
def _is_barred(barred: _Barred, particle: int) -> bool:
    found = bool(False)
    for slot in range(wp.static(3 + _ALPHA_MAX)):
        if barred[slot] == particle:
            found = True
    return found


@wp.func
def _count_free(order: wp.array2d[wp.int32], run: int, first: int, size: int, barred: _Barred) -> int:
    """How many of the ``size`` members from rank ``first`` on are not barred."""
    count = int(0)
    for rank in range(first, first + size):
        if not _is_barred(barred, order[run, rank]):
            count += 1
    return count


@wp.func
def _nth_free(order: wp.array2d[wp.int32], run: int, first: int, size: int, barred: _Barred, n: int) -> int:
    """The ``n``-th of them, the best first."""
    passed = int(0)
    found = int(-1)
    for rank in range(first, first + size):
        particle = order[run, rank]
        if not _is_barred(barred, particle):
            if passed == n:
                found = particle
            passed += 1
    return found


@wp.func
def _assort(
    state: DeState,
    run: int,
    k: int,
    number: int,  # of the first candidate's random number
    first: int,
    size: int,
    exclude: _Barred,
    placing: int,
    alpha: int,
) -> int:
    """Of ``|alpha|`` distinct members of a role set, the nearest to ``placing`` if alpha > 0, the farthest if < 0."""
    barred = exclude
    count = _count_free(state.order, run, first, size, barred)
    if count == 0:  # a set that its exclusions empty is used whole
        barred = _Barred(-1)
        count = size
    candidates = wp.max(1, wp.min(wp.abs(alpha), count - 1))
    chosen = int(-1)
    least = float(0.0)
    for c in range(candidates):
        nth = _pick(state.uniform[run, k, number + c], count - c)
        particle = _nth_free(state.order, run, first, size, barred, nth)
        barred[_CANDIDATE + c] = particle
        distance = float(0.0)
        for i in range(state.member.shape[2]):
            distance += wp.abs(state.member[run, particle, i] - state.member[run, placing, i])
        if alpha < 0:
            distance = -distance
        if chosen < 0 or distance < least:
            chosen = particle
            least = distance
    return chosen


@wp.func
def _alter(alpha: int, uniform: float) -> int:
    """One less, the same or one more, equally likely; clamped."""
    return wp.clamp(alpha + _pick(uniform, 3) - 1, -_ALPHA_MAX, _ALPHA_MAX)


@wp.kernel
def _mate(
    parameters: DeParameters,
    # in and out
    state: DeState,
) -> None:
    run, k = wp.tid()
    number = state.member.shape[2] + 1
    barred = _Barred(-1)
    barred[_RECEIVER] = k
    # Any member of the set is mating with alpha = 0, whatever it is near to.
    placing = _assort(state, run, k, number, 0, parameters.placing, barred, k, 0)
    barred[_PLACING] = placing
    inherited = state.alpha[run, placing]
    alpha_l = _alter(inherited[0], state.uniform[run, k, number + 1])
    alpha_c = _alter(inherited[1], state.uniform[run, k, number + 2])
    leading = _assort(state, run, k, number + 3, 0, parameters.leading, barred, placing, alpha_l)
    barred[_LEADING] = leading
    number += 3 + _ALPHA_MAX
    worst = state.order.shape[1] - parameters.correcting
    correcting = _assort(state, run, k, number, worst, parameters.correcting, barred, placing, alpha_c)
    state.parents[run, k] = wp.vec3i(placing, leading, correcting)
    state.altered[run, k] = wp.vec2i(alpha_l, alpha_c)


def mate(parameters: DeParameters, particles: int, state: DeState) -> None:
    """Choose who places, leads and corrects each of the first ``particles`` trials, Fig. 5."""
    runs, device = state.order.shape[0], state.order.device
    wp.launch(_mate, (runs, particles), [parameters], [state], device=device)


@wp.func
def _reflect(value: float, lower: float, upper: float) -> float:
    """Into [lower, upper], from at most two widths beyond."""
    x = value
    if x > upper:
        x = 2.0 * upper - x
    if x < lower:
        x = 2.0 * lower - x
    if x > upper:
        x = 2.0 * upper - x
    return wp.clamp(x, lower, upper)  # what rounding leaves outside


@wp.kernel
def _vary(
    space: SearchSpace,
    parameters: DeParameters,
    # in and out
    state: DeState,
) -> None:
    run, k, i = wp.tid()
    middle = state.center[run, i]
    radius = space.radius[i]
    uniform = state.uniform[run, k, i]
    if state.generation[run] == 0:
        anywhere = middle + radius * (2.0 * uniform - 1.0)
        state.trial[run, k, i] = wp.where(k == 0 and parameters.include_start == 1, middle, anywhere)
        return
    dofs = state.member.shape[2]
    x = state.member[run, k, i]
    if uniform < parameters.crossover or _pick(state.uniform[run, k, dofs], dofs) == i:  # Eq. 16
        chosen = state.parents[run, k]
        toward = state.member[run, chosen[1], i] - state.member[run, chosen[2], i]
        donor = state.member[run, chosen[0], i] + parameters.factor * toward  # Eq. 15
        x = _reflect(donor, middle - radius, middle + radius)
    state.trial[run, k, i] = x


def vary(space: SearchSpace, parameters: DeParameters, particles: int, state: DeState) -> None:
    """``U = x_P + F (x_L - x_C)`` where a number < CR or the dof is forced, else ``x_R``; at first, uniform members."""
    runs, _, dofs = state.trial.shape
    device = space.seed.device
    wp.launch(_vary, (runs, particles, dofs), [space, parameters], [state], device=device)


@wp.kernel
def _select(
    cost: wp.array[wp.float32],  # (candidate,)
    # in and out
    state: DeState,
) -> None:
    run, k = wp.tid()
    is_first = state.generation[run] == 0
    mine = cost[run * state.member.shape[1] + k]
    if is_first or mine < state.member_cost[run, k]:
        state.member_cost[run, k] = mine
        for i in range(state.member.shape[2]):
            state.member[run, k, i] = state.trial[run, k, i]
        if not is_first:  # the first are born with 0
            state.alpha[run, k] = state.altered[run, k]


@wp.kernel
def _rank(
    # in and out
    state: DeState,
) -> None:
    run, k = wp.tid()
    mine = state.member_cost[run, k]
    rank = int(0)
    for other in range(state.order.shape[1]):
        theirs = state.member_cost[run, other]
        if theirs < mine or (theirs == mine and other < k):
            rank += 1
    state.order[run, rank] = k
    if k == 0:
        state.generation[run] = state.generation[run] + 1


def select(cost: wp.array[wp.float32], state: DeState) -> None:
    """Let a trial that is strictly better take its receiver's place, with its alphas; then rank the members."""
    members, device = state.order.shape, cost.device
    wp.launch(_select, members, [cost], [state], device=device)
    wp.launch(_rank, members, [], [state], device=device)
