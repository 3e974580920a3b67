"""The device that a run shall use."""

from __future__ import annotations

from mmocap_warp.cli.exit_codes import UsageError
from mmocap_warp.cli.flag_settings import as_flag


def start_warp(device: str = "auto") -> None:
    """Start Warp without its messages and see that ``device`` is there.

    Raises:
        UsageError: this machine has no such device.
    """
    from mmocap_warp.device.resolve import resolve_device, start_quietly

    start_quietly()
    try:
        resolve_device(device)
    except ValueError as error:
        raise UsageError(as_flag(error)) from None
