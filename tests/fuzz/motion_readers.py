"""Readers of motion, truth and HumanEva's files."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import mutations
from given_clips import BVH
from reader import LINES, Reader, write_text

_TRC = (
    "PathFileType\t4\t(X/Y/Z)\tsome.trc\n"
    "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames\n"
    "60\t60\t2\t2\tmm\t60\t0\t2\nFrame#\tTime\tRHip\t\t\tLHip\t\t\t\n\t\tX1\tY1\tZ1\tX2\tY2\tZ2\t\n"
    "1\t0.016\t1000\t2000\t3000\t4000\t5000\t6000\n2\t0.033\t10\t20\t30\t\t\t\n"
)
_CAL = "600\n600\n320\n240\n0\n0\n0\n0\n0\n0\n" + "1\n0\n0\n0\n1\n0\n0\n0\n1\n" + "0\n0\n4000\n"


def _read_clip(folder: Path, name: str) -> None:
    from mmocap_warp.formats.motion.motion_clip import read_bvh

    read_bvh(folder / name).at_rate(60.0)


def _write_c3d(folder: Path) -> None:
    import ezc3d
    import numpy as np

    file = ezc3d.c3d()
    about = file["parameters"]["POINT"]
    about["UNITS"]["value"], about["RATE"]["value"], about["LABELS"]["value"] = ["mm"], [100.0], ["Ann:AAA", "BBB"]
    file["data"]["points"] = np.random.default_rng(0).uniform(1, 2, (4, 2, 3))
    file.write(str(folder / "some.c3d"))


def _read_c3d(folder: Path) -> None:
    from mmocap_warp.formats.motion.captured_points import read_c3d

    read_c3d(folder / "some.c3d")


def read_truth(folder: Path, name: str) -> None:
    from mmocap_warp.formats.truth_file import load_truth

    load_truth(folder / name)


def _read_cal(folder: Path) -> None:
    from mmocap_warp.cameras.rig import rig_of
    from mmocap_warp.formats.humaneva.humaneva_files import read_cal

    rig_of([read_cal(folder / "C1.cal", "C1", (640, 480))], "+z", folder / "C1.cal")


def _read_ofs(folder: Path) -> None:
    from mmocap_warp.formats.humaneva.humaneva_files import read_ofs

    read_ofs(folder / "C1.ofs")


def _read_measures(folder: Path) -> None:
    from mmocap_warp.formats.humaneva.humaneva_files import read_measures

    read_measures(folder / "S1.mp")


_CALIB = "640\n480\n600 0 320\n0 600 240\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 4000\n0 0 0 1\n0 0 0 0 0\n"
_SKELETOOL = (
    "Skeletool Camera Calibration File V1.0\nname 0\n  sensor 10 10\n  size 640 480\n  animated 0\n"
    "  intrinsic 600 0 320 0 0 600 240 0 0 0 1 0 0 0 0 1\n"
    "  extrinsic 1 0 0 0 0 1 0 0 0 0 1 4000 0 0 0 1\n  radial 0\n"
)
_PANOPTIC = (
    '{"cameras": [{"name": "00_01", "type": "hd", "resolution": [640, 480], "K": [[600, 0, 320], [0, 600, 240], '
    '[0, 0, 1]], "distCoef": [0, 0, 0, 0, 0], "R": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "t": [[0], [0], [400]]}]}'
)


def _read_biocv(folder: Path) -> None:
    from mmocap_warp.cameras.rig import rig_of
    from mmocap_warp.formats.datasets.biocv import _read_camera

    rig_of([_read_camera(folder / "00.calib", "00")], "+z", folder)


def _read_3dhp(folder: Path) -> None:
    from mmocap_warp.formats.datasets.mpi_inf_3dhp import _read_rig

    _read_rig(folder / "camera.calibration", {"video_0": folder / "video_0.avi"})


def _read_panoptic(folder: Path) -> None:
    from mmocap_warp.formats.datasets.panoptic import _read_rig

    _read_rig(folder / "x.json", {"00_01": folder / "hd_00_01.mp4"})


def _write_mat(folder: Path) -> None:
    from scipy.io import savemat

    savemat(folder / "x.mat", {"mocap": {"HeadF": [[1.0, 2.0, 3.0]]}, "cameras": {"Camera1": {"frame": [0, 1]}}})


def _read_mat(folder: Path) -> None:
    from mmocap_warp.formats.datasets.dataset_scene import read_mat

    read_mat(folder / "x.mat")


READERS: tuple[Reader, ...] = (
    Reader("biocv.calib", "00.calib", partial(write_text, **{"00__calib": _CALIB}), _read_biocv, LINES),
    Reader(
        "3dhp.calibration", "camera.calibration", partial(write_text, camera__calibration=_SKELETOOL), _read_3dhp, LINES
    ),
    Reader("panoptic.json", "x.json", partial(write_text, x__json=_PANOPTIC), _read_panoptic, mutations.any_bytes),
    Reader("dataset.mat", "x.mat", _write_mat, _read_mat, mutations.any_bytes),
    Reader("truth.trc", "x.trc", partial(write_text, x__trc=_TRC), partial(read_truth, name="x.trc"), LINES),
    Reader("clip.bvh", "x.bvh", partial(write_text, x__bvh=BVH), partial(_read_clip, name="x.bvh"), LINES),
    Reader("clip.c3d", "some.c3d", _write_c3d, _read_c3d, mutations.any_bytes),
    Reader("humaneva.cal", "C1.cal", partial(write_text, C1__cal=_CAL), _read_cal, LINES),
    Reader("humaneva.ofs", "C1.ofs", partial(write_text, C1__ofs="12.0\n32.4\n2.001\n"), _read_ofs, LINES),
    Reader(
        "humaneva.mp",
        "S1.mp",
        partial(write_text, S1__mp="$LKneeWidth = 105.0\n$A = -1e2\n"),
        _read_measures,
        LINES,
    ),
)
