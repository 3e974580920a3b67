"""Starting Warp without a word."""

from __future__ import annotations

import os

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
