"""Differential evolution with role differentiation and malleable mating on the device, a batch of runs at a time.

Fig. 5, Eq. 15 and Eq. 16 of the paper, with its open points as settled in ``docs/algorithms.md``. The random numbers of
a generation are drawn first, as uniform ``chance`` (run, particle, number): one number for each dof, then the forced
dof, the placing member, two alterations, the candidates for leading and those for correcting. What follows is a
function of them.
"""

import warp as wp

from mmocap_warp.kernels.optimizers.populations import advance

wp.set_module_options({"enable_backward": False})

ALPHA_MAX = 4  # mating parameters are whole numbers in -ALPHA_MAX .. ALPHA_MAX
CHANCES = 4 + 2 * ALPHA_MAX  # random numbers of a particle beside those of its dofs

_ALPHA_MAX = wp.constant(ALPHA_MAX)
_Barred = wp.types.vector(length=3 + ALPHA_MAX, dtype=wp.int32)  # receiver, placing, leading; candidates drawn before
_RECEIVER = wp.constant(0)
_PLACING = wp.constant(1)
_LEADING = wp.constant(2)
_DRAWN = wp.constant(3)


@wp.struct
class DeConstants:
    """What does not change during a search."""

    placing: int  # N_P, how many of the best may place
    leading: int  # N_L, how many of the best may lead
    correcting: int  # N_C, how many of the worst may correct
    crossover: float  # CR
    factor: float  # F
    include_start: int  # 1: the start is one of the first population


@wp.kernel
def _start(
    pose: wp.array2d[wp.float32],  # (run, coordinate)
    index: wp.array[wp.int32],  # (dof,) coordinates that are searched
    # out
    center: wp.array2d[wp.float32],  # (run, dof)
    member: wp.array3d[wp.float32],  # (run, particle, dof)
    member_cost: wp.array2d[wp.float32],  # (run, particle)
    alpha: wp.array2d[wp.vec2i],  # (run, particle)
    order: wp.array2d[wp.int32],  # (run, rank)
    generation: wp.array[wp.int32],  # (run,)
):
    run, k = wp.tid()
    for i in range(index.shape[0]):
        member[run, k, i] = pose[run, index[i]]
    member_cost[run, k] = wp.inf
    alpha[run, k] = wp.vec2i(0, 0)
    order[run, k] = k
    if k == 0:
        generation[run] = 0
        for i in range(index.shape[0]):
            center[run, i] = pose[run, index[i]]


def start(pose, index, center, member, member_cost, alpha, order, generation):
    """Begin anew around ``center = pose[:, index]``; it stands in for members until the first ones are told."""
    wp.launch(
        _start,
        dim=order.shape,
        inputs=[pose, index],
        outputs=[center, member, member_cost, alpha, order, generation],
        device=order.device,
    )


@wp.kernel
def _draw_chances(
    seed: wp.array[wp.int32],  # (run,)
    draw: wp.array[wp.int32],  # (run,) candidates drawn so far, each from a random stream of its own
    # out
    chance: wp.array3d[wp.float32],  # (run, particle, number) in [0, 1)
):
    run, k = wp.tid()
    state = wp.rand_init(seed[run], draw[run] + k)
    for n in range(chance.shape[2]):
        chance[run, k, n] = wp.randf(state)


def draw_chances(seed, draw, particles, chance):
    """Draw ``chance[r, k] ~ U[0, 1)`` for the first ``particles``; ``draw`` advances by as many."""
    runs, device = draw.shape[0], draw.device
    wp.launch(_draw_chances, dim=(runs, particles), inputs=[seed, draw], outputs=[chance], device=device)
    advance(draw, particles)


@wp.func
def _pick(chance: float, count: int) -> int:
    """A uniform whole number in 0 .. count - 1; the product may round up to ``count``."""
    return wp.min(int(chance * float(count)), count - 1)


