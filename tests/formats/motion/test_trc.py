"""OpenSim's .trc files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mmocap_warp.errors import InputError
from mmocap_warp.formats.motion.captured_points import read_trc

GOOD = (
    "PathFileType\t4\t(X/Y/Z)\tsome.trc\n"
    "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames\n"
    "60\t60\t2\t2\tmm\t60\t0\t2\n"
    "Frame#\tTime\tRHip\t\t\tLHip\t\t\t\n"
    "\t\tX1\tY1\tZ1\tX2\tY2\tZ2\t\n"
    "1\t0.016\t1000\t2000\t3000\t4000\t5000\t6000\n"
    "2\t0.033\t10\t20\t30\t\t\t\n"
)


def test_reading(tmp_path: Path) -> None:
    path = tmp_path / "some.trc"
    path.write_text(GOOD)
    tracks = read_trc(path)
    assert (tracks.rate, tracks.names) == (60.0, ("RHip", "LHip"))
    np.testing.assert_array_equal(tracks.frame_numbers, [1, 2])
    np.testing.assert_allclose(tracks.positions[0], [[1, 2, 3], [4, 5, 6]])
    assert np.isnan(tracks.positions[1, 1]).all()
    np.testing.assert_allclose(read_trc(path, "zxy").positions[0, 0], [3, 1, 2])
    np.testing.assert_allclose(read_trc(path, "x-zy").positions[0, 0], [1, -3, 2])


def test_the_real_recording(shared_data: Path) -> None:
    tracks = read_trc(shared_data / "pose2sim_single" / "reference" / "bal_filt.trc", "zxy")
    assert tracks.positions.shape == (100, 21, 3)
    heights = tracks.positions[:, :, 2]
    assert (heights[:, tracks.names.index("Head")] > heights[:, tracks.names.index("RAnkle")] + 1).all()


WRONG = {
    "another file": ("time,x,y\n" * 9, r"is not a \.trc file"),
    "no units": (GOOD.replace("\tmm", "\tfeet"), r"header lacks a DataRate, NumMarkers or Units"),
    "marker count": (GOOD.replace("60\t60\t2\t2", "60\t60\t2\t3"), r"line 4 names 2 markers, the header says 3"),
    "a word": (GOOD.replace("5000", "five"), r"line 6: holds a cell that is not a number"),
    **{f"rate {rate}": (GOOD.replace("60\t60\t2", f"{rate}\t60\t2"), "DataRate") for rate in ("nan", "0", "-5", "inf")},
    **{f"frame {at}": (GOOD.replace("\n2\t", f"\n{at}\t"), "Frame#") for at in ("nan", "inf", "1e30")},
    "no frames": (GOOD[: GOOD.index("1\t0.016")] + "\n", r"holds no frames"),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_wrong_files_are_refused(tmp_path: Path, wrong: str) -> None:
    text, message = WRONG[wrong]
    (tmp_path / "some.trc").write_text(text)
    with pytest.raises(InputError, match=message):
        read_trc(tmp_path / "some.trc")
    with pytest.raises(InputError, match="no such file"):
        read_trc(tmp_path / "other.trc")


@pytest.mark.parametrize("axes", ["xy", "xxz", "yxz", "abc", "-xyz"])
def test_axes_must_be_right_handed(tmp_path: Path, axes: str) -> None:
    (tmp_path / "some.trc").write_text(GOOD)
    with pytest.raises(InputError, match="not a right-handed order"):
        read_trc(tmp_path / "some.trc", axes)
