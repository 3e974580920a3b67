"""Who else draws silhouettes, and whether they are installed."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec

PEERS = {"embree": "embreex", "trimesh": "embreex", "opencv": "cv2"}
"""Names of peers, and the modules that they need; trimesh casts its rays with Embree too."""


def missing(names: Sequence[str]) -> list[str]:
    """Those that are not installed."""
    return [name for name in names if find_spec(PEERS[name]) is None]
