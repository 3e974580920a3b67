import re
import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import numpy as np
import pytest
from synthetic import synthetic_result

from mmocap_warp.display.result_plots import plot_report
from mmocap_warp.errors import InputError
from mmocap_warp.result.evaluation import evaluate

SVG = "{http://www.w3.org/2000/svg}"


def report_with(errors):
    """A report of one run over ten frames with the given marker errors."""
    report = evaluate(synthetic_result(frames=len(errors), runs=1))
    report["series"]["marker_error_mm"] = [errors]
    return report


def drawn_curves(path):
    """Their places in the file, by class: for each curve its pieces between gaps, each (point, 2)."""
    curves = {}
    for element in ElementTree.parse(path).getroot().iter(f"{SVG}path"):
        kind = element.get("class")
        if kind.startswith("curve"):
            pieces = element.get("d").split("M")[1:]
            steps = [np.array(re.findall(r"-?\d+", piece), float).reshape(-1, 2) for piece in pieces]
            curves.setdefault(kind, []).append([np.delete(np.cumsum(step, axis=0), 1, axis=0) for step in steps])
    return curves


def test_the_curve_goes_where_the_values_are(tmp_path):
    plot_report(tmp_path / "error.svg", report_with([0.0, 30.0, 60.0, None, None, 60.0, 0.0]))
    before, after = drawn_curves(tmp_path / "error.svg")["curve"][0]  # with a gap between them
    across = (960 - 58 - 14) / 6  # coordinates a frame
    bottom, top = 260 - 46, 30  # 0 mm and 5 % over 60 mm
    height = (bottom - top) / 1.05  # of 60 mm
    expected = [(58, bottom), (58 + across, bottom - height / 2), (58 + 2 * across, bottom - height)]
    np.testing.assert_allclose(before, expected, rtol=0, atol=0.5)
    np.testing.assert_allclose(after[:, 0], [58 + 5 * across, 58 + 6 * across], rtol=0, atol=0.5)


@pytest.mark.parametrize("frames", [1, 2, 300])
@pytest.mark.parametrize("runs", [1, 5])
def test_any_length_and_number_of_runs_is_drawn(tmp_path, frames, runs):
    report = evaluate(synthetic_result(frames, runs))
    plot_report(tmp_path / "error.svg", report)
    curves = drawn_curves(tmp_path / "error.svg")
    assert len(curves["curve"]) == 2  # panels
    assert len(curves.get("curve thin", [])) == (2 * runs if runs > 1 else 0)
    iou = np.array(report["series"]["iou"], float)  # of each run; None, and so NaN, where all are lost
    assert sum(map(len, curves["curve"][1])) == np.isfinite(iou).any(axis=0).sum()
    assert [file.name for file in tmp_path.iterdir()] == ["error.svg"]


def test_a_result_in_which_all_is_lost_is_drawn(tmp_path, recwarn):
    result = synthetic_result(frames=3, runs=2)
    lost = replace(result, iou=np.full_like(result.iou, np.nan), cost=np.full_like(result.cost, np.nan))
    plot_report(tmp_path / "error.svg", evaluate(lost))
    assert "nan" not in (tmp_path / "error.svg").read_text()
    assert not [warning for warning in recwarn if warning.category is RuntimeWarning]


def test_a_wrong_name_is_refused(tmp_path):
    with pytest.raises(InputError, match="not an SVG file name"):
        plot_report(tmp_path / "error.png", evaluate(synthetic_result()))
