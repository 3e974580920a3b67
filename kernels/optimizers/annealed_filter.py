"""The annealed particle filter on the device, a batch of runs at a time: propagation, weights, selection.

Equations are those of the paper's Section 4.1 as settled in ``docs/algorithms.md``. A layer spreads N particles,
weighs them by their costs f, and selects N of them with replacement, each as often as it weighs on average::

    selected s_1 .. s_N  --propagate-->  x_1 .. x_N  --weigh-->  w_1 .. w_N  --select-->  s_1 .. s_N of the next layer

    w_k ~ (1 - f_k)^beta,  and after a layer the next one's beta is that for which this layer's weights would have
    (sum w)^2 / (N sum w^2) = delta,  the survival rate

The selected particles of a search's last layer are those of the next search's first. A layer propagates the coordinates
of one partition; the others stay as each particle has them, and whole particles are selected.

A small beta weighs all particles alike, a large one only the best; delta says how many survive, whatever the costs are.
In terms of a distance from the best particle, ``d_k = ln(1 - f_best) - ln(1 - f_k)``, weights are ``exp(-beta d_k)``:
the rate falls as beta grows, so that bisection finds it.
"""

from typing import Any

import warp as wp

from mmocap_warp.kernels.optimizers.populations import SearchSpace, advance, random_stream
from mmocap_warp.kernels.structs import allocated

wp.set_module_options({"enable_backward": False})

# Annealing exponents are sought between these two, relative to the farthest and the nearest particle's distance from
# the best: the weights are all but uniform at the one, and only the best of particles count at the other.
_SOFTEST = wp.constant(1.0e-3)
_HARDEST = wp.constant(1.0e2)
_LOG_LARGE = wp.constant(80.0)  # logarithm of a number that is large and still finite
_BISECTIONS = wp.constant(26)  # halvings of an interval of logarithms until single precision sees no difference


@wp.struct
class Schedule:
    """Which coordinates each layer propagates: those of one partition after the other."""

    first: wp.array[wp.int32]  # (layer,) of the partition's dofs, which lie side by side
    end: wp.array[wp.int32]  # (layer,) one past the last of them
    opens: wp.array[wp.int32]  # (layer,) 1 in a partition's first layer
    own_exponents: bool  # every layer is weighed by the exponent of its own costs


def make_schedule(partitions: list[int], layers: list[int], own_exponents: bool, device: wp.DeviceLike) -> Any:
    """So many layers for each partition of so many dofs; a partition may have none."""
    first, end, opens = [], [], []
    for p, count in enumerate(layers):
        first += [sum(partitions[:p])] * count
        end += [sum(partitions[: p + 1])] * count
        opens += [int(layer == 0) for layer in range(count)]
    return allocated(Schedule, device, first=first, end=end, opens=opens, own_exponents=own_exponents)


@wp.struct
class AnnealedFilterState:
    """A layer of particles: from those selected of the last one to those selected of this one."""

    layer: wp.array[wp.int32]  # (run,) layers weighed
    noise: wp.array3d[wp.float32]  # (run, particle, number) standard normal
    uniform: wp.array2d[wp.float32]  # (run, particle) random, in [0, 1)
    x: wp.array3d[wp.float32]  # (run, particle, dof)
    distance: wp.array2d[wp.float32]  # (run, particle) from the best cost
    exponent: wp.array[wp.float32]  # (run,) beta of the next layer
    weight: wp.array2d[wp.float32]  # (run, particle)
    mean: wp.array2d[wp.float32]  # (run, dof) weighted
    parent: wp.array2d[wp.int32]  # (run, particle) which particle is selected
    selected: wp.array3d[wp.float32]  # (run, particle, dof)
    center: wp.array2d[wp.float32]  # (run, dof) mean of the selected
    spread: wp.array2d[wp.float32]  # (run, dof) their standard deviation


def make_state(population: wp.array[wp.float32]) -> Any:
    """Arrays for searches that write their candidates to ``population`` (run, particle, dof).

    ``selected`` and ``mean`` outlive a search; zeros are no particles yet.
    """
    runs, particles, dofs = population.shape
    shapes: dict[str, tuple[int, ...]] = dict.fromkeys(("layer", "exponent"), (runs,))
    shapes |= dict.fromkeys(("mean", "center", "spread"), (runs, dofs))
    shapes |= dict.fromkeys(("uniform", "distance", "weight", "parent"), (runs, particles))
    # The first layer needs a random number per dimension, later ones a number per particle.
    shapes |= {"noise": (runs, particles, max(dofs, particles)), "selected": population.shape}
    return allocated(AnnealedFilterState, population.device, x=population, **shapes)


@wp.kernel
def _start(
    space: SearchSpace,
    pose: wp.array2d[wp.float32],  # (run, coordinate)
    # in and out
    state: AnnealedFilterState,
) -> None:
    run, i = wp.tid()
    value = pose[run, space.index[i]]
    step = value - state.mean[run, i]
    for k in range(state.selected.shape[1]):
        state.selected[run, k, i] = state.selected[run, k, i] + step
    state.mean[run, i] = value
    if i == 0:
        state.layer[run] = 0


