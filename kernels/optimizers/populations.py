"""Between a population's search space and full pose vectors."""

import warp as wp

from mmocap_warp.kernels.block import lanes_of, sync

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _place(
    params: wp.array3d[wp.float32],  # (run, particle, dof)
    dof: wp.array[wp.int32],  # (dof,) positions in the full pose
    base: wp.array2d[wp.float32],  # (run, coordinate)
    lower: wp.array[wp.float32],  # (coordinate,)
    upper: wp.array[wp.float32],  # (coordinate,)
    particles: int,
    lanes: int,
    # out
    pose: wp.array2d[wp.float32],  # (candidate, coordinate)
):
    c, lane = wp.tid()
    run = c // particles
    for d in range(lane, base.shape[1], lanes):
        pose[c, d] = base[run, d]
    sync()
    for i in range(lane, dof.shape[0], lanes):
        d = dof[i]
        pose[c, d] = wp.clamp(params[run, c - run * particles, i], lower[d], upper[d])


def place(params, dof, base, lower, upper, particles, pose):
    """Write ``particles`` candidates a run into full poses: searched ones within limits, the rest from ``base``."""
    lanes = lanes_of(pose.device)
    wp.launch(
        _place,
        dim=(base.shape[0] * particles, lanes),
        inputs=[params, dof, base, lower, upper, particles, lanes],
        outputs=[pose],
        block_dim=lanes,
        device=pose.device,
    )


@wp.kernel
def _keep_best(
    cost: wp.array[wp.float32],  # (candidate,)
    pose: wp.array2d[wp.float32],  # (candidate, coordinate)
    particles: int,
    lanes: int,
    # in and out
    best_cost: wp.array[wp.float32],  # (run,)
    best_pose: wp.array2d[wp.float32],  # (run, coordinate)
):
    run, lane = wp.tid()
    lowest = float(best_cost[run])
    winner = int(-1)
    for c in range(run * particles, (run + 1) * particles):
        if cost[c] < lowest:
            lowest = cost[c]
            winner = c
    sync()
    if winner >= 0:
        for d in range(lane, pose.shape[1], lanes):
            best_pose[run, d] = pose[winner, d]
        if lane == 0:
            best_cost[run] = lowest


def keep_best(cost, pose, particles, best_cost, best_pose):
    """Let a run's best ever pose be replaced by a strictly better candidate; the first of equals wins."""
    lanes = lanes_of(cost.device)
    wp.launch(
        _keep_best,
        dim=(best_cost.shape[0], lanes),
        inputs=[cost, pose, particles, lanes],
        outputs=[best_cost, best_pose],
        block_dim=lanes,
        device=cost.device,
    )


@wp.kernel
def _scatter(
    params: wp.array2d[wp.float32],  # (run, dof)
    dof: wp.array[wp.int32],  # (dof,)
    # out
    pose: wp.array2d[wp.float32],  # (run, coordinate)
):
    run, i = wp.tid()
    pose[run, dof[i]] = params[run, i]


def scatter(params, dof, pose):
    """Write searched coordinates back: ``pose[run, dof[i]] = params[run, i]``."""
    wp.launch(_scatter, dim=params.shape, inputs=[params, dof], outputs=[pose], device=pose.device)


@wp.kernel
def _clamp(
    lower: wp.array[wp.float32],  # (coordinate,)
    upper: wp.array[wp.float32],  # (coordinate,)
    # in and out
    pose: wp.array2d[wp.float32],  # (run, coordinate)
):
    run, d = wp.tid()
    pose[run, d] = wp.clamp(pose[run, d], lower[d], upper[d])


def clamp(lower, upper, pose):
    """Keep every coordinate within its limits."""
    wp.launch(_clamp, dim=pose.shape, inputs=[lower, upper], outputs=[pose], device=pose.device)


@wp.kernel
def _advance(
    streams: int,
    # in and out
    draw: wp.array[wp.int32],  # (run,)
):
    run = wp.tid()
    draw[run] = draw[run] + streams


def advance(draw, streams):
    """Count the random streams that a draw has used, so that no later draw repeats them: ``draw[run] += streams``."""
    wp.launch(_advance, dim=draw.shape, inputs=[streams], outputs=[draw], device=draw.device)
