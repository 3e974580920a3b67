"""Cameras and the masks of one frame as arrays on a device, for the kernels that project and count."""

from __future__ import annotations

from typing import Any

import numpy as np

from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.kernels import block
from mmocap_warp.kernels.structs import allocated
from mmocap_warp.kernels.views.projection import Views
from mmocap_warp.masks.observation import words_per_row


def make_views(rig: CameraRig, device: str) -> Any:
    """A rig and its masks, empty at first, in the struct that kernels take.

    Raises:
        ValueError: images so wide that a block cannot hold a row.
    """
    rows, words = int(rig.size[:, 1].max()), words_per_row(int(rig.size[:, 0].max()))
    if 8 * words >= block.WORDS:
        raise ValueError(f"images must be narrower than {4 * block.WORDS} px, got {rig.size[:, 0].max()}")
    cameras = {"rotation": rig.R, "translation": rig.t, "lens": _lens(rig), "size": rig.size.astype(np.int32)}
    return allocated(Views, device, **cameras, observed=(len(rig), rows, words), foreground=len(rig))


def assign_cameras(views: Any, rig: CameraRig) -> None:
    """Let views have other cameras, of the same sizes."""
    views.rotation.assign(rig.R)
    views.translation.assign(rig.t)
    views.lens.assign(_lens(rig))


def _lens(rig: CameraRig) -> np.ndarray:
    """(camera, 4) fx fy cx cy [px]."""
    return np.stack([rig.K[:, 0, 0], rig.K[:, 1, 1], rig.K[:, 0, 2], rig.K[:, 1, 2]], axis=1)
