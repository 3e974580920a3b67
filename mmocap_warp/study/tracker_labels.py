"""What trackers and baselines are called in tables and figures."""

from __future__ import annotations

from mmocap_warp.tracking.algorithms import ALGORITHMS

BASELINES = {"stands-still": "stands still", "constant-velocity": "constant velocity"}
"""What no tracker should fall behind, with their labels, see :mod:`mmocap_warp.study.baselines`."""

_EXTRAS = {"polish": " + polish", "solved": ", body solved"}


def algorithm_label(name: str) -> str:
    """An algorithm's label; its name alone where this process has not registered it, as another may have tracked it."""
    if name in BASELINES:
        return BASELINES[name]
    base, *extras = name.split("+")
    label = ALGORITHMS[base].label if base in ALGORITHMS else base
    return label + "".join(_EXTRAS.get(extra, f"+{extra}") for extra in extras)


def mark_class(name: str) -> str:
    """The class of an algorithm's marks in figures."""
    return "a-" + name.replace("+", "-")
