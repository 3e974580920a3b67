"""What the statistics and the report need of each cell: a few kilobytes of the megabytes that a result is."""

import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.resources import files
from typing import Any, Self

import numpy as np

from mmocap_warp.result.pose_errors import nanmean, nanmedian
from mmocap_warp.study.cell import Cell, CellResult
from mmocap_warp.study.definition import Plan
from mmocap_warp.study.paper import ALGORITHM_ORDER
from mmocap_warp.study.sequences import FURTHER_PLANS
from mmocap_warp.synthesis.walkers import STRANGERS
from mmocap_warp.tracking.algorithms import ALGORITHMS, CONTOUR_TRACKERS


@dataclass(frozen=True)
class Measure:
    """Something that results are judged by."""

    key: str  # the measure's name in a ``CellResult``
    label: str  # the measure's name for people
    unit: str  # values are shown in it; empty for a pure number
    factor: float  # from the result's unit to ``unit``
    decimals: int  # of a value that is shown
    higher_is_better: bool = False  # else it is an error, and lower is better
    per_frame: bool = True  # whether it is measured in every frame, or once a run

    @property
    def bracket(self) -> str:
        """What follows the label at the head of a table: the unit in brackets, if it has one."""
        return f" [{self.unit}]" if self.unit else ""

    @property
    def title(self) -> str:
        """The label with the unit in brackets, if it has one."""
        return self.label + self.bracket

    @property
    def sign(self) -> int:
        """Times this, a lower value is better."""
        return -1 if self.higher_is_better else 1


_LISTED: dict[str, list] = tomllib.loads(files(__package__).joinpath("measures.toml").read_text("utf-8"))
MEASURE_OF = {key: Measure(key, *of) for key, of in _LISTED.items()}

MEASURES: tuple[Measure, ...] = tuple(MEASURE_OF.values())
"""The first that a study knows is the one that it is judged by."""

EQ_20 = ("eq20_as_printed", "marker_error")
"""The two readings of the paper's Eq. 20, see :mod:`mmocap_warp.result.marker_errors`."""

BASELINES = {"stands-still": "stands still", "constant-velocity": "constant velocity"}
"""What no tracker should fall behind, with their labels, see :mod:`mmocap_warp.study.baselines`."""

_EXTRAS = {"polish": " + polish", "solved": ", body solved"}
_OF_STRANGERS = frozenset(name for name, plan in FURTHER_PLANS.items() if plan.person in STRANGERS)


def algorithm_label(name: str) -> str:
    """An algorithm's label; its name alone where this process has not registered it, as another may have tracked it."""
    if name in BASELINES:
        return BASELINES[name]
    base, *extras = name.split("+")
    label = ALGORITHMS[base].label if base in ALGORITHMS else base
    return label + "".join(_EXTRAS.get(extra, f"+{extra}") for extra in extras)


@dataclass(frozen=True, order=True)
class Contender:
    """One of the trackers that are compared: an algorithm with a model and a budget."""

    algorithm: str
    dof: int
    evaluations: int

    def __str__(self) -> str:
        """The paper's ALG(DOF, EVAL); of a baseline, its name."""
        label = algorithm_label(self.algorithm)
        if self.algorithm in BASELINES:
            return label
        return f"{label}{'' if _is_search(self.algorithm) else ' '}({self.dof},{self.evaluations})"


def contender(cell: Cell) -> Contender:
    """Whose cell it is."""
    return Contender(cell.algorithm, cell.dof, cell.evaluations)


