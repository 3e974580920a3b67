"""What ``--against`` may name: others that are run beside us."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from typing import NamedTuple


class Peer(NamedTuple):
    """What a peer needs to be installed.

    Attributes:
        module: its name.
        extra: of this package, which installs it.
    """

    module: str
    extra: str


DRAWING = {"embree": Peer("embreex", "bench"), "trimesh": Peer("embreex", "bench"), "opencv": Peer("cv2", "bench")}
"""Those that draw silhouettes; trimesh casts its rays with Embree too."""

OPTIMIZING = {name: Peer(name, "peers") for name in ("evosax", "cmaes", "cma")}
"""Those that have a CMA-ES."""

PEERS = DRAWING | OPTIMIZING


def missing(names: Sequence[str]) -> list[str]:
    """Those that are not installed."""
    return [name for name in names if find_spec(PEERS[name].module) is None]