@wp.func
def _is_barred(barred: _Barred, particle: int) -> bool:
    found = bool(False)
    for slot in range(wp.static(3 + ALPHA_MAX)):
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
    member: wp.array3d[wp.float32],  # (run, particle, dof)
    order: wp.array2d[wp.int32],  # (run, rank)
    chance: wp.array3d[wp.float32],  # (run, particle, number)
    run: int,
    k: int,
    number: int,
    first: int,
    size: int,
    exclude: _Barred,
    placing: int,
    alpha: int,
) -> int:
    """Of ``|alpha|`` distinct members of a role set, the nearest to ``placing`` if alpha > 0, the farthest if < 0."""
    barred = exclude
    count = _count_free(order, run, first, size, barred)
    if count == 0:  # a set that its exclusions empty is used whole
        barred = _Barred(-1)
        count = size
    candidates = wp.max(1, wp.min(wp.abs(alpha), count - 1))
    chosen = int(-1)
    least = float(0.0)
    for c in range(candidates):
        particle = _nth_free(order, run, first, size, barred, _pick(chance[run, k, number + c], count - c))
        barred[_DRAWN + c] = particle
        distance = float(0.0)
        for i in range(member.shape[2]):
            distance += wp.abs(member[run, particle, i] - member[run, placing, i])
        if alpha < 0:
            distance = -distance
        if chosen < 0 or distance < least:
            chosen = particle
            least = distance
    return chosen


@wp.func
def _alter(alpha: int, chance: float) -> int:
    """One less, the same or one more, equally likely; clamped."""
    return wp.clamp(alpha + _pick(chance, 3) - 1, -_ALPHA_MAX, _ALPHA_MAX)


@wp.kernel
def _mate(
    constants: DeConstants,
    member: wp.array3d[wp.float32],  # (run, particle, dof)
    alpha: wp.array2d[wp.vec2i],  # (run, particle) alpha_L, alpha_C of the members
    order: wp.array2d[wp.int32],  # (run, rank)
    chance: wp.array3d[wp.float32],  # (run, particle, number)
    # out
    parents: wp.array2d[wp.vec3i],  # (run, particle) placing, leading and correcting member
    altered: wp.array2d[wp.vec2i],  # (run, particle) alpha_L', alpha_C' of the trials
):
    run, k = wp.tid()
    number = member.shape[2] + 1
    barred = _Barred(-1)
    barred[_RECEIVER] = k
    # A plain draw is mating with alpha = 0, whatever it is near to.
    placing = _assort(member, order, chance, run, k, number, 0, constants.placing, barred, k, 0)
    barred[_PLACING] = placing
    inherited = alpha[run, placing]
    alpha_l = _alter(inherited[0], chance[run, k, number + 1])
    alpha_c = _alter(inherited[1], chance[run, k, number + 2])
    leading = _assort(
        member, order, chance, run, k, number + 3, 0, constants.leading, barred, placing, alpha_l
    )  # fmt: skip
    barred[_LEADING] = leading
    worst = order.shape[1] - constants.correcting
    correcting = _assort(
        member, order, chance, run, k, number + 3 + _ALPHA_MAX, worst, constants.correcting, barred, placing, alpha_c
    )  # fmt: skip
    parents[run, k] = wp.vec3i(placing, leading, correcting)
    altered[run, k] = wp.vec2i(alpha_l, alpha_c)


