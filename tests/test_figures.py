"""The figures of pages are those of the data beside them."""

from __future__ import annotations

import html
import json
import re
import shutil
from functools import cache
from pathlib import Path

import pytest
from study_figures import FOLDER, StudyFigures, study_page

from mmocap_warp.study.paper import ALGORITHM_ORDER
from mmocap_warp.study.summary import algorithm_label

ROOT = Path(__file__).resolve().parents[1]


@cache
def figures() -> StudyFigures:
    return StudyFigures()


def test_the_page_of_findings_is_what_the_data_make_of_its_template():
    template = (FOLDER / "README.in").read_text(encoding="utf-8")
    assert (FOLDER / "README.md").read_text(encoding="utf-8") == figures().fill(template)


def test_no_figure_of_the_page_is_typed():
    """What is left of digits in the template are names, settings, and what the paper says."""
    text = (FOLDER / "README.in").read_text(encoding="utf-8")
    prose = re.sub(r"\{\{.*?\}\}|```.*?```|`.*?`|\]\(.*?\)", "", text, flags=re.S)
    assert re.findall(r"\d[\d.]* (?:mm|ms|%)(?!\w)", prose) == ["1180 ms"]  # the paper's
    assert re.findall(r"\b\d+\.\d+\b|(?<!\d)\.\d+", prose.replace("Eq. 20", "")) == _OF_THE_PAPER


_OF_THE_PAPER = ["5.4", "5.3", "0.5", "0.5", "0.5", "0.5", "0.03", "0.08"]
"""Two sections, its radii, and those of a preset."""


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (
            "S1/Box,search-contour+solved,39,120,recording,5,263,4",
            "S1/Box,search-contour+solved,39,120,recording,5,263,5",
        ),
        ("S3/Gestures,cmaes,39,3000,", "S3/Gestures,cmaes,39,6000,"),
    ],
    ids=["another error", "a cell that is missing"],
)
def test_other_results_make_another_page_or_none(tmp_path, old, new):
    for name in ("results.csv", "times.csv"):
        shutil.copy(FOLDER / name, tmp_path)
    file = tmp_path / "results.csv"
    text = file.read_text(encoding="utf-8")
    assert text.count(old) == 1
    file.write_text(text.replace(old, new), encoding="utf-8")
    try:
        page = study_page(tmp_path)
    except KeyError:
        page = ""
    assert page != (FOLDER / "README.md").read_text(encoding="utf-8")


def test_single_runs_take_as_long_as_the_report_says():
    report = (FOLDER / "report.html").read_text(encoding="utf-8")
    table = re.search(r"Milliseconds per frame of one run tracked alone.*?</table>", report, re.S)
    assert table is not None
    shown = re.findall(r"\b\d+\.\d\b", re.sub(r"<[^>]*>", " ", html.unescape(table[0])))
    assert sorted(shown) == sorted(figures().times.values())


_SENTENCES = {
    "docs/study.md": [
        "{{floors}}",
        "over {{seeds h-cmaes 500 S1/Gestures}} seeds H-CMAES, 500, on S1/Gestures has a standard deviation of "
        "{{each h-cmaes 500 S1/Gestures marker_error_mm_sd}} mm, as printed "
        "{{each h-cmaes 500 S1/Gestures eq20_as_printed_mm_sd}}, "
        "of MPJPE {{each h-cmaes 500 S1/Gestures mpjpe_mm_sd}}.",
    ],
    "docs/contour.md": [
        "| H-CMAES, 500 evaluations, version 0.1.0 | {{mean h-cmaes 500 marker_error_mm}} | {{mean h-cmaes 500}} | |"
    ],
    "paper/paper.md": [
        "the mean joint error is {{mean h-cmaes 500}} mm with the study's best tracker at 500 evaluations a frame, "
        "{{mean search-contour}} mm with the default tracker and the same given body, and "
        "{{mean search-contour+solved}} mm where that tracker solves the body too",
        "({{have eight 500 1500 3000 39 28}} cells, thirty seeds, whole clips)",
    ],
}


@pytest.mark.parametrize("page", _SENTENCES)
def test_another_pages_figures_of_the_study_are_those_of_its_cells(page):
    text = (ROOT / page).read_text(encoding="utf-8")
    assert [each for each in map(figures().fill, _SENTENCES[page]) if each not in text] == []