def start(space: SearchSpace, pose: wp.array[wp.float32], state: AnnealedFilterState) -> None:
    """Move the particles by as much as the answer was moved since: ``s_k += pose[:, index] - mean``.

    That is by nothing, unless the answer was brought within limits, or its angles are counted from elsewhere now.
    Particles that are zeros with a mean of zero all become the pose.
    """
    wp.launch(_start, state.mean.shape, [space, pose], [state], device=pose.device)


@wp.kernel
def _sample_noise(
    space: SearchSpace,
    # out
    state: AnnealedFilterState,
) -> None:
    run, k = wp.tid()
    random = random_stream(space, run, k)
    state.uniform[run, k] = wp.randf(random)
    for j in range(state.noise.shape[2]):
        state.noise[run, k, j] = wp.randn(random)


def sample_noise(space: SearchSpace, particles: int, state: AnnealedFilterState) -> None:
    """Sample the random numbers of a layer's first ``particles``."""
    runs = state.layer.shape[0]
    wp.launch(_sample_noise, (runs, particles), [space], [state], device=space.seed.device)
    advance(space.counter, particles)


@wp.func
def _opens(schedule: Schedule, layer: int) -> bool:
    """Whether a layer is its partition's first."""
    return layer < schedule.opens.shape[0] and schedule.opens[layer] == 1


@wp.kernel
def _propagate(
    space: SearchSpace,
    schedule: Schedule,
    diffusion: float,
    # in and out
    state: AnnealedFilterState,
) -> None:
    run, k, i = wp.tid()
    particles = state.selected.shape[1]
    stays = state.selected[run, k, i]
    layer = wp.min(state.layer[run], schedule.first.shape[0] - 1)  # beyond the budget, the last partition goes on
    if i < schedule.first[layer] or i >= schedule.end[layer]:
        state.x[run, k, i] = stays
    elif _opens(schedule, state.layer[run]):
        state.x[run, k, i] = stays + space.radius[i] * state.noise[run, k, i]
    else:
        step = float(0.0)
        for j in range(particles):
            step += state.noise[run, k, j] * (state.selected[run, j, i] - state.center[run, i])
        share = wp.sqrt(diffusion)
        if share * state.spread[run, i] > space.radius[i]:
            share = space.radius[i] / state.spread[run, i]
        state.x[run, k, i] = stays + share / wp.sqrt(float(particles)) * step


def propagate(
    space: SearchSpace, schedule: Schedule, diffusion: float, particles: int, state: AnnealedFilterState
) -> None:
    """Diffuse the layer's partition of the selected particles ``s_k``, and leave the rest as it is.

    In the partition's first layer, ``x_k = s_k + radius * noise[k]``. In the others,
    ``x_k = s_k + sqrt(diffusion / N) sum_j noise[k, j] (s_j - center)``: given the selection, that sum of independent
    normal numbers times deviations is normal, with Eq. 6's covariance
    ``diffusion / N sum_j (s_j - center)(s_j - center)^T``. No matrix needs to be built or factorised, and a singular
    one, of fewer particles than dimensions, is no special case. In a coordinate where the standard deviation of that
    step would be more than the radius, it is the radius: what no cost shows would spread without end.
    """
    runs, _particles, dofs = state.x.shape
    wp.launch(_propagate, (runs, particles, dofs), [space, schedule, diffusion], [state], device=space.seed.device)


@wp.func
def _minus_log_of_rest(share: float) -> float:
    """``-ln(1 - share)`` to full precision for small shares (W. Kahan's quotient)."""
    rest = 1.0 - share
    if rest == 1.0:
        return share
    return -wp.log(rest) * share / (1.0 - rest)


@wp.kernel
def _measure_distances(
    cost: wp.array[wp.float32],  # (candidate,)
    # out
    state: AnnealedFilterState,
) -> None:
    run, k = wp.tid()
    particles = state.distance.shape[1]
    best = float(wp.inf)
    worst = float(-wp.inf)
    for j in range(particles):
        other = cost[run * particles + j]
        if wp.isfinite(other):
            best = wp.min(best, other)
            worst = wp.max(worst, other)
    mine = cost[run * particles + k]
    # Halves, as the range of large costs may be more than a float holds.
    if 0.5 * worst - 0.5 * best <= 0.0:  # all alike: those that can be judged, or nobody
        state.distance[run, k] = wp.where(wp.isfinite(mine) or not wp.isfinite(best), 0.0, wp.inf)
    elif not wp.isfinite(mine):
        state.distance[run, k] = wp.inf
    else:
        top = wp.where(best >= 0.0 and worst <= 1.0, 1.0, worst)
        state.distance[run, k] = _minus_log_of_rest((0.5 * mine - 0.5 * best) / (0.5 * top - 0.5 * best))


