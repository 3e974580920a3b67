"""From pixel counts to the cost of a pose."""

import warp as wp

from mmocap_warp.kernels.block import Batch
from mmocap_warp.kernels.views.projection import Views

wp.set_module_options({"enable_backward": False})

PAPER, XOR, IOU = 0, 1, 2


@wp.kernel
def _cost(
    kind: int,
    views: Views,
    count: wp.array2d[wp.vec2i],  # (candidate, camera) |M|, |M and F|
    pose: wp.array2d[wp.float32],  # (candidate, coordinate)
    prior: wp.array[wp.float32],  # (coordinate,) [1 / rad^2]
    batch: Batch,
    # out
    cost: wp.array[wp.float32],  # (candidate,)
) -> None:
    c = batch.first + wp.tid()
    total = float(0.0)
    judged = int(0)
    for k in range(views.foreground.shape[0]):
        observed = views.foreground[k]
        if observed > 0:  # a view without foreground says nothing
            judged += 1
            model = count[c, k][0]
            overlap = count[c, k][1]
            f = float(1.0)
            if model > 0:
                # Differences are taken in integers, so that a perfect model costs exactly nothing.
                if kind == PAPER:  # Eq. 4: |M\F| / (2|M|) + |F\M| / (2|F|)
                    f = 0.5 * (float(model - overlap) / float(model) + float(observed - overlap) / float(observed))
                elif kind == IOU:
                    union = model + observed - overlap
                    f = float(union - overlap) / float(union)
            if kind == XOR:
                f = float(model + observed - 2 * overlap) / (float(views.size[k][0]) * float(views.size[k][1]))
            total += f
    if judged == 0:
        cost[c] = wp.inf
        return
    pull = float(0.0)
    for d in range(prior.shape[0]):
        if prior[d] > 0.0:
            pull += prior[d] * pose[c, d] * pose[c, d]
    cost[c] = total / float(judged) + pull  # Eq. 5: the mean over the views


def cost_of_counts(
    kind: int,
    views: Views,
    count: wp.array[wp.vec2i],
    pose: wp.array[wp.float32],
    prior: wp.array[wp.float32],
    batch: Batch,
    cost: wp.array[wp.float32],
) -> None:
    """Mean over the views of the disagreement of model M and foreground F, plus ``sum_d prior[d] pose[d]^2``.

    ``PAPER``: Eq. 4; ``XOR``: differing pixels over all pixels; ``IOU``: 1 - |M and F| / |M or F|. A view in which
    the model is not seen costs 1, one without foreground is left out, and without any view the cost is infinite.
    ``count`` is (candidate, camera) of |M| and |M and F|, ``pose`` (candidate, coordinate), ``prior`` (coordinate,),
    ``cost`` (candidate,).
    """
    wp.launch(_cost, batch.size, [kind, views, count, pose, prior, batch], [cost], device=cost.device)
