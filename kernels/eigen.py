"""Eigenvectors of a batch of symmetric matrices, a block of threads for each: Jacobi rotations in parallel.

A sweep turns every pair of coordinates once. Its pairs are played like a round-robin tournament: the pairs of a round
share no coordinate, so that a block's threads rotate all of them at the same time (Brent and Luk 1985). Started from
the eigenvectors of a similar matrix, as CMA-ES does from one generation to the next, a sweep or two are enough.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

BLOCK = 256
"""Threads of a GPU block; on the CPU a block is one thread."""

_ROW = wp.constant(32)
_SWEEPS = wp.constant(16)
_NEGLIGIBLE = wp.constant(3.0e-8)  # of the larger diagonal element: below what float32 can tell
_CONVERGED = wp.constant(1.0e-6)
_SMALLEST = wp.constant(1.0e-20)
_LARGEST = wp.constant(1.0e16)  # its square still fits


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    __syncthreads();
#endif
""")
def _block_sync():
    """Wait for the block's threads; what they wrote is then seen by all of them."""


@wp.func
def _paired(round: int, k: int, players: int) -> wp.vec2i:
    """Pair ``k`` of a round among an even number of players: the last stays, the others move round the table."""
    others = players - 1
    if k == 0:
        return wp.vec2i(round, others)
    a = (round + k) % others
    b = (round - k + others) % others
    return wp.vec2i(wp.min(a, b), wp.max(a, b))


@wp.func
def _angle(pp: float, pq: float, qq: float) -> wp.vec2:
    """``sin`` and ``tan`` of half the angle, of the rotation that makes ``pq`` zero; both 0 where it already is."""
    if wp.abs(pq) <= _NEGLIGIBLE * wp.max(pp, qq):
        return wp.vec2(0.0, 0.0)
    theta = 0.5 * (qq - pp) / pq
    t = 1.0 / (wp.abs(theta) + wp.sqrt(theta * theta + 1.0))
    if theta < 0.0:
        t = -t
    c = 1.0 / wp.sqrt(t * t + 1.0)
    return wp.vec2(t * c, t * c / (1.0 + c))


@wp.kernel
def _decompose(
    matrix: wp.array3d[wp.float32],  # (run, dof, dof)
    lanes: int,
    # in and out
    axes: wp.array3d[wp.float32],  # (run, dof, dof)
    # out
    lengths: wp.array2d[wp.float32],  # (run, dof)
    work: wp.array3d[wp.float32],  # (run, dof, dof)
    product: wp.array3d[wp.float32],  # (run, dof, dof)
    turn: wp.array2d[wp.vec2],  # (run, pair)
    swept: wp.array[wp.int32],  # (run,) number of the last sweep that turned anything
):
    thread = wp.tid()
    run = thread // lanes
    lane = thread - run * lanes
    dofs = lengths.shape[1]
    players = dofs + dofs % 2
    pairs = players // 2
    width = wp.min(lanes, _ROW)  # a block's threads in rows: each row takes a pair or a line, its threads the elements

    # Into the given axes: work = axes^T matrix axes, symmetric to the last bit.
    for i in range(lane // width, dofs, lanes // width):
        for j in range(lane % width, dofs, width):
            total = float(0.0)
            for m in range(dofs):
                total += matrix[run, i, m] * axes[run, m, j]
            product[run, i, j] = total
    _block_sync()
    for i in range(lane // width, dofs, lanes // width):
        for j in range(lane % width, dofs, width):
            if j >= i:
                total = float(0.0)
                for m in range(dofs):
                    total += axes[run, m, i] * product[run, m, j]
                work[run, i, j] = total
                work[run, j, i] = total
    if lane == 0:
        swept[run] = 0
    _block_sync()

    sweep = int(1)
    while sweep <= _SWEEPS:
        for round in range(players - 1):
            for k in range(lane, pairs, lanes):
                pair = _paired(round, k, players)
                angle = wp.vec2(0.0, 0.0)
                if pair[1] < dofs:
                    pp = work[run, pair[0], pair[0]]
                    pq = work[run, pair[0], pair[1]]
                    qq = work[run, pair[1], pair[1]]
                    angle = _angle(pp, pq, qq)
                    if wp.abs(pq) > _CONVERGED * wp.max(pp, qq):
                        swept[run] = sweep
                turn[run, k] = angle
            _block_sync()
            # As corrections to the old values: a small rotation then rounds far less than with cosines. And one load a
            # line: in ``a, b = m[i], m[j]`` Warp keeps references, which would see the writes that follow.
            for k in range(lane // width, pairs, lanes // width):
                s = turn[run, k][0]
                tau = turn[run, k][1]
                if s != 0.0:
                    pair = _paired(round, k, players)
                    p = pair[0]
                    q = pair[1]
                    for i in range(lane % width, dofs, width):
                        ip = work[run, i, p]
                        iq = work[run, i, q]
                        work[run, i, p] = ip - s * (iq + tau * ip)
                        work[run, i, q] = iq + s * (ip - tau * iq)
                        vp = axes[run, i, p]
                        vq = axes[run, i, q]
                        axes[run, i, p] = vp - s * (vq + tau * vp)
                        axes[run, i, q] = vq + s * (vp - tau * vq)
            _block_sync()
            for k in range(lane // width, pairs, lanes // width):
                s = turn[run, k][0]
                tau = turn[run, k][1]
                if s != 0.0:
                    pair = _paired(round, k, players)
                    p = pair[0]
                    q = pair[1]
                    for i in range(lane % width, dofs, width):
                        pi = work[run, p, i]
                        qi = work[run, q, i]
                        work[run, p, i] = pi - s * (qi + tau * pi)
                        work[run, q, i] = qi + s * (pi - tau * qi)
            _block_sync()
        # All threads have passed the sweep's last barrier, and none can write a number below the next sweep's.
        sweep = wp.where(swept[run] < sweep, _SWEEPS + 1, sweep + 1)
    for i in range(lane, dofs, lanes):
        lengths[run, i] = wp.sqrt(wp.clamp(work[run, i, i], _SMALLEST, _LARGEST))


def decompose(matrix, axes, lengths, work, product, turn, swept):
    """``matrix[r] = B D^2 B^T``: ``axes`` holds orthonormal columns near B and becomes B, ``lengths`` becomes D.

    The last four arrays are scratch: (run, dof, dof) twice, (run, (dof + 1) // 2) of vec2, and (run,) int32.
    """
    runs = matrix.shape[0]
    lanes = 1 if matrix.device.is_cpu else BLOCK
    wp.launch(
        _decompose,
        dim=runs * lanes,
        inputs=[matrix, lanes],
        outputs=[axes, lengths, work, product, turn, swept],
        block_dim=BLOCK,
        device=matrix.device,
    )
