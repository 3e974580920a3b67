"""``mmocap calib board`` and ``print-board`` on made views of a board whose cameras are known exactly."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from made_board import board_course, board_rig, in_world_of, render_board

from mmocap_warp.calibration.board.board_cameras import Detections, calibrate_from_board, detect_board
from mmocap_warp.calibration.board.pattern import Board
from mmocap_warp.calibration.solve import UnsolvableError
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.cli import main
from mmocap_warp.cli.console import CHECK_FAILED, OK, USAGE
from mmocap_warp.commands import boards
from mmocap_warp.errors import InputError, UsageError

BOARD = Board.parse("charuco:5x7:80mm")


def exact_detections(rig: CameraRig, close: int, common: int, lag: int = 0) -> list[Detections]:
    """Corners without images, with noise of .05 px; the last camera lags."""
    noise, poses = np.random.default_rng(0), board_course(rig, BOARD, close, common)
    found = []
    for k in range(len(rig)):
        pixels = np.full((len(poses), len(BOARD.corners), 2), np.nan, np.float32)
        for frame, (turn, shift) in enumerate(poses):
            if frame // close == k or frame >= close * len(rig):
                place = rig.R[k] @ shift + rig.t[k]
                seen = cv2.projectPoints(
                    BOARD.corners, cv2.Rodrigues(rig.R[k] @ turn)[0], place, rig.K[k], rig.distortion[k]
                )
                pixels[frame] = seen[0][:, 0] + noise.normal(0, 0.05, (len(BOARD.corners), 2))
        if k == len(rig) - 1:
            pixels = np.roll(pixels, lag, axis=0)
        found.append(Detections(pixels, np.isfinite(pixels[..., 0]).any(axis=1).astype(float)))
    return found


def errors(found: CameraRig, rig: CameraRig) -> tuple[float, float, float]:
    """The worst focal length [%], place [mm] and turn [degrees]."""
    true = in_world_of(rig, 0)
    turns = [np.linalg.norm(cv2.Rodrigues(a @ b.T)[0]) for a, b in zip(found.R, true.R, strict=True)]
    focal = 100 * np.abs(found.K[:, 0, 0] / rig.K[:, 0, 0] - 1).max()
    return focal, 1000 * np.linalg.norm(found.centres - true.centres, axis=1).max(), np.degrees(max(turns))


def test_exact_corners_give_the_cameras() -> None:
    rig = board_rig(3, 1280, 720)
    found = calibrate_from_board(rig.names, rig.size, exact_detections(rig, 25, 15), BOARD, None)
    focal, place, turn = errors(found.rig, rig)
    assert focal < 0.2
    assert place < 5
    assert turn < 0.1


def test_lenses_that_are_known_are_held() -> None:
    rig = board_rig(3)
    found = calibrate_from_board(rig.names, rig.size, exact_detections(rig, 1, 12), BOARD, rig)
    np.testing.assert_array_equal(found.rig.K, rig.K)
    assert errors(found.rig, rig)[1] < 5


@pytest.mark.parametrize("text", ["charuco:5x7:80mm", "chessboard:6x5:80mm"])
def test_corners_in_a_picture_are_the_boards(text: str) -> None:
    """Within a quarter of a pixel of where the lens puts them, in the board's own order."""
    board, rig, noise = Board.parse(text), board_rig(1), np.random.default_rng(0)
    for turn, shift in board_course(rig, board, 0, 3):
        seen = board.find(render_board(rig, 0, board, turn, shift, noise))
        assert seen is not None
        R, t = rig.R[0] @ turn, rig.R[0] @ shift + rig.t[0]
        expected = cv2.projectPoints(board.corners, cv2.Rodrigues(R)[0], t, rig.K[0], rig.distortion[0])[0][:, 0]
        assert np.nanmax(np.abs(seen - expected)) < 0.25


def test_what_is_wrong_is_named() -> None:
    rig = board_rig(3)
    good = exact_detections(rig, 12, 12)
    blind = replace(good[2], pixels=np.full_like(good[2].pixels, np.nan), sharpness=0 * good[2].sharpness)
    alone = replace(good[2], pixels=good[2].pixels.copy())
    alone.pixels[36:] = np.nan
    for third, words in (
        (blind, r"camera 'cam3': the board charuco.* is seen in 0 of 48 frames"),
        (alone, r"camera 'cam3': sees the board in fewer than 5 frames in common with 'cam1'"),
        (exact_detections(rig, 12, 12, lag=1)[2], r"views of the board disagree by .*see that the cameras are in step"),
    ):
        with pytest.raises(InputError, match=words):
            calibrate_from_board(rig.names, rig.size, [*good[:2], third], BOARD, None)


