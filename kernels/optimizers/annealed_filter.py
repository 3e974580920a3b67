"""The annealed particle filter on the device, a batch of runs at a time: propagation, weights, selection.

Equations are those of the paper's Section 4.1.1 as settled in ``docs/algorithms.md``.
"""

import warp as wp

from mmocap_warp.kernels.optimizers.populations import advance

wp.set_module_options({"enable_backward": False})

# Annealing exponents are sought between these two, relative to the farthest and the nearest particle's distance from
# the best: the weights are all but uniform at the one, and only the best of particles count at the other.
_SOFTEST = wp.constant(1.0e-3)
_HARDEST = wp.constant(1.0e2)
_LOG_LARGE = wp.constant(80.0)  # whose exponential is still finite
_BISECTIONS = wp.constant(26)  # of the logarithm, until single precision sees no difference


@wp.kernel
def _start(
    pose: wp.array2d[wp.float32],  # (run, coordinate)
    index: wp.array[wp.int32],  # (dof,) coordinates that are searched
    # out
    selected: wp.array3d[wp.float32],  # (run, particle, dof)
    center: wp.array2d[wp.float32],  # (run, dof)
    mean: wp.array2d[wp.float32],  # (run, dof)
    layer: wp.array[wp.int32],  # (run,)
):
    run, i = wp.tid()
    value = pose[run, index[i]]
    for k in range(selected.shape[1]):
        selected[run, k, i] = value
    center[run, i] = value
    mean[run, i] = value
    if i == 0:
        layer[run] = 0


def start(pose, index, selected, center, mean, layer):
    """Begin anew: every particle is ``pose[:, index]``."""
    wp.launch(
        _start, dim=mean.shape, inputs=[pose, index], outputs=[selected, center, mean, layer], device=mean.device
    )  # fmt: skip


@wp.kernel
def _draw_noise(
    seed: wp.array[wp.int32],  # (run,)
    draw: wp.array[wp.int32],  # (run,) candidates drawn so far, each from a random stream of its own
    # out
    chance: wp.array2d[wp.float32],  # (run, particle) in [0, 1)
    noise: wp.array3d[wp.float32],  # (run, particle, number) standard normal
):
    run, k = wp.tid()
    state = wp.rand_init(seed[run], draw[run] + k)
    chance[run, k] = wp.randf(state)
    for j in range(noise.shape[2]):
        noise[run, k, j] = wp.randn(state)


def draw_noise(seed, draw, particles, chance, noise):
    """Draw the random numbers of a layer for the first ``particles``; ``draw`` advances by as many."""
    runs, device = draw.shape[0], draw.device
    wp.launch(_draw_noise, dim=(runs, particles), inputs=[seed, draw], outputs=[chance, noise], device=device)
    advance(draw, particles)


@wp.kernel
def _propagate(
    selected: wp.array3d[wp.float32],  # (run, particle, dof)
    center: wp.array2d[wp.float32],  # (run, dof)
    layer: wp.array[wp.int32],  # (run,)
    scale: wp.array[wp.float32],  # (dof,)
    diffusion: float,
    noise: wp.array3d[wp.float32],  # (run, particle, number)
    # out
    x: wp.array3d[wp.float32],  # (run, particle, dof)
):
    run, k, i = wp.tid()
    particles = selected.shape[1]
    if layer[run] == 0:
        x[run, k, i] = selected[run, k, i] + scale[i] * noise[run, k, i]
        return
    step = float(0.0)
    for j in range(particles):
        step += noise[run, k, j] * (selected[run, j, i] - center[run, i])
    x[run, k, i] = selected[run, k, i] + wp.sqrt(diffusion / float(particles)) * step


def propagate(selected, center, layer, scale, diffusion, noise, particles, x):
    """Diffuse the selected particles ``s_k``: ``x_k = s_k + sqrt(diffusion / N) sum_j noise[k, j] (s_j - center)``.

    Given the selection, that sum of independent normal numbers times deviations is normal, with the covariance
    ``diffusion / N sum_j (s_j - center)(s_j - center)^T`` of Eq. 6: no matrix needs to be built or factorised, and a
    singular one, of fewer particles than dimensions, is no special case. The first layer has no spread yet:
    ``x_k = s_k + scale * noise[k]``.
    """
    runs, _particles, dofs = x.shape
    wp.launch(
        _propagate,
        dim=(runs, particles, dofs),
        inputs=[selected, center, layer, scale, diffusion, noise],
        outputs=[x],
        device=x.device,
    )


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
    distance: wp.array2d[wp.float32],  # (run, particle)
):
    run, k = wp.tid()
    particles = distance.shape[1]
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
        distance[run, k] = wp.where(wp.isfinite(mine) or not wp.isfinite(best), 0.0, wp.inf)
    elif not wp.isfinite(mine):
        distance[run, k] = wp.inf
    else:
        top = wp.where(best >= 0.0 and worst <= 1.0, 1.0, worst)
        distance[run, k] = _minus_log_of_rest((0.5 * mine - 0.5 * best) / (0.5 * top - 0.5 * best))


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