def _row(page: str, start: str) -> list[str]:
    """The cells of a page's line."""
    return _row_of((ROOT / page).read_text(encoding="utf-8"), start)


def _row_of(text: str, start: str) -> list[str]:
    """The cells of the first table line that starts so."""
    line = next(line for line in text.splitlines() if line.startswith(start))
    return [cell.strip() for cell in line.strip("|").split("|")]


def test_the_readmes_figures_are_those_of_the_pages_that_it_links_to():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    errors = _row("docs/accuracy.md", "| `search-contour`, the default")[2:4]
    (markers, joints) = (sorted(float(value) for value in cell.split(", ")) for cell in errors)
    assert f"skin markers are {markers[0]} to {markers[-1]} mm off on average" in readme
    assert f"joints {joints[0]} to {joints[-1]} mm" in readme
    fox, hand, quadruped, arm = (_row("docs/examples.md", f"| [{name}]") for name in ("fox", "hand", "ANYmal", "Panda"))
    fox_share, hand_share = (re.findall(r"[\d.]+ %", row[3])[-1] for row in (fox, hand))
    assert f"`mmocap demo fox`: joints {fox_share} of its length off, mean" in readme
    assert f"`mmocap demo hand`: fingertips {hand_share} off, mean" in readme
    assert f"`mmocap demo quadruped`: angles {quadruped[4]} off, median" in readme
    assert f"`mmocap demo arm`: angles {arm[4]} off, median" in readme


def test_the_papers_share_of_joints_within_two_deviations_is_the_documents():
    paper = (ROOT / "paper" / "paper.md").read_text(encoding="utf-8")
    (share,) = re.findall(r"[\d.]+ %", _row("docs/contour.md", "| made people, cross-validated")[1])
    assert f"lies within two of them for {share} of the joints' coordinates" in paper
    real = _row("docs/contour.md", "| the real recording, one seed")[1].split(";")[0]
    assert f"it is {real} %" in paper


RENDERERS = ("raycast", "raster")


def _measurements(report: str, group: str, **sizes: object) -> list[dict]:
    """What a report has of a group, with these sizes."""
    every = json.loads((ROOT / "docs" / "benchmarks" / report).read_bytes())["measurements"]
    return [of for of in every if of["group"] == group and of["sizes"].items() >= sizes.items()]


def test_the_page_on_performance_has_its_reports_figures():
    page = (ROOT / "docs" / "performance.md").read_text(encoding="utf-8")
    once = {of["name"]: of for of in _measurements("cpu.json", "whole evaluation", threads=1)}
    raycast, raster = (1e3 * once[name]["median"] / once[name]["evaluations"] for name in RENDERERS)
    peers = {of["name"]: of["median"] for of in _measurements("cpu.json", "peers")}
    ahead = [f"{peers['embree'] / peers[name]:.0f} times" for name in RENDERERS]
    assert f"{raycast:.2f} ms (`raycast`, {ahead[0]} as quick as Embree's any-hit)" in page
    assert f"{raster:.3f} ms (`raster`, {ahead[1]})" in page
    batches = {of["name"]: of["median"] for of in _measurements("h200.json", "whole evaluation", candidates=4096)}
    rates = " and ".join(f"{round(4096 / batches[name], -3):,.0f}" for name in RENDERERS)
    assert f"an H200 does {rates} a second in batches of 4,096" in page
    frame = [_measurements("h200.json", "a frame", budget=500, runs=1, renderer=name)[0] for name in RENDERERS]
    rates = " and ".join(f"{1 / of['median']:.0f}" for of in frame)
    assert f"{rates} frames a second of H-CMA-ES with 500 evaluations" in page


def test_the_page_on_accuracy_has_the_medians_of_its_report():
    report = (ROOT / "docs" / "benchmarks" / "trackers.txt").read_text(encoding="utf-8")
    page = (ROOT / "docs" / "accuracy.md").read_text(encoding="utf-8").partition("## All eight trackers")[2]
    parts = {of.splitlines()[0]: of for of in report.split("### Preset ")[1:]}
    models = [f"`recording`, {budget} evaluations, {dof} DOF" for dof in (39, 28) for budget in (500, 1500)]
    for label in map(algorithm_label, ALGORITHM_ORDER):
        rows = [_row_of(parts[model], f"| {label} |") for model in models]
        walk, real = ([row[column].split()[0] for row in rows] for column in (1, 4))
        assert _row_of(page, f"| {label} |") == [label, *walk, *real]