@pytest.mark.parametrize(
    ("printed", "named", "words"),
    [
        ("charuco:5x7:80mm:60mm:6x6_50", BOARD, "it shows markers of the dictionary 6x6_50"),
        ("charuco:7x5:80mm", BOARD, ""),  # which has the same markers
        ("charuco:6x9:60mm", BOARD, "it shows marker 2[0-6], which a board of 5x7 squares lacks"),
        ("chessboard:6x5:80mm", Board.parse("chessboard:5x4:80mm"), "it shows a chessboard of 6x5 squares"),
    ],
)
def test_another_board_is_named(printed: str, named: Board, words: str) -> None:
    """The last one is what they say who count inner corners."""
    rig, noise = board_rig(1), np.random.default_rng(0)
    ((turn, shift),) = board_course(rig, BOARD, 0, 1)
    found = detect_board([render_board(rig, 0, Board.parse(printed), turn, shift, noise)], named)
    assert re.fullmatch(words, found.other or "")


def test_corners_on_no_flat_grid_are_no_chessboard(monkeypatch: pytest.MonkeyPatch) -> None:
    """The exhaustive search sometimes puts a row of corners on something beside the board."""
    board, rig, noise = Board.parse("chessboard:6x5:80mm"), board_rig(1), np.random.default_rng(0)
    image = render_board(rig, 0, board, *board_course(rig, board, 0, 1)[0], noise)
    corners = board.find(image)
    assert corners is not None
    corners[-5:] += [0, 60]
    monkeypatch.setattr(
        cv2, "findChessboardCornersSBWithMeta", lambda *_, **flags: (True, corners, np.zeros((4, 5), np.uint8))
    )
    assert board.find(image) is None


def test_the_drawing_is_printed_and_wrong_boards_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["calib", "print-board", "charuco:5x7:40mm", "-o", str(tmp_path / "b.svg")]) == OK
    drawing = (tmp_path / "b.svg").read_text()
    assert 'width="220mm"' in drawing
    assert "print at 100 %: this ruler must measure 100 mm" in drawing
    wrong = {
        "charuco:5x7": "board must be such as",
        "chessboard:5x7:40mm": "turned by half",
        "charuco:30x40:40mm:30mm:4x4_50": "name a larger one, such as charuco:30x40:40mm:30mm:4x4_1000",
        "charuco:50x70:40mm:30mm:4x4_50": "4x4_50; take fewer squares",
    }
    for text, words in wrong.items():
        assert main(["calib", "print-board", text, "-o", str(tmp_path / "c.svg")]) == USAGE
        assert words in capsys.readouterr().err


@pytest.mark.nightly
def test_five_cameras_of_made_pictures() -> None:
    rig, noise = board_rig(5, 1280, 720), np.random.default_rng(1)
    poses = board_course(rig, BOARD, 40, 40)
    found = []
    for k in range(5):
        shown = [place // 40 == k or place >= 200 for place in range(len(poses))]
        images = (
            render_board(rig, k, BOARD, *pose, noise) if see else None for see, pose in zip(shown, poses, strict=True)
        )
        found.append(detect_board(images, BOARD))
    focal, place, turn = errors(calibrate_from_board(rig.names, rig.size, found, BOARD, None).rig, rig)
    print(f"focal {focal:.3f} %, place {place:.2f} mm, turn {turn:.3f} degrees")
    assert focal < 0.2
    assert place < 5
    assert turn < 0.1


def test_one_camera_is_no_rig(tmp_path: Path) -> None:
    source = SimpleNamespace(video=SimpleNamespace(size=(640, 480)))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(boards, "_sources", lambda _: {"cam01": (source.video, source)})
        with pytest.raises(UsageError, match="a rig has two cameras at least"):
            boards.calibrate_board(tmp_path / "scene.toml", "charuco:5x7:80mm")


def test_videos_of_one_name_are_called_by_their_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(boards, "open_frames", str)
    videos = [tmp_path / name for name in ("cam1/board.mp4", "cam2/board.mp4", "cam3/other.mp4")]
    assert [*boards._sources(videos)] == ["cam1", "cam2", "other"]


def test_a_walk_that_shows_no_floor_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    def unsolvable(**_) -> None:
        raise UnsolvableError("the walk does not show the floor")

    monkeypatch.setattr(boards, "calibrate_board", unsolvable)
    assert main(["calib", "board", "a.mp4", "b.mp4", "--board", "charuco:5x7:80mm"]) == CHECK_FAILED
    assert "check failed: the walk does not show the floor" in capsys.readouterr().out
