"""Where the skin is at another time than that of its pose: cameras that are not triggered together see it there."""

import warp as wp

from mmocap_warp.kernels.block import Batch

wp.set_module_options({"enable_backward": False})


@wp.struct
class Moving:
    """How the skin moves, for views whose masks were taken at another time than that of the pose.

    Such a view sees ``x + late (own x + velocity) + late^2 bend``. While a body is followed, ``own`` is the frame rate
    and ``velocity`` the skin of the frame before, times minus that. Within a clip ``own`` is zero, and velocity and
    bend are those of the parabola through the poses before, here and after. Without late views nothing is read.
    """

    late: wp.array2d[wp.float32]  # (frame, camera) [s]
    frame: wp.array[wp.int32]  # (candidate,) the frame that each is judged against
    own: float  # [1/s]
    velocity: wp.array2d[wp.vec3]  # (candidate, vertex) [m/s]
    bend: wp.array2d[wp.vec3]  # (candidate, vertex) half the acceleration [m/s^2]


@wp.func
def seen_at(posed: wp.array2d[wp.vec3], moving: Moving, late: float, c: int, v: int) -> wp.vec3:
    """Where a vertex is when a view is late by so much [m]."""
    place = posed[c, v]
    return place + late * (moving.own * place + moving.velocity[c, v] + late * moving.bend[c, v])


@wp.kernel
def _bend_skin(
    posed: wp.array2d[wp.vec3],  # (candidate, vertex)
    sides: wp.array[wp.int32],  # (candidate,) 1 for the pose before, 2 for that after
    rate: float,
    curved: float,
    batch: Batch,
    # in: the skin before and after; out
    velocity: wp.array2d[wp.vec3],  # (candidate, vertex)
    bend: wp.array2d[wp.vec3],  # (candidate, vertex)
) -> None:
    own, v = wp.tid()
    c = batch.first + own
    here = posed[c, v]
    since = here - velocity[c, v]
    until = bend[c, v] - here
    both = sides[c] == 3
    speed = wp.where(both, 0.5 * (since + until), wp.where(sides[c] == 1, since, until))
    velocity[c, v] = wp.where(sides[c] == 0, wp.vec3(), rate * speed)
    bend[c, v] = wp.where(both, 0.5 * curved * rate * rate * (until - since), wp.vec3())


def bend_skin(
    posed: wp.array[wp.vec3], sides: wp.array[wp.int32], rate: float, curved: bool, batch: Batch, moving: Moving
) -> None:
    """Find how the skin ``posed`` (candidate, vertex) [m] moves.

    ``moving.velocity`` and ``moving.bend`` hold the skin of the pose before and after, ``rate`` poses a second;
    ``sides`` says which of both there are. Where there is only one, or without ``curved``, nothing bends.
    """
    dim = (batch.size, posed.shape[1])
    wp.launch(
        _bend_skin, dim, [posed, sides, rate, float(curved), batch], [moving.velocity, moving.bend], device=posed.device
    )


@wp.kernel
def _follow_skin(
    posed: wp.array2d[wp.vec3],  # (candidate, vertex)
    rate: float,
    batch: Batch,
    # out
    velocity: wp.array2d[wp.vec3],  # (candidate, vertex)
    bend: wp.array2d[wp.vec3],  # (candidate, vertex)
) -> None:
    own, v = wp.tid()
    c = batch.first + own
    velocity[c, v] = -rate * posed[c, v]
    bend[c, v] = wp.vec3()


def follow_skin(posed: wp.array[wp.vec3], rate: float, batch: Batch, moving: Moving) -> None:
    """Let the skin move from the pose before, ``posed`` (candidate, vertex) [m], to whatever pose is tried."""
    dim = (batch.size, posed.shape[1])
    wp.launch(_follow_skin, dim, [posed, rate, batch], [moving.velocity, moving.bend], device=posed.device)
