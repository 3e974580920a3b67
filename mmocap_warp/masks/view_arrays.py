"""Cameras and the masks of one frame as arrays on a device, for the kernels that project and count."""

from __future__ import annotations

import numpy as np
import warp as wp

from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.kernels import block
from mmocap_warp.kernels.structs import filled
from mmocap_warp.kernels.views.projection import Views
from mmocap_warp.masks.observation import words_per_row


class ViewArrays:
    """A rig and its masks, empty at first, as Warp arrays, and the ``struct`` of them that kernels take.

    Raises:
        ValueError: images so wide that a block cannot hold a row.
    """

    def __init__(self, rig: CameraRig, device: str) -> None:
        rows, words = int(rig.size[:, 1].max()), words_per_row(int(rig.size[:, 0].max()))
        if 8 * words >= block.WORDS:
            raise ValueError(f"images must be narrower than {4 * block.WORDS} px, got {rig.size[:, 0].max()}")
        self.rotation = wp.array(rig.R, dtype=wp.mat33, device=device)
        self.translation = wp.array(rig.t, dtype=wp.vec3, device=device)
        self.lens = wp.array(_lens(rig), dtype=wp.vec4, device=device)
        self.size = wp.array(rig.size.astype(np.int32), dtype=wp.vec2i, device=device)
        self.observed = wp.zeros((len(rig), rows, words), dtype=wp.uint32, device=device)
        self.foreground = wp.zeros(len(rig), dtype=wp.int32, device=device)
        self.struct = filled(Views, **vars(self))

    def assign(self, rig: CameraRig) -> None:
        """Take other cameras, of the same sizes."""
        self.rotation.assign(rig.R)
        self.translation.assign(rig.t)
        self.lens.assign(_lens(rig))


def _lens(rig: CameraRig) -> np.ndarray:
    """(camera, 4) fx fy cx cy [px]."""
    return np.stack([rig.K[:, 0, 0], rig.K[:, 1, 1], rig.K[:, 0, 2], rig.K[:, 1, 2]], axis=1)