@wp.kernel
def _anneal(
    distance: wp.array2d[wp.float32],  # (run, particle)
    survival: float,
    # in and out
    layer: wp.array[wp.int32],  # (run,)
    # out
    exponent: wp.array[wp.float32],  # (run,)
    weight: wp.array2d[wp.float32],  # (run, particle)
):
    run = wp.tid()
    particles = distance.shape[1]
    layer[run] = layer[run] + 1
    near = float(wp.inf)
    far = float(0.0)
    for k in range(particles):
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
        beta = wp.exp(hardest)  # Eq. 8
    exponent[run] = beta
    total = float(0.0)
    for k in range(particles):
        total += _weight(distance[run, k], beta)
    for k in range(particles):
        weight[run, k] = _weight(distance[run, k], beta) / total


@wp.kernel
def _average(
    x: wp.array3d[wp.float32],  # (run, particle, dof)
    weight: wp.array2d[wp.float32],  # (run, particle)
    # out
    mean: wp.array2d[wp.float32],  # (run, dof)
):
    run, i = wp.tid()
    first = x[run, 0, i]
    beyond = float(0.0)  # from the first particle, so that particles all alike have exactly their mean
    for k in range(x.shape[1]):
        beyond += weight[run, k] * (x[run, k, i] - first)
    mean[run, i] = first + beyond


def weigh(cost, x, survival, layer, distance, exponent, weight, mean):
    """Weigh particles by ``w = (1 - f)^beta``, normalised, with Eq. 8's beta; ``mean = sum_k w_k x_k``.

    Costs are taken as they are where a run's finite ones lie in [0, 1], and are mapped onto [0, 1] by their range where
    one lies outside. Infinite costs weigh nothing; where all costs are equal, or none is finite, weights are equal too.
    Where no exponent reaches the survival rate, the nearest end decides: all particles that can be weighed alike, or
    the best ones alone.
    """
    device, runs = x.device, layer.shape
    wp.launch(_measure_distances, dim=distance.shape, inputs=[cost], outputs=[distance], device=device)
    wp.launch(_anneal, dim=runs, inputs=[distance, survival], outputs=[layer, exponent, weight], device=device)
    wp.launch(_average, dim=mean.shape, inputs=[x, weight], outputs=[mean], device=device)


@wp.kernel
def _choose_parents(
    weight: wp.array2d[wp.float32],  # (run, particle)
    chance: wp.array2d[wp.float32],  # (run, particle)
    # out
    parent: wp.array2d[wp.int32],  # (run, particle)
):
    run, k = wp.tid()
    chosen = int(0)
    reached = float(0.0)
    for j in range(weight.shape[1]):
        # Rounding may leave the last sum below the chance: the last particle that weighs anything is chosen then.
        if reached <= chance[run, k] and weight[run, j] > 0.0:
            chosen = j
        reached += weight[run, j]
    parent[run, k] = chosen


@wp.kernel
def _copy_parents(
    x: wp.array3d[wp.float32],  # (run, particle, dof)
    parent: wp.array2d[wp.int32],  # (run, particle)
    # out
    selected: wp.array3d[wp.float32],  # (run, particle, dof)
    center: wp.array2d[wp.float32],  # (run, dof)
):
    run, i = wp.tid()
    particles = x.shape[1]
    first = x[run, parent[run, 0], i]
    beyond = float(0.0)
    for k in range(particles):
        value = x[run, parent[run, k], i]
        selected[run, k, i] = value
        beyond += value - first
    center[run, i] = first + beyond / float(particles)


def select(x, weight, chance, parent, selected, center):
    """Choose N particles with replacement, each particle as often as it weighs on average; ``center`` is their mean."""
    device = x.device
    wp.launch(_choose_parents, dim=parent.shape, inputs=[weight, chance], outputs=[parent], device=device)
    wp.launch(_copy_parents, dim=center.shape, inputs=[x, parent], outputs=[selected, center], device=device)
