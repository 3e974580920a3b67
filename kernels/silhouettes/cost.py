"""From pixel counts to the cost of a pose."""

import warp as wp

wp.set_module_options({"enable_backward": False})

PAPER, XOR, IOU = 0, 1, 2


@wp.kernel
def _cost(
    kind: int,
    count: wp.array2d[wp.vec2i],  # (candidate, camera) |M|, |M and F|
    foreground: wp.array[wp.int32],  # (camera,) |F|
    size: wp.array[wp.vec2i],  # (camera,) width height [px]
    pose: wp.array2d[wp.float32],  # (candidate, coordinate)
    prior: wp.array[wp.float32],  # (coordinate,) [1 / rad^2]
    # out
    cost: wp.array[wp.float32],  # (candidate,)
):
    c = wp.tid()
    total = float(0.0)
    views = int(0)
    for k in range(foreground.shape[0]):
        observed = foreground[k]
        if observed > 0:  # a view without foreground says nothing
            views += 1
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
                f = float(model + observed - 2 * overlap) / (float(size[k][0]) * float(size[k][1]))
            total += f
    if views == 0:
        cost[c] = wp.inf
        return
    pull = float(0.0)
    for d in range(prior.shape[0]):
        if prior[d] > 0.0:
            pull += prior[d] * pose[c, d] * pose[c, d]
    cost[c] = total / float(views) + pull  # Eq. 5: the mean over the views


def cost_of_counts(kind, count, foreground, size, pose, prior, cost):
    """Mean over the views of the disagreement of model M and foreground F, plus ``sum_d prior[d] pose[d]^2``.

    ``PAPER``: Eq. 4; ``XOR``: differing pixels over all pixels; ``IOU``: 1 - |M and F| / |M or F|. A view in which
    the model is not seen costs 1, one without foreground is left out, and without any view the cost is infinite.
    """
    wp.launch(
        _cost,
        dim=cost.shape[0],
        inputs=[kind, count, foreground, size, pose, prior],
        outputs=[cost],
        device=cost.device,
    )
