"""The figures of docs/study, from its data: ``python instruments/study_figures.py`` writes docs/study/README.md anew.

docs/study/README.in is that page with ``{{FUNCTION WORD ...}}`` in place of each figure. A function is a method of
``StudyFigures``. Its words choose cells in any order: a sequence, ``nine`` or ``strangers``; an algorithm or ``eight``;
28 or 39 degrees of freedom; evaluations; a preset of radii; and beside them a column of results.csv and decimals such
as ``.2``. Of several words of a kind each counts. By default: MPJPE, nine sequences, 39, the main preset, .1.
"""

from __future__ import annotations

import csv
import re
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from pathlib import Path

import numpy as np
from paper_claims import CLAIMS, Finding, check_claims
from study_cells import FIRST_COMMIT, FOLDER, measure_of, read_rows, study_of

from mmocap_warp.study import statistics
from mmocap_warp.study.cell import Cell
from mmocap_warp.study.paper import ALGORITHM_ORDER, GRID_EVALUATIONS, average_ranks, printed_ranks
from mmocap_warp.study.report_setting import pace_of
from mmocap_warp.study.study_tables import Ranking, by_algorithm, by_model, model_differences
from mmocap_warp.study.summary import MEASURE_OF, Contender, Measure, algorithm_label

NINE = tuple(f"S{subject}/{action}" for action in ("Walking", "Gestures", "Box") for subject in (1, 2, 3))
STRANGERS = ("Child/Walking", "Uneven/Walking", "Skirt/Walking")
GROUPS = {"eight": ALGORITHM_ORDER, "nine": NINE, "strangers": STRANGERS}
PRESETS = ("recording", "common", "paper-rotation", "paper-translation", "paper")
EVALUATIONS_OF = {"search-contour": 120, "contour": 0}
"""Of the trackers that have one budget."""

_SHOWN = (
    *product(("search-contour+solved", "search-contour"), (39,), (120,)),
    *product(("contour+solved", "contour"), (39,), (0,)),
    *product(("h-cmaes+polish",), (39,), (100, 500)),
    *product(("h-cmaes",), (39,), (500, 1500, 3000)),
    *product(("h-cmaes",), (28,), (1500, 3000)),
    *product(("h-pso", "h-de"), (39,), (3000,)),
    *product(("cmaes", "pso", "psapf", "apf"), (39,), (3000,)),
    *product(("h-pso", "psapf"), (28,), (3000,)),
    ("de", 39, 1500),
)
"""Algorithms, models and budgets of the page's table of means."""


@dataclass(frozen=True)
class Choice:
    """What the words of a figure choose."""

    cells: list[Cell]
    column: str
    decimals: int

    def text(self, value: float) -> str:
        """A value as the page shows it."""
        return f"{value:.{self.decimals}f}"