def mate(constants, member, alpha, order, chance, particles, parents, altered):
    """Choose who places, leads and corrects each of the first ``particles`` trials, Fig. 5."""
    wp.launch(
        _mate,
        dim=(order.shape[0], particles),
        inputs=[constants, member, alpha, order, chance],
        outputs=[parents, altered],
        device=order.device,
    )


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
    constants: DeConstants,
    center: wp.array2d[wp.float32],  # (run, dof)
    scale: wp.array[wp.float32],  # (dof,)
    member: wp.array3d[wp.float32],  # (run, particle, dof)
    parents: wp.array2d[wp.vec3i],  # (run, particle)
    generation: wp.array[wp.int32],  # (run,)
    chance: wp.array3d[wp.float32],  # (run, particle, number)
    # out
    trial: wp.array3d[wp.float32],  # (run, particle, dof)
):
    run, k, i = wp.tid()
    middle = center[run, i]
    if generation[run] == 0:
        founder = middle + scale[i] * (2.0 * chance[run, k, i] - 1.0)
        trial[run, k, i] = wp.where(k == 0 and constants.include_start == 1, middle, founder)
        return
    dofs = member.shape[2]
    x = member[run, k, i]
    if chance[run, k, i] < constants.crossover or _pick(chance[run, k, dofs], dofs) == i:  # Eq. 16
        chosen = parents[run, k]
        toward = member[run, chosen[1], i] - member[run, chosen[2], i]
        donor = member[run, chosen[0], i] + constants.factor * toward  # Eq. 15
        x = _reflect(donor, middle - scale[i], middle + scale[i])
    trial[run, k, i] = x


def vary(constants, center, scale, member, parents, generation, chance, particles, trial):
    """``U = x_P + F (x_L - x_C)`` where a chance < CR or the dof is forced, else ``x_R``; at first, uniform members."""
    runs, _, dofs = trial.shape
    wp.launch(
        _vary,
        dim=(runs, particles, dofs),
        inputs=[constants, center, scale, member, parents, generation, chance],
        outputs=[trial],
        device=trial.device,
    )


@wp.kernel
def _select(
    cost: wp.array[wp.float32],  # (candidate,)
    trial: wp.array3d[wp.float32],  # (run, particle, dof)
    altered: wp.array2d[wp.vec2i],  # (run, particle)
    generation: wp.array[wp.int32],  # (run,)
    # in and out
    member: wp.array3d[wp.float32],  # (run, particle, dof)
    member_cost: wp.array2d[wp.float32],  # (run, particle)
    alpha: wp.array2d[wp.vec2i],  # (run, particle)
):
    run, k = wp.tid()
    founding = generation[run] == 0
    mine = cost[run * member.shape[1] + k]
    if founding or mine < member_cost[run, k]:
        member_cost[run, k] = mine
        for i in range(member.shape[2]):
            member[run, k, i] = trial[run, k, i]
        if not founding:  # the first are born with 0
            alpha[run, k] = altered[run, k]


@wp.kernel
def _rank(
    member_cost: wp.array2d[wp.float32],  # (run, particle)
    # out
    order: wp.array2d[wp.int32],  # (run, rank) particles, the best first
    # in and out
    generation: wp.array[wp.int32],  # (run,)
):
    run, k = wp.tid()
    mine = member_cost[run, k]
    rank = int(0)
    for other in range(order.shape[1]):
        theirs = member_cost[run, other]
        if theirs < mine or (theirs == mine and other < k):
            rank += 1
    order[run, rank] = k
    if k == 0:
        generation[run] = generation[run] + 1


def select(cost, trial, altered, member, member_cost, alpha, order, generation):
    """Let a trial that is strictly better take its receiver's place, with its alphas; then rank the members."""
    device = order.device
    wp.launch(
        _select,
        dim=order.shape,
        inputs=[cost, trial, altered, generation],
        outputs=[member, member_cost, alpha],
        device=device,
    )
    wp.launch(_rank, dim=order.shape, inputs=[member_cost], outputs=[order, generation], device=device)


@wp.kernel
def _write_best(
    member: wp.array3d[wp.float32],  # (run, particle, dof)
    order: wp.array2d[wp.int32],  # (run, rank)
    index: wp.array[wp.int32],  # (dof,)
    # out
    pose: wp.array2d[wp.float32],  # (run, coordinate)
):
    run, i = wp.tid()
    pose[run, index[i]] = member[run, order[run, 0], i]


def write_best(member, order, index, pose):
    """Write the best member's coordinates: ``pose[:, index] = member[:, order[:, 0]]``."""
    runs, _, dofs = member.shape
    wp.launch(_write_best, dim=(runs, dofs), inputs=[member, order, index], outputs=[pose], device=pose.device)
