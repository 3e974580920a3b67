"""The candidates of a launch. On the CPU threads share the candidates of an evaluation, a launch each."""

import warp as wp

from mmocap_warp.kernels import block
from mmocap_warp.kernels.structs import filled

wp.set_module_options({"enable_backward": False})


@wp.struct
class Batch:
    """Candidates ``first .. first + size - 1`` of the ``total`` that are evaluated, and what their launch works in."""

    first: int
    size: int
    total: int
    scratch: wp.array[wp.uint32]  # see block.scratch


def batch_of(first: int, end: int, total: int, device: wp.DeviceLike) -> Batch:
    """Candidates ``first .. end - 1`` of ``total``, for a thread of their own."""
    return filled(Batch, first=first, size=end - first, total=total, scratch=block.scratch(device))


@wp.func
def run_of(c: int, batch: Batch, runs: int) -> int:
    """The run of a candidate, where ``runs`` share all candidates evenly, one after the other; -1 if there are none."""
    if runs == 0:
        return -1
    return wp.min(c // wp.max(batch.total // runs, 1), runs - 1)
