"""The cores that this process may use; of the processor alone, so that no one waits for Warp to start."""

import os


def available_threads() -> int:
    """CPU cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
