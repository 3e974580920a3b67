"""All device code: Warp arrays in, Warp arrays out. Knows no class of ``mmocap_warp``."""

import threading
from typing import Any

import warp as wp

# Of a module that two threads load at once, Warp 1.19 keeps the second copy, and the first is gone while it may still
# run. A module is loaded when a kernel of it is first launched, so here one thread at a time does that.
_load, _loading = wp.Module.load, threading.RLock()


def _load_alone(*arguments: Any, **named: Any) -> Any:
    with _loading:
        return _load(*arguments, **named)


wp.Module.load = _load_alone
