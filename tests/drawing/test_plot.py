from dataclasses import replace

import cv2
import numpy as np
import pytest
from synthetic import synthetic_result

from mmocap_warp.drawing.plot import _axis, plot_report
from mmocap_warp.errors import InputError
from mmocap_warp.result.evaluation import evaluate


def report_with(errors):
    """A report of one run over ten frames with the given marker errors."""
    report = evaluate(synthetic_result(frames=len(errors), runs=1))
    report["series"]["marker_error_mm"] = [errors]
    return report


def darkest_rows(image, columns):
    """In each column, the mean row of the curve (its blue) in the upper panel."""
    blue = (np.abs(image[:340].astype(int) - (150, 75, 0)).max(axis=2) < 60)[:, columns]
    return [float(np.flatnonzero(column).mean()) if column.any() else None for column in blue.T]


def test_the_curve_goes_where_the_values_are(tmp_path):
    plot_report(tmp_path / "error.png", report_with([0.0, 30.0, 60.0, None, None, 60.0, 0.0]))
    image = cv2.imread(str(tmp_path / "error.png"))
    across = (1200 - 84 - 24) / 6  # pixels a frame
    columns = [round(84 + across * position) for position in (0.5, 1.0, 1.5, 3.5, 5.5)]
    rows = darkest_rows(image, columns)
    bottom, top = 340 - 56, 44  # 0 mm and 60 mm
    expected = [bottom - (bottom - top) * share for share in (0.25, 0.5, 0.75)]
    np.testing.assert_allclose(rows[:3], expected, rtol=0, atol=1.5)
    assert rows[3] is None  # a gap
    assert rows[4] == pytest.approx(expected[1], abs=1.5)


@pytest.mark.parametrize("frames", [1, 2, 300])
@pytest.mark.parametrize("runs", [1, 5])
def test_any_length_and_number_of_runs_is_drawn(tmp_path, frames, runs):
    plot_report(tmp_path / "error.png", evaluate(synthetic_result(frames, runs)))
    assert cv2.imread(str(tmp_path / "error.png")).shape == (680, 1200, 3)
    assert [file.name for file in tmp_path.iterdir()] == ["error.png"]


def test_a_result_in_which_all_is_lost_is_drawn(tmp_path, recwarn):
    result = synthetic_result(frames=3, runs=2)
    lost = replace(result, iou=np.full_like(result.iou, np.nan), cost=np.full_like(result.cost, np.nan))
    plot_report(tmp_path / "error.png", evaluate(lost))
    assert (tmp_path / "error.png").is_file()
    assert not [warning for warning in recwarn if warning.category is RuntimeWarning]


@pytest.mark.parametrize(
    ("high", "ticks"),
    [(60.0, [0, 10, 20, 30, 40, 50, 60]), (0.21, [0, 0.05, 0.1, 0.15, 0.2, 0.25]), (157.0, [0, 50, 100, 150, 200])],
)
def test_ticks_are_round_numbers(high, ticks):
    assert _axis(0.0, high, 0.0, 1.0, tight=False).ticks == pytest.approx(ticks)


def test_a_wrong_name_is_refused(tmp_path):
    with pytest.raises(InputError, match="not a PNG file name"):
        plot_report(tmp_path / "error.svg", evaluate(synthetic_result()))
