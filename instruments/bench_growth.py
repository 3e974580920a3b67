"""How the time of the whole evaluation grows with each of its sizes, all others being those of the measure.

The plots have logarithmic axes and a line for each device and renderer: one SVG file a size.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from bench_searches import same_frames

from mmocap_warp.bench.evaluations import evaluations
from mmocap_warp.bench.report_file import Report
from mmocap_warp.bench.workload import SIZE, Workload, workload
from mmocap_warp.body.model import SkinMesh
from mmocap_warp.display.chart import Axis, axes, curve, dots, picture, text
from mmocap_warp.kernels.benchmarks.timing import Case
from mmocap_warp.rigging.decimation import decimate

AXES = ("candidates", "cameras", "pixels", "triangles", "runs")
"""The sizes that are varied; a measurement's group is ``GROUP`` and one of them."""
GROUP = "growth: "
BATCH = {"cpu": 14, "cuda": 2048}
"""Candidates where something else is varied."""
BUDGET = 60
"""Evaluations of a frame where runs are varied: a generation of each part."""

_CANDIDATES = {"cpu": (1, 2, 4, 8, 14, 32, 64), "cuda": (1, 4, 14, 64, 256, 1024, 2048, 4096, 8192)}
_CAMERAS = (1, 2, 4, 7, 14, 28)
_SCALES = (0.25, 0.5, 1.0, 2.0, 4.0)  # of an image's width and height
_TRIANGLES = (650, 1300, None, 10400, 41600)  # None is the body's own mesh
_RUNS = {"cpu": (1, 2, 4, 8, 16), "cuda": (1, 3, 10, 30, 100, 300)}


def growth(load: Workload, device: str) -> Iterator[list[Case]]:
    """The sweeps; a CPU uses one thread."""
    kind = "cpu" if device == "cpu" else "cuda"
    yield from evaluations(load, _CANDIDATES[kind], (1,), device, GROUP + "candidates")
    scaled = [(round(scale * SIZE[0]), round(scale * SIZE[1])) for scale in _SCALES]
    sweeps = {
        "cameras": [workload(cameras=count) for count in _CAMERAS],
        "pixels": [workload(size=size) for size in scaled],
        "triangles": [with_triangles(workload(), count) for count in _TRIANGLES],
    }
    for axis, loads in sweeps.items():
        for one in loads:
            yield from evaluations(one, (BATCH[kind],), (1,), device, GROUP + axis)
    for runs in _RUNS[kind]:
        yield from same_frames(load, (runs,), BUDGET, device, 1, GROUP + "runs")


def with_triangles(load: Workload, triangles: int | None) -> Workload:
    """The load with a body of another tracking mesh, which is its skin too; it has no shapes and no markers.

    Fewer triangles than its own are made by decimation, more by subdivision: 4 times, 16 times as many, and so on.
    """
    if triangles is None:
        return load
    body = load.body
    mesh = body.tracking
    if triangles < len(mesh.face):
        kept, face = decimate(mesh.rest.astype(float), mesh.face, triangles)
        mesh = SkinMesh(mesh.rest[kept], face, mesh.joint[kept], mesh.weight[kept])
    while len(mesh.face) < triangles:
        mesh = _subdivided(mesh)
    vertices = len(mesh.rest)
    other: dict[str, Any] = {"tracking_vertex": np.arange(vertices, dtype=np.int32), "tracking_face": mesh.face}
    other |= {"shape_vertex": np.zeros((0, vertices, 3), np.float32), "shape_joint": body.shape_joint[:0]}
    other |= {"shape_names": (), "marker_names": (), "marker_vertex": np.zeros(0, np.int32)}
    return replace(load, body=replace(body, skin=mesh, **other))


