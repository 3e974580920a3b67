"""The parts of charts: where values lie, which are marked, and what is written there."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import numpy as np
import pytest
from bench_growth import decades, names_of_curves

from mmocap_warp.display.chart import (
    Axis,
    axes,
    axis,
    box,
    categories,
    curve,
    outline,
    picture,
    polyline,
    text,
)

NEVER = float("nan")


def words(parts):
    """What is written, with where: (words, x, y)."""
    found = re.findall(r'<text x="([^"]*)" y="([^"]*)"[^>]*>([^<]*)</text>', parts)
    return [(word, float(x), float(y)) for x, y, word in found]


@pytest.mark.parametrize(
    ("low", "high", "about", "ticks"),
    [
        (0, 83, 5, (0, 20, 40, 60, 80)),
        (0.71, 0.93, 5, (0.75, 0.8, 0.85, 0.9)),
        (0, 60, 6, (0, 10, 20, 30, 40, 50, 60)),
        (0, 0.21, 6, (0, 0.05, 0.1, 0.15, 0.2)),
        (0, 157, 6, (0, 50, 100, 150)),
    ],
)
def test_ticks_are_round_numbers(low, high, about, ticks):
    assert axis(low, high, 0, 100, about).ticks == ticks


def test_values_lie_between_the_ends():
    assert axis(5, 5, 0, 1).at(5) == 0
    assert axis(0, 10, 100, 0).at(2.5) == 75
    assert axis(0, 10, 100, 0).at(99) == 0
    assert np.isnan(axis(0, 10, 100, 0).at(NEVER))


def test_decades_are_evenly_apart():
    y = decades(0.002, 3.0, 400, 0)
    assert y.ticks == pytest.approx((1e-3, 1e-2, 0.1, 1.0, 10.0))
    assert [y.at(tick) for tick in y.ticks] == pytest.approx([400, 300, 200, 100, 0])
    assert y.at(10**-1.5) == pytest.approx(250)


def test_categories_are_named_in_the_middle_of_their_stretches():
    x = categories(["one\nfirst", "two"], 0, 200)
    assert (x.at(0), x.at(1), x.at(2)) == (0, 100, 200)
    written = words(axes(x, axis(0, 1, 100, 0, 1)))
    assert [word for word in written if word[1] in (50, 150)] == [
        ("one", 50, 117),
        ("first", 50, 132),
        ("two", 150, 117),
    ]


def test_axes_have_a_rule_and_a_word_for_each_tick():
    x, y = axis(0, 10, 60, 160, 2), axis(0, 2000, 100, 20, 2)
    drawn = axes(x, y, "frame", "error [mm]")
    assert re.findall(r'class="grid" d="([^"]*)"', drawn) == ["M60 100L160 100", "M60 60L160 60", "M60 20L160 20"]
    assert [word for word, _, _ in words(drawn)] == ["0", "1,000", "2,000", "0", "5", "10", "frame", "error [mm]"]


def test_numbers_that_would_touch_are_left_out_but_the_largest():
    sizes = (1, 2, 1000, 1100, 4000)
    x = Axis(1, 4000, 0, 300, sizes, "{:,}".format, logarithmic=True)
    assert [word for word, _, y in words(axes(x, axis(0, 1, 100, 0))) if y == 117] == ["1", "2", "1,100", "4,000"]
    x = replace(x, kind="name")
    assert len([word for word, _, y in words(axes(x, axis(0, 1, 100, 0))) if y == 117]) == len(sizes)


def test_paths_have_gaps_and_close():
    assert polyline([0, 1, 2, 3, 4], [5, 6, np.nan, 7, 4]) == "M0 5l0 0l1 1M3 7l0 0l1-3"
    assert outline([np.array([[1, 2], [4, 2], [4, 0]])]) == "M1 2l3 0l0-2z"


def test_curves_go_through_their_values():
    x, y = axis(0, 4, 0, 40), axis(0, 1, 100, 0)
    assert curve(x, y, [(0, 0.5), (1, NEVER), (2, 1.0)], "thin") == '<path class="curve thin" d="M0 50l0 0M20 0l0 0"/>'
    assert curve(x, y, []) == '<path class="curve" d=""/>'


def test_a_box_has_an_arrow_where_its_whisker_leaves_the_axis():
    y = axis(0, 10, 100, 0)
    within, median = box([1, 2, 3, 4, 5], y, 50, 20)
    assert within == "M40 80h20V60h-20zM50 80V90M50 60V50"
    assert median == "M40 70h20"
    assert box([1, 2, 3, 4, 50], y, 50, 20)[0] == "M40 80h20V60h-20zM50 80V90M50 60V0m-10 4l10 -4l10 4"
    assert box([-1, 2, 3, 4, 5], y, 50, 20)[0].endswith("M40 96l10 4l10 -4")


def test_names_of_curves_do_not_overlap():
    written = words(names_of_curves([("high", "a", 20), ("low", "b", 40), ("near it", "c", 38)], 300))
    assert [(name, y) for name, _, y in written] == [("low", 44), ("near it", 29), ("high", 14)]


def test_a_picture_is_a_file_of_its_own_and_escapes_words():
    root = ElementTree.fromstring(picture((100, 50), 'a < "b"', [text((1, 2), "<&>")]))
    assert root.get("aria-label") == 'a < "b"'
    assert root.get("viewBox") == "0 0 100 50"
    namespace = "{http://www.w3.org/2000/svg}"
    assert root.find(f"{namespace}text").text == "<&>"
    assert "prefers-color-scheme: dark" in root.find(f"{namespace}style").text
