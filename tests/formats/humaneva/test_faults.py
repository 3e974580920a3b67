"""Faults in a user's copy of HumanEva, one at a time: exit 3 and one line that says where, what, and what to do."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import humaneva_writer as made
import numpy as np
import pytest

from mmocap_warp import cli
from mmocap_warp.cli.console import BAD_INPUT, OK

CAL, OFS = "S1/Calibration_Data/BW2.cal", "S1/Sync_Data/Walking_1_(C3).ofs"
AVI, C3D = "S1/Image_Data/Walking_1_(BW1).avi", "S1/Mocap_Data/Walking_1.c3d"
STATIC, MP = "S1/Mocap_Data/Static.c3d", "S1/Mocap_Data/S1.mp"

Breaking = Callable[[Path], None]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("data") / "HumanEva_I"
    made.write_humaneva(folder)
    return folder


def remove(name: str) -> Breaking:
    return lambda root: (root / name).unlink()


def rename(name: str, new: str) -> Breaking:
    return lambda root: (root / name).rename(root / new)


def write(name: str, content: bytes | str) -> Breaking:
    return lambda root: (root / name).write_bytes(content if isinstance(content, bytes) else content.encode())


def change_numbers(name: str, change: Callable[[np.ndarray], np.ndarray]) -> Breaking:
    def broken(root: Path) -> None:
        numbers = change(np.array((root / name).read_text().split(), float))
        (root / name).write_text("\n".join(f"{number:.9g}" for number in numbers))

    return broken


def mirrored(numbers: np.ndarray) -> np.ndarray:
    numbers[10:13] *= -1
    return numbers


def in_metres(numbers: np.ndarray) -> np.ndarray:
    numbers[19:22] *= 1000
    return numbers


def skewed(numbers: np.ndarray) -> np.ndarray:
    numbers[4] = 0.01
    return numbers


def shorten(name: str, frames: int) -> Breaking:
    def broken(root: Path) -> None:
        made.write_avi(root / name, [np.zeros((*made.SIZE[::-1], 3), np.uint8)] * frames)

    return broken


def other_size(root: Path) -> None:
    for clip in (1, 2, 3):
        made.write_avi(root / f"Background/Background_{clip}_(C2).avi", [np.zeros((60, 80, 3), np.uint8)] * 6)


def capture(name: str, lost: dict[str, list[int]] | None = None, units: str = "mm", without: str = "-") -> Breaking:
    """Write a trial anew."""

    def broken(root: Path) -> None:
        points = made.captured_points(np.arange(1, made.MOCAP_FRAMES + 1))
        points = {point: place for point, place in points.items() if point != without}
        made.write_c3d(root / name, points, lost or {}, units)

    return broken


def no_background(root: Path) -> None:
    for clip in (1, 2, 3):
        (root / f"Background/Background_{clip}_(BW3).avi").unlink()


def unpacked_with_a_gap(root: Path) -> None:
    folder = (root / AVI).with_suffix("")
    folder.mkdir()
    for i in (1, 2, 4):
        cv2.imwrite(str(folder / f"{i:04d}.png"), np.zeros((*made.SIZE[::-1], 3), np.uint8))


EVER = list(range(1, made.MOCAP_FRAMES + 1))
FAULTS = {
    "no subject": (rename("S1", "P1"), r"HumanEva_I: holds no S1; name the folder that holds S1"),
    "no calibration folder": (rename("S1/Calibration_Data", "S1/Cal"), r"S1: holds no Calibration_Data"),
    "no camera's calibration": (remove(CAL), r"Calibration_Data: holds no BW2\.cal"),
    "calibration cut off": (change_numbers(CAL, lambda n: n[:21]), r"BW2\.cal: holds 21 numbers of 22"),
    "calibration with words": (write(CAL, "fc 765"), r"BW2\.cal: could not convert string to float: 'fc'"),
    "calibration with nan": (change_numbers(CAL, lambda n: n * np.nan), r"BW2\.cal: holds a number that is not finite"),
    "calibration not text": (write(CAL, b"\xff\xfe\x00"), r"BW2\.cal: cannot be read as text"),
    "mirrored calibration": (change_numbers(CAL, mirrored), r"camera 'BW2': R is mirrored"),
    "translation not millimetres": (
        change_numbers(CAL, in_metres),
        r"cameras lie up to 4\d{3}\S* m from .*; copy it again",
    ),
    "skewed pixels": (change_numbers(CAL, skewed), r"camera 'BW2': skew is 1\.9\d* px"),
    "no video": (remove(AVI), r"Image_Data: holds no Walking_1_\(BW1\)\.avi and no folder"),
    "video that is none": (write(AVI, b"no video"), r"BW1\)\.avi: cannot be decoded as a video"),
    "video too short": (shorten(AVI, 20), r"BW1\)\.avi: has 20 frames, .* frame 17, not 20; .* give 17 as LAST"),
    "images with a gap": (unpacked_with_a_gap, r"BW1\): image 3 is missing"),
    "no offset": (remove(OFS), r"Sync_Data: holds no Walking_1_\(C3\)\.ofs"),
    "offset cut off": (write(OFS, "12\n33.1\n"), r"C3\)\.ofs: holds \[12\.0, 33\.1\], not a video frame"),
    "offset without scale": (write(OFS, "12 33 0"), r"C3\)\.ofs: .* a positive scale"),
    "offset far off": (
        write(OFS, "12 -2000 2"),
        r"avi: has 28 frames, so it ends with .*; copy it and its \.ofs again",
    ),
    "offset of another rate": (write(OFS, "12 33 9"), r"Walking_1\.c3d: runs at 120 Hz, but the \.ofs say that 3"),
    "no motion capture": (remove(C3D), r"Mocap_Data: holds no Walking_1\.c3d"),
    "motion capture that is none": (write(C3D, b"\0" * 600), r"Walking_1\.c3d: cannot be read as \.c3d"),
    "motion capture cut off": (lambda root: cut(root / C3D, 1000), r"Walking_1\.c3d: cannot be read as \.c3d"),
    "motion capture in inches": (capture(C3D, units="in"), r"Walking_1\.c3d: POINT:UNITS is 'in'; export it in"),
    "no marker of that name": (capture(C3D, without="LTOE"), r"Walking_1\.c3d: has no LTOE; .* 39 markers"),
    "a marker never seen": (capture(C3D, {"C7": EVER}), r"all 39 markers in none of the frames 6 to 20; choose other"),
    "no static trial": (remove(STATIC), r"Mocap_Data: holds no Static\.c3d"),
    "static without shoulders": (capture(STATIC, without="RSHO"), r"Static\.c3d: has no RSHO"),
    "static with a shoulder lost": (
        capture(STATIC, {"LSHO": EVER}),
        r"Static\.c3d: never shows LSHO and RSHO together",
    ),
    "no measures": (remove(MP), r"Mocap_Data: holds no S1\.mp"),
    "measures without offset": (write(MP, "$LShoulderOffset = 40\n"), r"S1\.mp: has no line \$RShoulderOffset = "),
    "no background at all": (rename("Background", "Back"), r"HumanEva_I: holds no Background"),
    "no camera's background": (no_background, r"Background: holds none of Background_1_\(BW3\), .*"),
    "background of another size": (other_size, r"Background_1_\(C2\)\.avi: is 80x60, the camera's video is 160x120"),
}


def cut(path: Path, size: int) -> None:
    path.write_bytes(path.read_bytes()[:size])


def run(
    root: Path, folder: Path, *options: str, parts: tuple[str, ...] = ("S1", "Walking", "6", str(made.LAST))
) -> int:
    return cli.main(["dataset", "humaneva", str(root), *parts, "-o", str(folder), "--quiet", *options])


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_one_clear_line_and_nothing_is_written(name, whole, tmp_path, capsys):
    breaking, message = FAULTS[name]
    root = made.copied(whole, tmp_path)
    breaking(root)
    assert run(root, tmp_path / "scene") == BAD_INPUT
    err = capsys.readouterr().err
    assert re.search(message, err)
    assert err.count("\n") == 1
    assert "; " in err  # the remedy
    assert not (tmp_path / "scene").exists()


SEQUENCES = {
    ("S2", "Walking"): r"HumanEva_I: holds no S2",
    ("S4", "Walking"): r"S4 Walking: is no sequence with both .*; give one of S1, S2, S3 and",
    ("S1", "Combo"): r"S1 Combo: is no sequence .* Walking, Jog, ThrowCatch, Gestures, Box",
}


@pytest.mark.parametrize("sequence", SEQUENCES)
def test_a_sequence_that_is_not_there(sequence, whole, tmp_path, capsys):
    assert run(whole, tmp_path / "scene", parts=sequence) == BAD_INPUT
    assert re.search(SEQUENCES[sequence], capsys.readouterr().err)


RANGES = {
    ("0", "20"): r"frames 0 to 20 are not a range; count from 1",
    ("9", "8"): r"frames 9 to 8 are not a range",
    ("nine", "20"): r"'nine' is not the number of a frame; give whole numbers",
    ("6", "1203"): r"\.avi: has 28 frames, .*, not 1203; copy it again, or give 2\d as LAST$",
}


@pytest.mark.parametrize("frames", RANGES)
def test_a_range_that_is_none_or_not_there(frames, whole, tmp_path, capsys):
    assert run(whole, tmp_path / "scene", parts=("S1", "Walking", *frames)) == BAD_INPUT
    assert re.search(RANGES[frames], capsys.readouterr().err, re.M)


def test_a_root_that_is_not_there(tmp_path, capsys):
    assert run(tmp_path / "nowhere", tmp_path / "scene") == BAD_INPUT
    assert re.search(r"nowhere: no such folder; check the path", capsys.readouterr().err)


def test_the_proposed_last_frame_is_one_that_works(whole, tmp_path, capsys):
    run(whole, tmp_path / "scene", parts=("S1", "Walking"))
    proposed = re.search(r"give (\d+) as LAST", capsys.readouterr().err)[1]
    assert run(whole, tmp_path / "scene", parts=("S1", "Walking", "6", proposed)) == OK


def test_a_folder_with_files_is_not_written_into_unless_forced(whole, tmp_path, capsys):
    scene = tmp_path / "scene"
    assert run(whole, scene) == OK
    assert run(whole, scene) == BAD_INPUT
    assert "holds files already" in capsys.readouterr().err
    assert run(whole, scene, "--force") == OK


def test_without_ezc3d_the_remedy_is_to_install_it(whole, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "ezc3d", None)
    assert run(whole, tmp_path / "scene") == BAD_INPUT
    assert 'needs the package ezc3d to be read; pip install "mmocap-warp[humaneva]"' in capsys.readouterr().err
