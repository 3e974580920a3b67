"""Turns the frame that the root's angles are counted in, so that a search never starts near their gimbal lock.

A body that walks round a circle passes the heading at which ``Rz Ry Rx`` loses a degree of freedom. So every search
counts the root's angles from where the last one left it: they start at zero.
"""

import warp as wp

from mmocap_warp.kernels.body.kinematics import rotation_zyx

wp.set_module_options({"enable_backward": False})

_ROOT = wp.constant(3)  # the root's angles follow its three translations
_TURN = wp.constant(2.0 * wp.pi)


@wp.kernel
def _enter(
    home: wp.mat33,
    frame: wp.mat33,
    # in and out
    pose: wp.array2d[wp.float32],  # (run, coordinate)
    # out
    angles: wp.array[wp.vec3],  # (run,)
    root_base: wp.array[wp.mat33],  # (run,)
) -> None:
    run = wp.tid()
    left = wp.vec3(pose[run, _ROOT], pose[run, _ROOT + 1], pose[run, _ROOT + 2])
    angles[run] = left
    root_base[run] = home * frame * rotation_zyx(left[0], left[1], left[2]) * wp.transpose(frame)
    for i in range(3):
        pose[run, _ROOT + i] = 0.0


def enter(
    home: wp.mat33,
    frame: wp.mat33,
    pose: wp.array[wp.float32],
    angles: wp.array[wp.vec3],
    root_base: wp.array[wp.mat33],
) -> None:
    """Count root angles from where they are: ``root_base = home F R(pose) F^T``, and they become zero.

    ``home`` is the subject's base, F the root joint's frame, ``pose`` is (run, coordinate); ``angles`` (run,) keeps
    what they were [rad].
    """
    wp.launch(_enter, pose.shape[0], [home, frame], [pose, angles, root_base], device=pose.device)


@wp.func
def _whole_turns(angle: float, near: float) -> float:
    """The same direction, at most half a turn away from another angle."""
    return angle - _TURN * wp.round((angle - near) / _TURN)


@wp.func
def _angles_zyx(r: wp.mat33, near: wp.vec3) -> wp.vec3:
    """The angles x, y, z of ``r = Rz Ry Rx`` that are nearest to others; exact through gimbal lock as well."""
    x = wp.atan2(r[2, 1], r[2, 2])
    y = wp.atan2(-r[2, 0], wp.sqrt(r[0, 0] * r[0, 0] + r[1, 0] * r[1, 0]))
    s, c = wp.sin(x), wp.cos(x)
    z = wp.atan2(s * r[0, 2] - c * r[0, 1], c * r[1, 1] - s * r[1, 2])
    one = wp.vec3(_whole_turns(x, near[0]), _whole_turns(y, near[1]), _whole_turns(z, near[2]))
    other = wp.vec3(
        _whole_turns(x + wp.pi, near[0]), _whole_turns(wp.pi - y, near[1]), _whole_turns(z + wp.pi, near[2])
    )
    return wp.where(wp.length_sq(one - near) <= wp.length_sq(other - near), one, other)


@wp.kernel
def _leave(
    home: wp.mat33,
    frame: wp.mat33,
    angles: wp.array[wp.vec3],  # (run,)
    # in and out
    pose: wp.array2d[wp.float32],  # (run, coordinate)
    root_base: wp.array[wp.mat33],  # (run,)
) -> None:
    run = wp.tid()
    turn = wp.vec3(pose[run, _ROOT], pose[run, _ROOT + 1], pose[run, _ROOT + 2])
    found = angles[run]
    if wp.length_sq(turn) > 0.0:  # a root that stays keeps its angles to the last bit
        own = frame * rotation_zyx(turn[0], turn[1], turn[2])
        found = _angles_zyx(wp.transpose(frame) * wp.transpose(home) * root_base[run] * own, found)
    for i in range(3):
        pose[run, _ROOT + i] = found[i]
    root_base[run] = home


def leave(
    home: wp.mat33,
    frame: wp.mat33,
    angles: wp.array[wp.vec3],
    pose: wp.array[wp.float32],
    root_base: wp.array[wp.mat33],
) -> None:
    """Count root angles from ``home`` again, on the branch that is nearest to ``angles``; undoes :func:`enter`."""
    wp.launch(_leave, pose.shape[0], [home, frame, angles], [pose, root_base], device=pose.device)
