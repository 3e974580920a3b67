"""Numbers and lists as the report writes them."""

from collections.abc import Iterable, Sequence

import numpy as np

from mmocap_warp.study.summary import CellSummary, Measure

DASH = "–"
_MINUS = "\N{MINUS SIGN}"
_NUMBERS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve")


def extent(cells: Iterable[CellSummary]) -> str:
    """How many seeds and frames cells have, as every caption says."""
    sizes = [(len(cell.seeds), len(cell.frames)) for cell in cells]
    seeds, frames = (sorted(set(each)) for each in zip(*sizes, strict=True))
    return f"{_from_to(seeds)} seed{'' if seeds == [1] else 's'}, {_from_to(frames)} frames a sequence"


def _from_to(values: Sequence[int]) -> str:
    return f"{values[0]:,}" if len(values) == 1 else f"{values[0]:,} to {values[-1]:,}"


def p_value(p: float) -> str:
    """As the paper prints them, but rounded; a dash for the control."""
    if np.isnan(p):
        return DASH
    if p >= 0.001:
        return f"{p:.3f}"
    mantissa, _, exponent = f"{p:.2E}".partition("E")
    return f"{mantissa}E{int(exponent)}".replace("-", _MINUS) if p > 0 else "0"


def statistic(value: float) -> str:
    """A test's statistic, which may be infinite."""
    return "∞" if np.isinf(value) else f"{value:.2f}"


def shown(value: float, measure: Measure, *, sign: bool = False) -> str:
    """A value of a measure without its unit; a dash where it is unknown."""
    if not np.isfinite(value):
        return DASH
    return f"{value:{'+' if sign else ''}.{measure.decimals}f}".replace("-", _MINUS)


def with_unit(value: float, measure: Measure, *, sign: bool = False, space: str = "\N{NO-BREAK SPACE}") -> str:
    """A value of a measure with its unit."""
    return shown(value, measure, sign=sign) + (f"{space}{measure.unit}" if measure.unit else "")


def interval(ends: tuple[float, float], decimals: int) -> str:
    """The two ends of an interval; a dash where they are unknown."""
    if not np.isfinite(ends).all():
        return DASH
    return f"{ends[0]:.{decimals}f} to {ends[1]:.{decimals}f}".replace("-", _MINUS)


def named(measure: Measure) -> str:
    """A measure's label within a sentence."""
    abbreviated = measure.label[:2].isupper() or measure.label.startswith("HumanEva")
    return measure.label if abbreviated else measure.label[0].lower() + measure.label[1:]


def over(sequences: Iterable[str]) -> str:
    """How many sequences, named where they are few."""
    names = sorted(sequences)
    return f"{len(names)} sequences" if len(names) > 3 else ", ".join(names)


def listed(values: Sequence[int]) -> str:
    """Numbers in a sentence: 1, 2 and 3."""
    words = [f"{value:,}" for value in values]
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def counted(number: int, noun: str, *, in_words: bool = False) -> str:
    """So many of something; small numbers as words if these are wanted."""
    count = _NUMBERS[number] if in_words and number < len(_NUMBERS) else f"{number:,}"
    return f"{count} {noun}{'' if number == 1 else 's'}"