class StudyFigures:
    """The rows of results.csv, the times beside them, and what the page says of both.

    Raises:
        KeyError: where a figure asks for a cell that is missing.
    """

    def __init__(self, folder: Path = FOLDER) -> None:
        self.rows = read_rows(folder)
        with (folder / "times.csv").open(encoding="utf-8", newline="") as lines:
            times = list(csv.DictReader(lines))
        self.times = {(row["algorithm"], int(row["evaluations"])): row["ms_a_frame"] for row in times}
        self.columns = set(next(iter(self.rows.values())))
        self.study = study_of(self.rows)

    def fill(self, template: str) -> str:
        """The template with its figures."""
        return re.sub(r"\{\{(\w+) ?(.*?)\}\}", lambda figure: getattr(self, figure[1])(*figure[2].split()), template)

    def choose(self, words: tuple[str, ...]) -> Choice:
        """The cells that words choose, whether they are there or not."""
        sequences, algorithms, models, budgets, presets = [], [], [], [], []
        column, decimals = "mpjpe_mm", 1
        for word in words:
            if word in self.columns:
                column = word
            elif re.fullmatch(r"\.\d", word):
                decimals = int(word[1])
            elif word.isdigit():
                (models if word in ("28", "39") else budgets).append(int(word))
            elif word in PRESETS:
                presets.append(word)
            elif "/" in word or word in ("nine", "strangers"):
                sequences += GROUPS.get(word, (word,))
            else:
                algorithms += GROUPS.get(word, (word,))
        cells = [
            Cell(sequence, name, dof, budget, preset)
            for name in algorithms
            for dof, budget in product(models or [39], budgets or [EVALUATIONS_OF[name.removesuffix("+solved")]])
            for preset, sequence in product(presets or ["recording"], sequences or NINE)
        ]
        return Choice(cells, column, decimals)

    def values(self, choice: Choice) -> np.ndarray:
        """The chosen column of the chosen cells, all of which must be there."""
        return np.array([float(self.rows[cell][choice.column]) for cell in choice.cells])

    # ---- Figures of cells.

    def lines(self) -> str:
        """How many cells there are."""
        return str(len(self.rows))

    def have(self, *words: str) -> str:
        """How many of the chosen cells there are."""
        cells = self.choose(words).cells
        return f"{sum(cell in self.rows for cell in cells)} of {len(cells)}"

    def lacking(self, *words: str) -> str:
        """How many of the chosen cells there are not."""
        return str(sum(cell not in self.rows for cell in self.choose(words).cells))

    def later(self) -> str:
        """Which cells are not of the first commit, in words."""
        texts = []
        for commit in sorted({row["commit"] for row in self.rows.values()} - {FIRST_COMMIT}):
            rows = {cell: row for cell, row in self.rows.items() if row["commit"] == commit}
            eight = sum(cell.algorithm in ALGORITHM_ORDER for cell in rows)
            whose = [f"{eight} of the eight"] * (eight > 0) + [f"{len(rows) - eight} of ours"] * (eight < len(rows))
            days = " and ".join(sorted({row["started"][:10] for row in rows.values()}))
            devices = " and ".join(sorted({row["device"] for row in rows.values()}))
            texts.append(f"{' and '.join(whose)} ({commit}, {days}, {devices})")
        return _listed(texts)

    def not_run(self) -> str:
        """A sentence on the eight's missing cells, all with 3000 evaluations and 28 degrees of freedom."""
        texts = []
        for name in ALGORITHM_ORDER:
            there = [sequence for sequence in NINE if Cell(sequence, name, 28, 3000) in self.rows]
            gone = [sequence for sequence in NINE if sequence not in there]
            if gone:
                few = f"on {', '.join(gone)}" if len(gone) <= len(there) else f"but on {', '.join(there)}"
                texts.append(f"{algorithm_label(name)} {few if there else 'on all nine'}")
        cells = "of the paper's 432 cells"
        if not texts:
            return f"None {cells} is missing."
        lacking = self.lacking("eight", "500", "1500", "3000", "39", "28")
        where = f"with 3000 evaluations and 28 degrees of freedom: {'; '.join(texts)}"
        return f"Not run: {lacking} {cells}, {where}."

    def best_each(self, *words: str) -> str:
        """The error of the best of the eight at 500 evaluations on each chosen sequence."""
        sequences = [cell.sequence for cell in self.choose((*words, "h-cmaes", "500")).cells]
        of = [min(self.values(self.choose((sequence, "eight", "500")))) for sequence in sequences]
        return _listed([f"{value:.1f}" for value in of])

    def seeds(self, *words: str) -> str:
        """How many runs the chosen cells have, which must agree."""
        (seeds,) = {self.rows[cell]["seeds"] for cell in self.choose(words).cells if cell in self.rows}
        return seeds

    def mean(self, *words: str) -> str:
        """Mean over the chosen cells."""
        choice = self.choose(words)
        return choice.text(float(self.values(choice).mean()))

    def shared(self, *words: str) -> str:
        """Mean over those chosen cells that there are."""
        choice = self.choose(words)
        there = [cell for cell in choice.cells if cell in self.rows]
        return choice.text(float(self.values(Choice(there, choice.column, choice.decimals)).mean()))

    def each(self, *words: str) -> str:
        """The value of each chosen cell."""
        choice = self.choose(words)
        return _listed(map(choice.text, self.values(choice)))

    def less(self, *words: str) -> str:
        """Mean of the cells before the word ``than`` less that of those behind it."""
        first, second = self._two(words)
        return first.text(float((self.values(first) - self.values(second)).mean()))

    def gains(self, *words: str) -> str:
        """Each of the cells before the word ``than`` less that behind it."""
        first, second = self._two(words)
        return _listed(map(first.text, self.values(first) - self.values(second)))

    def signed_rank(self, *words: str) -> str:
        """Wilcoxon's p of the cells before the word ``than`` against those behind it."""
        return _p(statistics.signed_rank(np.stack([self.values(choice) for choice in self._two(words)], axis=1)))

    def action(self, name: str) -> str:
        """Mean over the eight on an action or a subject, of the models and budgets of which no cell is missing."""
        sequences = [sequence for sequence in NINE if name in sequence.split("/")]
        whole = [
            model
            for model in product((39, 28), (500, 1500, 3000))
            if all(Cell(*of, *model) in self.rows for of in product(NINE, ALGORITHM_ORDER))
        ]
        cells = [Cell(*of, *model) for of in product(sequences, ALGORITHM_ORDER) for model in whole]
        return f"{self.values(Choice(cells, 'mpjpe_mm', 0)).mean():.0f}"

    def ms(self, *words: str) -> str:
        """Milliseconds of a frame of a single run on an H200."""
        cell = self.choose(words).cells[0]
        return self.times[cell.algorithm, cell.evaluations]

    def pace(self) -> str:
        """Millions of evaluations a second of the eight."""
        return f"{self._rate / 1e6:.2f}"

    def hours(self) -> str:
        """How long the paper's grid takes at that pace."""
        return f"{GRID_EVALUATIONS / self._rate / 3600:.1f}"

    # ---- Figures of ranks.

    def rank(self, *words: str) -> str:
        """Average rank among the eight of the same model and budget."""
        cell, measure = self._ranked(words)
        row = self._of_budget(cell, measure).row(cell.algorithm, cell.dof, cell.evaluations)
        return f"{row.comparison.rank:.2f}"

    def printed(self, *words: str) -> str:
        """The same in the paper."""
        cell = self.choose(words).cells[0]
        return f"{printed_ranks(cell.dof, cell.evaluations)[cell.algorithm]:.2f}"

    def against_best(self, *words: str) -> str:
        """The p of that rank against the best one."""
        cell, measure = self._ranked(words)
        return _p(self._of_budget(cell, measure).row(cell.algorithm, cell.dof, cell.evaluations).comparison.p)

    def first(self, *words: str) -> str:
        """Which of the eight have the best ranks with the chosen models and budgets."""
        return self._at(0, words)

    def last(self, *words: str) -> str:
        """Which of the eight have the worst ranks."""
        return self._at(-1, words)

    def least_p(self, *words: str) -> str:
        """The lowest p of the first four against the best of them."""
        cell, measure = self._ranked((*words, "h-cmaes"))
        return _p(min(row.comparison.p for row in self._of_budget(cell, measure).rows[1:4]))

    def blocks(self, *words: str) -> str:
        """Over how many sequences the ranks are."""
        cell, measure = self._ranked((*words, "h-cmaes"))
        return str(len(self._of_budget(cell, measure).sequences))

    def tau(self, *words: str) -> str:
        """Kendall's tau of the average ranks with the paper's."""
        from scipy.stats import kendalltau

        cell, measure = self._ranked((*words, "h-cmaes"))
        ours = {row.contender.algorithm: row.comparison.rank for row in self._of_budget(cell, measure).rows}
        theirs = average_ranks(cell.dof, cell.evaluations)
        return _p(float(kendalltau(list(ours.values()), [float(theirs[name]) for name in ours]).statistic))

    def among_own(self, *words: str) -> str:
        """The p of an algorithm's model and budget against the best of all its models and budgets."""
        cell, measure = self._ranked(words)
        ranking = by_model(self.study, measure, cell.algorithm)
        return _p(ranking.row(cell.algorithm, cell.dof, cell.evaluations).comparison.p)

    def models_by_rank(self, column: str, *names: str) -> str:
        """In how many cases 39 degrees of freedom rank before 28, and in how many they could."""
        leads = []
        for name in names:
            ranking = by_model(self.study, measure_of(column), name)
            ranks = {row.contender: row.comparison.rank for row in ranking.rows}
            for budget in self.study.budgets:
                large, small = (ranks.get(Contender(name, dof, budget)) for dof in (39, 28))
                leads += [large < small] if large and small else []
        return f"{sum(leads)} of {len(leads)}"

    def worse_models(self) -> str:
        """Where 39 degrees of freedom are significantly worse than 28: by how much, and Wilcoxon's p."""
        texts, better = [], []
        for pair in model_differences(self.study, MEASURE_OF["mpjpe"]):
            if pair.p < statistics.ALPHA:
                where = f"{algorithm_label(pair.algorithm)} at {pair.evaluations}"
                texts.append(f"{where} ({pair.difference:.1f} mm, p = {_p(pair.p)})")
                better += [where] if pair.difference < 0 else []
        if better:
            raise ValueError(f"39 degrees of freedom are better for {better}: the page says that they nowhere are")
        return ", ".join(texts)

    def held(self, judge: str, column: str) -> str:
        """In how many cases a claim of the paper holds, of how many; see paper_claims.toml."""
        held = [tuple(map(int, pair)) for pair in re.findall(r"(\d+) of (\d+)", self._claim(judge, column).evidence)]
        return f"{sum(of[0] for of in held)} of {sum(of[1] for of in held)}"

    # ---- Tables.

    def against_the_eight(self) -> str:
        """Our tracker on each sequence against the best cell of the eight at 3000 evaluations."""
        titles = "MPJPE [mm] | best of the eight | ratio | Eq. 20 as printed, both | from the own answer, both"
        lines = [f"| sequence | {titles} |", "|---|---|---|---|---|---|"]
        for sequence in NINE:
            ours = self.rows[Cell(sequence, "search-contour+solved", 39, 120)]
            best = self._best_of_eight(sequence)
            theirs = self.rows[best]
            error, other = (float(row["mpjpe_mm"]) for row in (ours, theirs))
            name = f"{other:.1f} {algorithm_label(best.algorithm)}, {best.dof}"
            line = f"| {sequence} | {error:.1f} | {name} | {error / other:.2f} |"
            for column in ("eq20_as_printed_mm", "marker_error_mm"):
                line += f" {float(ours[column]):.1f} / {float(theirs[column]):.1f} |"
            lines.append(line)
        return "\n".join(lines)

    def ratio(self, *sequences: str) -> str:
        """Our error over that of the best of the eight at 3000 evaluations: the least and the most of the sequences."""
        ours = self.values(self.choose((*sequences, "search-contour+solved")))
        theirs = self.values(Choice([self._best_of_eight(name) for name in sequences], "mpjpe_mm", 1))
        ratios = ours / theirs
        return f"{min(ratios):.2f} to {max(ratios):.2f}"

    def below_half(self) -> str:
        """On how many sequences that ratio is at most a half."""
        return f"{sum(float(self.ratio(name).split()[0]) <= 0.5 for name in NINE)} of {len(NINE)}"

    def all_trackers(self) -> str:
        """Means over the nine sequences of our trackers and of ``_SHOWN``, the best first."""
        texts = []
        for name, dof, budget in _SHOWN:
            cells = [Cell(sequence, name, dof, budget) for sequence in NINE]
            columns = ("mpjpe_mm", "eq20_as_printed_mm", "marker_error_mm")
            own, printed, marker = (float(self.values(Choice(cells, column, 1)).mean()) for column in columns)
            time = self.times[name.removesuffix("+solved"), budget] if dof == 39 else ""
            title = _name(name) + ("" if _one_budget(name) else f", {budget}") + (", 28 DOF" if dof == 28 else "")
            texts.append((own, f"| {title} | {own:.1f} ({printed:.1f}, {marker:.1f}) | {time} |"))
        head = "| tracker | MPJPE (Eq. 20 as printed, from the own answer) [mm] | ms a frame |\n|---|---|---|\n"
        return head + "\n".join(line for _, line in sorted(texts))

    def radii(self) -> str:
        """Lost limbs and errors by preset of radii."""
        titles = "own radii | one for all (0.03 rad, 0.02 m) | 0.5 rad, 0.02 m | 0.02 rad, 0.5 m | 0.5 rad, 0.5 m"
        lines = [f"| | {titles} |", "|---|---|---|---|---|---|"]
        for sequence, names in (
            ("S2/Gestures", ("h-cmaes", "h-pso", "cmaes", "h-de", "psapf")),
            ("S1/Walking", ("h-cmaes", "de")),
            ("S3/Box", ("h-cmaes",)),
        ):
            for name in names:
                rows = [self.rows[Cell(sequence, name, 39, 500, preset)] for preset in PRESETS]
                pairs = [(float(row["limb_lost_percent"]), float(row["mpjpe_mm"])) for row in rows]
                texts = [f"{lost:.0f} %, {error:.{0 if error >= 100 else 1}f}" for lost, error in pairs]
                title = f"{sequence}: " if name == names[0] else ""
                lines.append(f"| {title}{algorithm_label(name)} | {' | '.join(texts)} |")
        return "\n".join(lines)

    def floors(self) -> str:
        """The two readings' floors, as docs/study.md has them."""
        lines = ["| floor [mm] | S1 Walking, Gestures, Box | S2 | S3 | mean |", "|---|---|---|---|---|"]
        columns = {"as printed": "eq20_as_printed_floor_mm", "from the own first answer": "marker_error_floor_mm"}
        for name, column in columns.items():
            values = self.values(self.choose(("h-cmaes", "500", column))).reshape(3, 3)  # (action, subject)
            texts = " | ".join(", ".join(f"{value:.1f}" for value in of) for of in values.T)
            lines.append(f"| {name} | {texts} | {np.mean(values):.1f} |")
        return "\n".join(lines)

    # ---- What these draw on.

    def _two(self, words: tuple[str, ...]) -> tuple[Choice, Choice]:
        at = words.index("than")
        return self.choose(words[:at]), self.choose(words[at + 1 :])

    def _ranked(self, words: tuple[str, ...]) -> tuple[Cell, Measure]:
        """The first chosen cell, and the measure of the column."""
        choice = self.choose(words)
        return choice.cells[0], measure_of(choice.column)

    def _of_budget(self, cell: Cell, measure: Measure) -> Ranking:
        return by_algorithm(self.study, measure, cell.dof, cell.evaluations)

    def _at(self, place: int, words: tuple[str, ...]) -> str:
        choice = self.choose((*words, "h-cmaes", NINE[0]))
        rankings = [self._of_budget(cell, measure_of(choice.column)) for cell in choice.cells]
        return " and ".join(sorted({algorithm_label(of.rows[place].contender.algorithm) for of in rankings}))

    def _best_of_eight(self, sequence: str) -> Cell:
        cells = (Cell(sequence, *of, 3000) for of in product(ALGORITHM_ORDER, (39, 28)))
        return min((cell for cell in cells if cell in self.rows), key=lambda cell: float(self.rows[cell]["mpjpe_mm"]))

    @cached_property
    def _rate(self) -> float:
        return pace_of(self.study)[0]

    @cached_property
    def _findings(self) -> list[Finding]:
        return check_claims(self.study, MEASURE_OF["mpjpe"])

    def _claim(self, judge: str, column: str) -> Finding:
        by = measure_of(column).label
        texts = {claim["claim"] for of in CLAIMS.values() for claim in of if claim["judge"] == judge}
        return next(each for each in self._findings if each.claim in texts and by.lower() in each.by.lower())