def _subdivided(mesh: SkinMesh) -> SkinMesh:
    """Every triangle cut in four at the middles of its edges: the same surface."""
    sides = np.sort(np.stack([mesh.face, np.roll(mesh.face, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    edge, number = np.unique(sides, axis=0, return_inverse=True)
    ab, bc, ca = (len(mesh.rest) + number.reshape(-1, 3)).T
    a, b, c = mesh.face.T
    face = np.stack([(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]).transpose(2, 0, 1).reshape(-1, 3)
    rest = np.concatenate([mesh.rest, mesh.rest[edge].mean(axis=1)])
    share = np.zeros((len(mesh.rest), mesh.joint.max() + 1), np.float32)
    np.add.at(share, (np.arange(len(mesh.rest))[:, None], mesh.joint), mesh.weight)
    share = np.concatenate([share, share[edge].mean(axis=1)])
    joint = np.argsort(-share, axis=1, kind="stable")[:, :4].astype(np.int32)
    weight = np.take_along_axis(share, joint, axis=1)
    return SkinMesh(rest, face.astype(np.int32), joint, weight / weight.sum(axis=1, keepdims=True))


_WIDTH, _HEIGHT = 640.0, 400.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 76.0, 108.0, 40.0, 52.0  # around the axes; lines are named on the right
_LINE = 15.0  # between the names of lines
_COLOURS = {"raycast": "first", "raster": "second"}
_EACH = f"time of an evaluation, of {BATCH['cpu']} in a call on the CPU and {BATCH['cuda']:,} on the GPU"
_TITLES = {
    "candidates": ("time of a call", "candidates in a call"),
    "cameras": (_EACH, "cameras"),
    "pixels": (_EACH, "pixels of a camera, of which the body fills the same share"),
    "triangles": (_EACH, "triangles"),
    "runs": (f"time of a frame of {BUDGET} evaluations a run", "runs at once"),
}


@dataclass(frozen=True)
class Line:
    """Times [s] against a size, of a renderer on a device; ordered by size."""

    device: str
    renderer: str
    is_gpu: bool
    points: list[tuple[float, float]]

    @property
    def name(self) -> str:
        """What it is called."""
        return f"{'GPU' if self.is_gpu else 'CPU'}, {self.renderer}"

    @property
    def slope(self) -> float:
        """The exponent with which time grows over the last factor of the size."""
        (x0, y0), (x1, y1) = self.points[-2:]
        return math.log(y1 / y0) / math.log(x1 / x0)


def growth_lines(reports: Sequence[Report], axis: str) -> list[Line]:
    """The lines along one of ``AXES``; reports without growth have none. On the CPU, one thread."""
    points: dict[tuple[str, str, bool], list[tuple[float, float]]] = {}
    for report in reports:
        is_gpu = report["kind"] == "cuda"
        for row in (row for row in report["measurements"] if row["group"] == GROUP + axis):
            each = 1 if axis in ("candidates", "runs") else row["evaluations"]
            # One thread's time of the processor is what it took, whatever else the machine did.
            seconds = row["median"] if is_gpu else row["processor"]
            line = points.setdefault((report["device"], row["sizes"]["renderer"], is_gpu), [])
            line.append((row["sizes"][axis], seconds / each))
    return [Line(*key, sorted(values)) for key, values in points.items()]


def growth_plots(reports: Sequence[Report]) -> dict[str, str]:
    """SVG files by the size along their axis."""
    return {axis: _plot(axis, lines) for axis in AXES if (lines := growth_lines(reports, axis))}


def _plot(axis: str, lines: list[Line]) -> str:
    sizes = sorted({size for line in lines for size, _ in line.points})
    times = [seconds for line in lines for _, seconds in line.points]
    x = Axis(sizes[0], sizes[-1], _LEFT, _WIDTH - _RIGHT, tuple(sizes), "{:,}".format, logarithmic=True)
    y = decades(min(times), max(times), _HEIGHT - _BOTTOM, _TOP)
    title, below = _TITLES[axis]
    parts = [axes(x, y, below, title)]
    for line in lines:
        drawn = curve(x, y, line.points, "" if line.is_gpu else "dashed") + dots(x, y, line.points)
        parts.append(f'<g class="{_COLOURS[line.renderer]}">{drawn}</g>')
    ends = [(line.name, _COLOURS[line.renderer], y.at(line.points[-1][1])) for line in lines]
    parts.append(names_of_curves(ends, x.stop + 12))
    return picture((_WIDTH, _HEIGHT), f"{title} against {below}", parts)


def decades(low: float, high: float, start: float, stop: float) -> Axis:
    """A logarithmic axis from the power of ten below ``low`` to the one above ``high``, all powers marked."""
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    powers = tuple(10.0**i for i in range(first, last + 1))
    return Axis(powers[0], powers[-1], start, stop, powers, _time, logarithmic=True)


def names_of_curves(ends: Iterable[tuple[str, str, float]], left: float) -> str:
    """Names from ``left`` on beside the ends of curves, moved up where they would overlap.

    Of each curve ``ends`` has its name, its class, and how high it ends.
    """
    parts, above = [], math.inf
    for name, kind, height in sorted(ends, key=lambda end: -end[2]):
        above = min(height + 4, above - _LINE)
        parts.append(f'<g class="{kind}">{text((left, above), name, "series", "start")}</g>')
    return "".join(parts)


def _time(seconds: float) -> str:
    """A power of ten of seconds, in the unit that suits."""
    unit, size = next(((u, n) for u, n in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)) if seconds > 0.9 * n), ("ns", 1e-9))
    return f"{round(seconds / size):,} {unit}"
