"""What the project holds itself to: for each figure a floor and an aim, beside what a report measured."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from mmocap_warp.bench.evaluations import EVALUATION
from mmocap_warp.bench.peers import PEER
from mmocap_warp.bench.searches import FRAME, GENERATION
from mmocap_warp.bench.tables import Report, Row, Table, pairs


@dataclass(frozen=True)
class Aim:
    """A figure that shall be reached.

    Attributes:
        what: it is.
        floor: to pass.
        aim: to be proud of.
        unit: of all three.
        less: whether lower is better.
        kind: of the device, ``cpu`` or ``cuda``.
        measured: finds it in a report; None where it was not measured.
    """

    what: str
    floor: float
    aim: float
    unit: str
    less: bool
    kind: str
    measured: Callable[[Report], float | None]


def _rows(report: Report, group: str, **sizes: object) -> list[Row]:
    """Measurements of a group with these sizes."""
    rows = [row for row in report["measurements"] if row["group"] == group]
    return [row for row in rows if all(row["sizes"].get(name) == value for name, value in sizes.items())]


def _evaluation(renderer: str, group: str = EVALUATION) -> Callable[[Report], float | None]:
    """Of one evaluation by one thread, time of the processor: what else the machine does is not in it [ms]."""

    def measured(report: Report) -> float | None:
        rows = _rows(report, group, renderer=renderer, threads=1)
        return 1e3 * rows[0]["processor"] / rows[0]["evaluations"] if rows else None

    return measured


def _against_embree(renderer: str) -> Callable[[Report], float | None]:
    def measured(report: Report) -> float | None:
        embree = [row for row in _rows(report, PEER) if row["name"] == "embree"]
        ours = _rows(report, PEER, renderer=renderer)
        return embree[0]["median"] / ours[0]["median"] if embree and ours else None

    return measured


def _pair(group: str, size: str, renderer: str, each: bool) -> Callable[[Report], float | None]:
    """How many times as quick, or with ``each`` how many times as much in that time."""

    def measured(report: Report) -> float | None:
        for one, many in pairs(_rows(report, group, renderer=renderer), size):
            return one["median"] / many["median"] * (many["sizes"][size] if each else 1)
        return None

    return measured


def _generation(name: str) -> Callable[[Report], float | None]:
    """Of a generation from ask to tell [ms]."""

    def measured(report: Report) -> float | None:
        rows = [row for row in _rows(report, GENERATION, renderer="raycast") if row["name"] == name]
        return 1e3 * rows[0]["median"] if rows else None

    return measured


def _most_a_second(renderer: str) -> Callable[[Report], float | None]:
    """Evaluations a second of the best batch of 2,048 or more."""

    def measured(report: Report) -> float | None:
        rows = [row for row in _rows(report, EVALUATION, renderer=renderer) if row["sizes"]["candidates"] >= 2048]
        return max((row["evaluations"] / row["median"] for row in rows), default=None)

    return measured


def _frame(seconds: bool) -> Callable[[Report], float | None]:
    """Of a frame of 500 evaluations, seconds, or frames a second."""

    def measured(report: Report) -> float | None:
        rows = [row for row in _rows(report, FRAME, renderer="raycast", budget=500, runs=1) if row["name"] == "h-cmaes"]
        if not rows:
            return None
        return rows[0]["median"] if seconds else 1.0 / rows[0]["median"]

    return measured


AIMS = (
    Aim("one thread, raycast, an evaluation", 2.4, 1.0, "ms", True, "cpu", _evaluation("raycast")),
    Aim("one thread, raycast, against Embree's any-hit", 15, 15, "x", False, "cpu", _against_embree("raycast")),
    Aim("one thread, raster, an evaluation", 1.2, 0.4, "ms", True, "cpu", _evaluation("raster")),
    Aim("one thread, raster, against Embree's any-hit", 40, 40, "x", False, "cpu", _against_embree("raster")),
    Aim(
        "two threads against one, raycast", 1.6, 1.9, "x", False, "cpu", _pair(EVALUATION, "threads", "raycast", False)
    ),
    Aim("two threads against one, raster", 1.6, 1.9, "x", False, "cpu", _pair(EVALUATION, "threads", "raster", False)),
    Aim("H-CMA-ES frame of 500 evaluations, raycast", 0.6, 0.2, "s", True, "cpu", _frame(seconds=True)),
    Aim("a generation of H-CMA-ES, raycast", 0.30, 0.09, "ms", True, "cuda", _generation("h-cmaes: mean of the parts")),
    Aim("a generation of CMA-ES, raycast", 0.80, 0.30, "ms", True, "cuda", _generation("cmaes: whole body")),
    Aim("batch of 2,048 or more, raycast", 70e3, 400e3, "evaluations/s", False, "cuda", _most_a_second("raycast")),
    Aim("batch of 2,048 or more, raster", 450e3, 1.5e6, "evaluations/s", False, "cuda", _most_a_second("raster")),
    Aim("H-CMA-ES, 500 evaluations a frame, raycast", 60, 200, "frames/s", False, "cuda", _frame(seconds=False)),
    Aim("30 runs at once, raycast", 10, 25, "x one run's", False, "cuda", _pair(FRAME, "runs", "raycast", True)),
)


def aims_table(reports: Sequence[Report]) -> Table:
    """Floors, aims, and what the report of that kind of device measured."""
    rows = []
    for aim in AIMS:
        of_kind = [report for report in reports if report["kind"] == aim.kind]
        value = aim.measured(of_kind[0]) if of_kind else None
        where = "CPU" if aim.kind == "cpu" else "GPU"
        limits = (f"{_number(aim.floor)} {aim.unit}", f"{_number(aim.aim)} {aim.unit}" if aim.aim != aim.floor else "")
        reached = "" if value is None else f"{_number(value)} {aim.unit}"
        rows.append((f"{where}, {aim.what}", *limits, reached, "" if value is None else _verdict(aim, value)))
    return Table("aims", ("", "floor", "aim", "measured", ""), rows)


def _verdict(aim: Aim, value: float) -> str:
    for limit, word in ((aim.aim, "aim"), (aim.floor, "floor")):
        if value <= limit if aim.less else value >= limit:
            return word
    return "missed"


def _number(value: float) -> str:
    return f"{value:,.0f}" if value >= 100 else f"{value:.3g}"
