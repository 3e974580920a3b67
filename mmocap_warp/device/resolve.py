"""The machine that Warp runs on: starting it, and its devices and free memory."""

import os
import sys
from pathlib import Path

import warp as wp


def start_quietly() -> None:
    """Start Warp without its greeting and compiler messages: a program's stdout is for its results.

    Warp's native code complains about a missing NVIDIA driver whatever the log level, which is no news on a machine
    without a GPU; which device was used is in the result.
    """
    wp.config.log_level = wp.LOG_WARNING
    stderr = os.dup(2)
    with open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), 2)
        try:
            wp.init()
        finally:
            os.dup2(stderr, 2)
            os.close(stderr)


def resolve_device(name: str) -> str:
    """``auto`` is the first CUDA device, or the CPU without one; a ValueError if there is no such device here."""
    if name == "auto":
        return "cuda:0" if wp.is_cuda_available() else "cpu"
    known = [device.alias for device in wp.get_devices()]
    wanted = "cuda:0" if name == "cuda" else name
    if wanted not in known:
        raise ValueError(f"device must be auto or one of {known}, got {name!r}")
    return wanted


def device_kind(device: str) -> str:
    """``cpu`` or ``cuda``: results of one kind are the same bits on any number of such devices."""
    return "cpu" if resolve_device(device) == "cpu" else "cuda"


def free_memory(device: str) -> int | None:
    """Bytes that a device has left; None where nothing tells."""
    if device != "cpu":
        return wp.get_device(device).free_memory
    table = Path("/proc/meminfo")
    if table.exists():
        available = next(line for line in table.read_text().splitlines() if line.startswith("MemAvailable"))
        return 1024 * int(available.split()[1])
    if sys.platform == "win32" or "SC_PHYS_PAGES" not in os.sysconf_names:
        return None
    return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
