"""Errors that come from where Warp keeps compiled kernels."""

from __future__ import annotations

import os
import sys
import traceback

_LOADING = {("context.py", "load"), ("build.py", "init_kernel_cache")}
"""Warp's functions, by file, that read and write its kernel cache."""


def kernel_cache_at_fault(error: Exception) -> str | None:
    """What is wrong with the kernel cache and how to move it, if an error came from there; else None.

    Warp raises a plain ``Exception`` for a kernel that cannot be loaded, ``OSError`` where it cannot write, and
    ``ValueError`` for a damaged description. An error in a kernel's own code is of other types.
    """
    places = {(os.path.basename(frame.filename), frame.name) for frame in traceback.extract_tb(error.__traceback__)}
    of_a_file = isinstance(error, (OSError, ValueError)) or str(error).startswith("Failed to load")
    if not (places & _LOADING and of_a_file and "warp" in sys.modules):
        return None
    import warp as wp

    folder = wp.config.kernel_cache_dir or os.environ.get("WARP_CACHE_PATH", "")
    remedy = "delete that folder, or name another in the environment's variable WARP_CACHE_PATH"
    return f"{folder}: the compiled kernels kept there cannot be used ({error}); {remedy}"