@wp.func
def _weight(distance: float, exponent: float) -> float:
    """``((1 - f) / (1 - f_best))^exponent``."""
    return wp.where(wp.isfinite(distance), wp.exp(-exponent * distance), 0.0)


@wp.func
def _survival_rate(distance: wp.array2d[wp.float32], run: int, exponent: float) -> float:
    """Eq. 7 for the weights that an exponent gives."""
    total = float(0.0)
    squares = float(0.0)
    for k in range(distance.shape[1]):
        weight = _weight(distance[run, k], exponent)
        total += weight
        squares += weight * weight
    return total * total / (squares * float(distance.shape[1]))


@wp.func
def _exponent(distance: wp.array2d[wp.float32], run: int, survival: float) -> float:
    """Eq. 8."""
    near = float(wp.inf)
    far = float(0.0)
    for k in range(distance.shape[1]):
        apart = distance[run, k]
        if apart > 0.0 and wp.isfinite(apart):
            near = wp.min(near, apart)
            far = wp.max(far, apart)
    beta = float(1.0)
    if far > 0.0:
        softest = wp.log(_SOFTEST) - wp.log(far)
        hardest = wp.min(wp.log(_HARDEST) - wp.log(near), _LOG_LARGE)
        for _step in range(_BISECTIONS):  # the rate falls as the exponent grows
            middle = 0.5 * (softest + hardest)
            if _survival_rate(distance, run, wp.exp(middle)) > survival:
                softest = middle
            else:
                hardest = middle
        beta = wp.exp(hardest)
    return beta


@wp.kernel
def _anneal(
    schedule: Schedule,
    survival: float,
    # in and out
    state: AnnealedFilterState,
) -> None:
    run = wp.tid()
    particles = state.distance.shape[1]
    following = _exponent(state.distance, run, survival)
    beta = float(state.exponent[run])
    if schedule.own_exponents or _opens(schedule, state.layer[run]):  # nothing is known of its costs before
        beta = following
    state.exponent[run] = following
    state.layer[run] = state.layer[run] + 1
    total = float(0.0)
    for k in range(particles):
        total += _weight(state.distance[run, k], beta)
    for k in range(particles):
        state.weight[run, k] = _weight(state.distance[run, k], beta) / total


@wp.kernel
def _average(
    # in and out
    state: AnnealedFilterState,
) -> None:
    run, i = wp.tid()
    first = state.x[run, 0, i]
    beyond = float(0.0)  # from the first particle, so that particles all alike have exactly their mean
    for k in range(state.x.shape[1]):
        beyond += state.weight[run, k] * (state.x[run, k, i] - first)
    state.mean[run, i] = first + beyond


def weigh(cost: wp.array[wp.float32], schedule: Schedule, survival: float, state: AnnealedFilterState) -> None:
    """Weigh particles by ``w = (1 - f)^beta``, normalised; ``mean = sum_k w_k x_k``; then choose the next layer's beta.

    That is Eq. 8 for this layer's costs, which a partition's first layer uses itself; all do with own exponents.

    Costs are taken as they are where a run's finite ones lie in [0, 1], and are mapped onto [0, 1] by their range where
    one lies outside. Infinite costs weigh nothing; where all costs are equal, or none is finite, weights are equal too.
    Where no exponent reaches the survival rate, the nearest end decides: all particles that can be weighed alike, or
    the best ones alone.
    """
    device = cost.device
    wp.launch(_measure_distances, state.distance.shape, [cost], [state], device=device)
    wp.launch(_anneal, state.layer.shape, [schedule, survival], [state], device=device)
    wp.launch(_average, state.mean.shape, [], [state], device=device)


@wp.kernel
def _choose_parents(
    # in and out
    state: AnnealedFilterState,
) -> None:
    run, k = wp.tid()
    chosen = int(0)
    reached = float(0.0)
    for j in range(state.weight.shape[1]):
        # Rounding may leave the last sum below the number: the last particle that weighs anything is chosen then.
        if reached <= state.uniform[run, k] and state.weight[run, j] > 0.0:
            chosen = j
        reached += state.weight[run, j]
    state.parent[run, k] = chosen


@wp.kernel
def _copy_parents(
    # in and out
    state: AnnealedFilterState,
) -> None:
    run, i = wp.tid()
    particles = state.x.shape[1]
    first = state.x[run, state.parent[run, 0], i]
    beyond = float(0.0)
    for k in range(particles):
        value = state.x[run, state.parent[run, k], i]
        state.selected[run, k, i] = value
        beyond += value - first
    center = first + beyond / float(particles)
    squares = float(0.0)
    for k in range(particles):
        apart = state.selected[run, k, i] - center
        squares += apart * apart
    state.center[run, i] = center
    state.spread[run, i] = wp.sqrt(squares / float(particles))


def select(state: AnnealedFilterState) -> None:
    """Choose N whole particles with replacement, each as often as it weighs on average; and their mean and spread."""
    device = state.parent.device
    wp.launch(_choose_parents, state.parent.shape, [], [state], device=device)
    wp.launch(_copy_parents, state.center.shape, [], [state], device=device)
