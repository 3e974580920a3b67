"""Warp, started so that stdout stays clean, and the device that a run shall use."""

from __future__ import annotations

import os

from mmocap_warp.cli.exit_codes import UsageError
from mmocap_warp.cli.settings import as_flag


def start_warp(device: str = "auto") -> None:
    """Start Warp without its greeting and compiler messages (stdout is for results) and see that ``device`` is there.

    Warp's native code complains about a missing NVIDIA driver whatever the log level, which is no news on a machine
    without a GPU; which device was used is in the result.

    Raises:
        UsageError: this machine has no such device.
    """
    import warp as wp

    from mmocap_warp.tracker import resolve_device

    wp.config.log_level = wp.LOG_WARNING
    stderr = os.dup(2)
    with open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), 2)
        try:
            wp.init()
        finally:
            os.dup2(stderr, 2)
            os.close(stderr)
    try:
        resolve_device(device)
    except ValueError as error:
        raise UsageError(as_flag(error)) from None