@dataclass(frozen=True)
class CellSummary:
    """A cell's result in short; every measure in the unit that it is shown in."""

    cell: Cell
    seeds: np.ndarray  # (run,)
    frames: np.ndarray  # (frame,) frame numbers
    runs: dict[str, np.ndarray]  # (run,) by measure: the mean over frames
    # (5,) by measure of frames: minimum, quartiles and maximum over all frames of all runs
    spread: dict[str, np.ndarray]
    curve: dict[str, np.ndarray]  # (frame,) by measure of frames: the median over runs
    floors: dict[str, float]  # by measure: what the tracked body scores at the true angles, where that is known
    frames_lost: float  # share of frames without a view to judge by
    typical_pose: np.ndarray  # (frame, 51), poses of the run whose main measure is the median of all runs
    typical_curve: np.ndarray  # (frame,), that run's main measure; NaN where it is unknown
    seconds: float  # of searching, in all runs and frames together
    evaluations: int  # in all runs and frames together
    meta: dict  # as in ``CellResult``


def _rank(result: CellResult, plan: Plan | None) -> tuple[bool, int, str]:
    """By what one of a cell's results counts: whether seeds, and then frames, are its plan's, and when it was begun."""
    begun = str(result.meta.get("started", ""))
    if plan is None:
        return False, 0, begun
    first, most, frames = plan.config.seed, plan.clip.frames, len(result.frames)
    is_planned = result.seeds.tolist() == [*range(first, first + plan.config.runs)]
    return is_planned, frames if most is None else int(frames == most), begun


def summarise(result: CellResult) -> CellSummary:
    """The short form of a cell's result; what it does not know is absent."""
    frames, once = len(result.frames), result.per_run
    runs, spread, curve, floors = {}, {}, {}, {}
    known = np.isfinite(result.per_frame["mpjpe"]).any(axis=0).sum() if "mpjpe" in result.per_frame else frames
    counted = {"limb_lost": max(known, 1), "frames_lost": frames}  # in these frames, of which a share is shown
    for measure in MEASURES:
        key, values = measure.key, _values(result, measure)
        if values is not None:
            runs[key] = nanmean(values, axis=1)
            spread[key], curve[key] = np.nanquantile(values, (0, 0.25, 0.5, 0.75, 1)), nanmedian(values)
            floor = float(np.mean(once.get(f"{key}_floor", np.nan))) * measure.factor
            floors |= {key: floor} if np.isfinite(floor) else {}
        elif key in once and np.isfinite(once[key]).all():
            runs[key] = once[key] * measure.factor / counted.get(key, 1)
    typical, main = _typical(result)
    pose = result.pose[typical if len(result.pose) > 1 else 0].copy()
    middle = np.full(frames, np.nan) if main is None else main[typical].copy()
    lost, seconds = float(np.mean(once.get("frames_lost", 0.0))) / frames, float(np.mean(once.get("seconds", np.nan)))
    spent, of = int(np.sum(once.get("evaluations", 0))), (result.cell, result.seeds, result.frames)
    return CellSummary(*of, runs, spread, curve, floors, lost, pose, middle, seconds, spent, result.meta)


def with_typical_pose(result: CellResult) -> CellResult:
    """The result with the poses of its typical run alone: all that a report draws, and a thirtieth of 30 seeds'."""
    typical = 0 if len(result.pose) == 1 else _typical(result)[0]
    return replace(result, pose=result.pose[typical : typical + 1])


