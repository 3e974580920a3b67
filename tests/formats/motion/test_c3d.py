"""``.c3d`` files: against ezc3d's own writer, and on a real capture."""

from __future__ import annotations

from pathlib import Path

import ezc3d
import numpy as np
import pytest

from mmocap_warp.formats.motion.captured_points import read_c3d


def written(path: Path, positions: np.ndarray, residuals: np.ndarray | None = None, units: str = "mm") -> Path:
    """Two points (2, frame, 3) named ``Ann:AAA`` and ``BBB``, at 100 Hz."""
    file = ezc3d.c3d()
    about = file["parameters"]["POINT"]
    about["UNITS"]["value"], about["RATE"]["value"] = [units], [100.0]
    about["LABELS"]["value"] = ["Ann:AAA", "BBB"]
    file["data"]["points"] = np.concatenate([positions.transpose(2, 0, 1), np.ones((1, *positions.shape[:2]))])
    if residuals is not None:
        file["data"]["meta_points"]["residuals"] = residuals[None]
    file.write(str(path))
    return path


@pytest.mark.parametrize(("units", "metres"), [("mm", 0.001), ("cm", 0.01), ("m", 1.0)])
def test_points_come_in_metres_with_their_names(tmp_path, units, metres):
    positions = np.random.default_rng(0).uniform(1, 2, (2, 5, 3))
    tracks = read_c3d(written(tmp_path / "a.c3d", positions, units=units))
    assert tracks.names == ("AAA", "BBB")
    assert tracks.rate == 100.0
    assert np.allclose(tracks.positions, positions.transpose(1, 0, 2) * metres, rtol=1e-6, atol=0)


def test_points_at_the_origin_or_with_a_negative_residual_are_unknown(tmp_path):
    positions = np.ones((2, 4, 3))
    positions[0, 1] = 0.0
    residuals = np.zeros((2, 4))
    residuals[1, 2] = -1.0
    tracks = read_c3d(written(tmp_path / "a.c3d", positions, residuals))
    known = np.isfinite(tracks.positions).all(axis=2)
    assert known.tolist() == [[True, True], [False, True], [True, False], [True, True]]


def test_a_real_capture(shared_data):
    """A walk of CMU's: 120 Hz, a head 1.5 to 1.8 m up, a stride of 3 m in 343 frames."""
    tracks = read_c3d(shared_data / "cmu_mocap" / "02_01.c3d")
    assert tracks.rate == 120.0
    assert len(tracks.names) == 41
    assert tracks.frame_numbers[[0, -1]].tolist() == [50, 392]
    head = tracks.positions[:, tracks.names.index("LFHD")]
    assert np.isfinite(tracks.positions).all()
    assert ((head.max(axis=1) > 1.4) & (head.max(axis=1) < 2.0)).any()
    toe = tracks.positions[:, tracks.names.index("LTOE")]
    assert 1.0 < np.linalg.norm(np.ptp(toe, axis=0)) < 5.0
