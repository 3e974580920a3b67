"""How the time of the whole evaluation grows with each of its sizes, all others being those of the measure."""

from __future__ import annotations

from collections.abc import Iterator

from mmocap_warp.bench.evaluations import evaluations
from mmocap_warp.bench.searches import same_frames
from mmocap_warp.bench.workload import SIZE, Workload, workload
from mmocap_warp.kernels.benchmarks.case import Case

AXES = ("candidates", "cameras", "pixels", "triangles", "runs")
"""The sizes that are varied; a measurement's group is ``growth: `` and one of them."""
BATCH = {"cpu": 14, "cuda": 2048}
"""Candidates where something else is varied."""
BUDGET = 60
"""Evaluations of a frame where runs are varied: a generation of each part."""

_CANDIDATES = {"cpu": (1, 2, 4, 8, 14, 32, 64), "cuda": (1, 4, 14, 64, 256, 1024, 2048, 4096, 8192)}
_CAMERAS = (1, 2, 4, 7, 14, 28)
_SCALES = (0.25, 0.5, 1.0, 2.0, 4.0)  # of an image's width and height
_TRIANGLES = (650, 1300, None, 10400, 41600)  # None is the body's own mesh
_RUNS = {"cpu": (1, 2, 4, 8, 16), "cuda": (1, 3, 10, 30, 100, 300)}


def group(axis: str) -> str:
    """The group of measurements along an axis."""
    return f"growth: {axis}"


def growth(load: Workload, device: str) -> Iterator[list[Case]]:
    """The sweeps; a CPU uses one thread."""
    kind = "cpu" if device == "cpu" else "cuda"
    batch = (BATCH[kind],)
    yield from evaluations(load, _CANDIDATES[kind], (1,), device, group("candidates"))
    for cameras in _CAMERAS:
        yield from evaluations(workload(cameras=cameras), batch, (1,), device, group("cameras"))
    for scale in _SCALES:
        width, height = (round(scale * extent) for extent in SIZE)
        yield from evaluations(workload(size=(width, height)), batch, (1,), device, group("pixels"))
    for triangles in _TRIANGLES:
        yield from evaluations(workload(triangles=triangles), batch, (1,), device, group("triangles"))
    for runs in _RUNS[kind]:
        yield from same_frames(load, (runs,), BUDGET, device, 1, group("runs"))