@dataclass
class StudySummary:
    """All cells of a study, and the grid that those of its main preset span.

    The grid is what the paper compares: searches with the body as given, of people in the family of the tracker's
    bodies. Beside it stand other trackers, strangers and baselines.
    """

    cells: dict[Cell, CellSummary]  # summary by cell, of all presets; the grid may have gaps
    # what needs no tracking, by sequence and a name of ``BASELINES``
    baselines: Mapping[tuple[str, str], CellSummary] = field(default_factory=dict)
    # seconds that a frame takes where a single run is tracked at a time, by contender; empty where unknown
    alone: Mapping[Contender, float] = field(default_factory=dict)
    planned: frozenset[Cell] = frozenset()  # the cells that should be there, as far as that is known
    # what :func:`mmocap_warp.study.study_tables.rank` has made of it so far
    rankings: dict[tuple, Any] = field(default_factory=dict, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        presets = [cell.preset for cell in self.cells]
        names = sorted(set(presets))
        # of most cells: the one that the study is about; of equally many the default one
        self.preset: str = max(names, key=lambda name: (presets.count(name), name == Cell.preset), default="")
        self.presets = sorted(names, key=lambda name: name != self.preset)  # all of them, the main one first
        main = [cell for cell in self.cells if cell.preset == self.preset]
        searches = [cell for cell in main if _is_search(cell.algorithm)] or main
        # of the main preset and compared as the paper does; all where none is such
        self.grid = [cell for cell in searches if cell.sequence not in _OF_STRANGERS] or searches
        self.sequences = _in_action_order(cell.sequence for cell in self.grid)  # of the grid
        # people outside the family of the tracker's bodies, who stand apart from the grid
        self.strangers = _in_action_order(({cell.sequence for cell in main} & _OF_STRANGERS) - set(self.sequences))
        self.algorithms = in_order(cell.algorithm for cell in self.grid)  # of the grid, see :func:`in_order`
        # Those that search part by part: one half of the paper's Fig. 7 and, as far as its text tells, Table 6; and
        # those that search all at once: Table 7. What this process has not registered is in neither.
        known = [name for name in self.algorithms if name in ALGORITHMS]
        self.hierarchical = [name for name in known if ALGORITHMS[name].hierarchical]
        self.holistic = [name for name in known if not ALGORITHMS[name].hierarchical]
        self.models = sorted({cell.dof for cell in self.grid}, reverse=True)  # degrees of freedom, the most first
        self.budgets = sorted({cell.evaluations for cell in self.grid})  # evaluations per frame, ascending
        every = self.cells.values()
        # what some cell knows, the one that the study is judged by first
        self.measures = [measure for measure in MEASURES if any(measure.key in cell.runs for cell in every)]
        self.evaluations = sum(cell.evaluations for cell in every)  # spent in all cells
        place = {name: number for number, name in enumerate([*CONTOUR_TRACKERS, *ALGORITHMS])}

        def rank(who: Contender) -> tuple[bool, int, Contender]:
            return "+solved" not in who.algorithm, place.get(who.algorithm.partition("+")[0], len(place)), who

        # Trackers of the main preset that are not of the grid: ours. The body solved before the body as given.
        self.others = sorted({contender(cell) for cell in main if cell.algorithm not in self.algorithms}, key=rank)
        with_baseline = {name for _, name in self.baselines}
        # the baselines that are known
        self.baseline_contenders = [Contender(name, self.models[0], 0) for name in BASELINES if name in with_baseline]
        compared = [Contender(name, self.models[0], budget) for name in self.algorithms for budget in self.budgets]
        # all that can be compared with the larger model: our trackers, the grid's, the baselines
        self.contenders = [*self.others, *compared, *self.baseline_contenders]

    @classmethod
    def of(cls, results: Iterable[CellResult], plans: Iterable[Plan] = ()) -> Self:
        """Summarise results one by one, so that only one of them is in memory at a time.

        Where several are of the same cell, one with the seeds and frames of its plan counts, or that started last.
        """
        best: dict[Cell, tuple[tuple[bool, int, str], CellSummary]] = {}
        plan_of = {plan.cell: plan for plan in plans}
        for result in results:
            rank = _rank(result, plan_of.get(result.cell))
            if result.cell not in best or best[result.cell][0] <= rank:
                best[result.cell] = rank, summarise(result)
        return cls({cell: summary for cell, (_, summary) in best.items()})

    def of_grid(self, **of: Any) -> list[CellSummary]:
        """The grid's cells, or those of one algorithm, number of degrees of freedom or the like."""
        return [self.cells[cell] for cell in self.grid if all(getattr(cell, key) == value for key, value in of.items())]

    def find(self, sequence: str, who: Contender) -> CellSummary | None:
        """A cell of the main preset; None where the grid has a gap. A baseline's is of every model and budget."""
        if who.algorithm in BASELINES:
            return self.baselines.get((sequence, who.algorithm))
        return self.cells.get(Cell(sequence, who.algorithm, who.dof, who.evaluations, self.preset))

    def known(self, who: Contender, sequences: Iterable[str], measure: Measure) -> dict[str, CellSummary]:
        """A contender's cells of the main preset by sequence, where the measure is known of them."""
        found = {name: self.find(name, who) for name in sequences}
        return {name: cell for name, cell in found.items() if cell is not None and measure.key in cell.runs}

    def cells_of(self, contenders: Iterable[Contender], measure: Measure) -> list[CellSummary]:
        """What contenders have tracked of the grid's sequences, where the measure is known of it."""
        return [cell for who in contenders for cell in self.known(who, self.sequences, measure).values()]

    def level(self, who: Contender, measure: Measure, sequences: Sequence[str] | None = None) -> float:
        """Mean of a measure over runs and sequences, the grid's by default; NaN unless it is known of every one."""
        sequences = self.sequences if sequences is None else sequences
        cells = self.known(who, sequences, measure)
        if not sequences or len(cells) < len(sequences):
            return float("nan")
        return float(np.mean([cell.runs[measure.key].mean() for cell in cells.values()]))

    def milliseconds(self, who: Contender) -> float:
        """Of a frame of a run that is tracked alone; NaN where unknown. Solving the body is not in it."""
        body_as_given = replace(who, algorithm=who.algorithm.replace("+solved", ""))
        return 1000 * self.alone.get(who, self.alone.get(body_as_given, float("nan")))

    def floor(self, measure: Measure, sequences: Iterable[str]) -> float:
        """What the tracked bodies score at the true angles, mean over sequences; NaN where one's is unknown."""
        of = {cell.sequence: self.cells[cell].floors.get(measure.key, np.nan) for cell in self.grid}
        return float(np.mean([of[sequence] for sequence in sequences]))


def seconds_alone(results: Iterable[CellResult]) -> dict[Contender, float]:
    """Seconds that a frame takes, by contender: mean over those results that are of one run, tracked alone."""
    of: dict[Contender, list[float]] = {}
    for result in (result for result in results if len(result.seeds) == 1):
        of.setdefault(contender(result.cell), []).append(float(result.per_run["seconds"][0]) / len(result.frames))
    return {who: float(np.mean(each)) for who, each in of.items()}


def in_order(names: Iterable[str], order: Sequence[str] = (*ALGORITHM_ORDER, *ALGORITHMS)) -> list[str]:
    """Each name once: as in ``order``, then the rest by the alphabet. Algorithms: the paper's, then as registered."""
    return sorted(set(names), key=lambda name: (order.index(name) if name in order else len(order), name))


def _is_search(algorithm: str) -> bool:
    """Whether a tracker searches and does nothing else, with the body as given."""
    return "+" not in algorithm and algorithm not in CONTOUR_TRACKERS


def _in_action_order(sequences: Iterable[str]) -> list[str]:
    """Each once, grouped by action: Walking, Gestures, Box, then others; by subject within."""
    of = {sequence: sequence.rpartition("/")[::-2] for sequence in sequences}  # action and subject
    actions = in_order((action for action, _ in of.values()), ("Walking", "Gestures", "Box"))
    return sorted(of, key=lambda sequence: (actions.index(of[sequence][0]), of[sequence][1]))


def _values(result: CellResult, measure: Measure) -> np.ndarray | None:
    """(run, frame) what a result says of a measure, in the unit that it is shown in; None unless of every run."""
    if not measure.per_frame or measure.key not in result.per_frame:
        return None
    values = result.per_frame[measure.key].astype(np.float64) * measure.factor
    return values if np.isfinite(values).any(axis=1).all() else None


def _typical(result: CellResult) -> tuple[int, np.ndarray | None]:
    """The run in the middle by its mean of the first measure that is known, the better of two; and that measure."""
    main = next((values for measure in MEASURES if (values := _values(result, measure)) is not None), None)
    if main is None:
        return 0, None
    return int(np.argsort(nanmean(main, axis=1), kind="stable")[(len(main) - 1) // 2]), main