def _one_budget(algorithm: str) -> bool:
    return algorithm.removesuffix("+solved") in EVALUATIONS_OF


def _name(algorithm: str) -> str:
    """A tracker as the page calls it."""
    if algorithm.endswith("+polish"):
        return f"{algorithm_label(algorithm.removesuffix('+polish'))} `--polish`"
    if algorithm.endswith("+solved"):
        return f"`{algorithm.removesuffix('+solved')}`, body solved"
    return f"`{algorithm}`, body as given" if _one_budget(algorithm) else algorithm_label(algorithm)


def _listed(texts: Iterable[str]) -> str:
    *some, last = texts
    return f"{', '.join(some)} and {last}" if some else last


def _p(value: float) -> str:
    """A p-value, or another number below one, without its zero."""
    if value < 0.001:
        mantissa, _, exponent = f"{value:.1e}".partition("e")
        return f"{mantissa}e{int(exponent)}"
    text = f"{value:.3f}" if value < 0.1 else f"{value:.2f}"
    return text.removeprefix("0")


def study_page(folder: Path = FOLDER) -> str:
    """The page on what the study found, with the figures of a folder's results."""
    return StudyFigures(folder).fill((FOLDER / "README.in").read_text(encoding="utf-8"))


def main() -> int:
    """Write the page."""
    (FOLDER / "README.md").write_text(study_page(), encoding="utf-8")
    have = StudyFigures().have("eight", "500", "1500", "3000", "39", "28")
    paper = FOLDER.parents[1] / "paper" / "paper.md"
    paper.write_text(re.sub(r"\d+ of 432(?= cells)", have, paper.read_text(encoding="utf-8")), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
