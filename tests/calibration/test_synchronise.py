"""Common time of views: planted lags come back, and where nothing tells, that is said."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import cv2
import numpy as np
import pytest
from ball_scene import edit

from mmocap_warp.calibration.sync import synchronise as sync
from mmocap_warp.calibration.sync.hull_agreement import HullAgreement, Sampling
from mmocap_warp.calibration.sync.lag_course import LagCourse, lag_course
from mmocap_warp.calibration.sync.shared_motion import PairScores, common_offsets, pair_scores
from mmocap_warp.calibration.sync.silhouette_motion import LIKE, SilhouetteMotion
from mmocap_warp.calibration.sync.synchronise import margin_by_motion, synchronise
from mmocap_warp.cameras.rig import project
from mmocap_warp.cli import main
from mmocap_warp.errors import InputError
from mmocap_warp.formats.image_files import write_png
from mmocap_warp.scene.camera_tables import write_timing
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.scenes import ROOT

FPS, FRAMES = 60.0, 150
LAGS = {"left": 0, "front": 4, "right": -7}
SCENE = """
[scene]
fps = 60

[cameras]
# No calibration yet.
[cameras.left]   # the first
masks = "left"
frame_offset = 9 # a wrong guess
[cameras.front]
masks = "front"
[cameras.right]
masks = "right"
"""


def wandering(values: int, seed: int, frames: int = FRAMES + 40) -> np.ndarray:
    """(frame, value) smooth and never the same again, of unit variance."""
    noise = np.random.default_rng(seed).standard_normal((frames + 40, values))
    kernel = np.exp(-0.5 * (np.arange(-15, 16) / 5.0) ** 2)
    smooth = np.stack([np.convolve(column, kernel, "same") for column in noise.T], axis=1)[20:-20]
    return smooth / smooth.std(axis=0)


def silhouette(width: float, height: float, lean: float) -> np.ndarray:
    """An ellipse on feet that stay."""
    mask = np.zeros((160, 120), np.uint8)
    middle = (round(16 * (60 + lean)), round(16 * (140 - height)))
    cv2.ellipse(mask, middle, (round(16 * width), round(16 * height)), lean, 0, 360, 1, -1, cv2.LINE_AA, 4)
    return mask.astype(bool)


@pytest.fixture
def unsynchronised(tmp_path: Path) -> Path:
    """Three views of what bends and stretches, each in proportions of its own, with lags."""
    motion = wandering(3, seed=4)
    random = np.random.default_rng(5)
    for name, lag in LAGS.items():
        mix = random.uniform(0.5, 1.5, 3) * [6, 8, 7] * random.choice([-1, 1], 3)
        (tmp_path / name).mkdir()
        for frame in range(FRAMES):
            width, height, lean = mix * motion[20 + frame - lag]
            write_png(tmp_path / name / f"{frame:04d}.png", silhouette(26 + width, 50 + height, lean))
    (tmp_path / "scene.toml").write_text(SCENE)
    return tmp_path


def test_planted_lags_are_found_without_a_calibration(unsynchronised: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sync", str(unsynchronised), "--json", "--quiet"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert {name: camera["offset_frames"] for name, camera in found["cameras"].items()} == LAGS
    assert found["by"] == "motion"
    assert found["cameras"]["front"]["offset_s"] == pytest.approx(4 / 60, abs=1e-6)


def test_lags_beyond_what_is_possible_are_not_looked_for(
    unsynchronised: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["sync", str(unsynchronised), "--within", "0.2", "--json", "--quiet"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert {name: camera["offset_frames"] for name, camera in found["cameras"].items()} == LAGS
    assert all(abs(camera["rival_frames"] - camera["offset_frames"]) <= 12 for camera in found["cameras"].values())
    assert main(["sync", str(unsynchronised), "--within", "0", "--quiet"]) == 2
    assert "--within must be a time in seconds" in capsys.readouterr().err


def test_found_lags_are_written_and_all_else_stays(unsynchronised: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sync", str(unsynchronised), "--write", "--quiet"]) == 0
    assert "written" in capsys.readouterr().out
    text = (unsynchronised / "scene.toml").read_text()
    kept = [line for line in SCENE.splitlines() if "frame_offset" not in line]
    assert [line for line in text.splitlines() if not line.startswith("offset")] == kept
    assert "[cameras.front]\noffset = 0.066667\n" in text
    assert "[cameras.left]   # the first\nmasks" in text


def test_who_shows_another_motion_is_not_believed(unsynchronised: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = sorted((unsynchronised / "front").glob("*.png"))
    images = [file.read_bytes() for file in files]
    for file, image in zip(files, reversed(images), strict=True):
        file.write_bytes(image)
    before = (unsynchronised / "scene.toml").read_text()
    assert main(["sync", str(unsynchronised), "--write", "--quiet"]) == 4
    assert "check failed: front" in capsys.readouterr().out
    assert (unsynchronised / "scene.toml").read_text() == before


def test_a_person_who_stands_still_is_named(unsynchronised: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in LAGS:
        for file in (unsynchronised / name).glob("*.png"):
            write_png(file, silhouette(26, 50, 0))
    assert main(["sync", str(unsynchronised), "--quiet"]) == 4
    assert "stands still" in capsys.readouterr().out


def test_cameras_of_other_rates_are_compared_by_time(unsynchronised: Path) -> None:
    motion = wandering(3, seed=4)
    frames = np.arange(int(FRAMES * 50 / 60))
    folder = unsynchronised / "front"
    for file in folder.glob("*.png"):
        file.unlink()
    at = 20 + frames * 60 / 50 - 6
    for frame, (width, height, lean) in enumerate(
        zip(*(np.interp(at, np.arange(len(motion)), column) for column in motion.T), strict=True)
    ):
        write_png(folder / f"{frame:04d}.png", silhouette(26 - 7 * width, 50 + 6 * height, 8 * lean))
    edit(unsynchronised, 'masks = "front"', 'masks = "front"\nfps = 50')
    found = synchronise(load_scene(unsynchronised, calibrated=False))
    assert found.views["front"].frames == pytest.approx(6, abs=1)
    assert found.views["right"].frames == -7


@pytest.mark.parametrize(
    ("taken", "says"),
    [
        (np.delete(np.arange(345), np.s_[170:175]), "front dropped 5 of its frames near frame 1[5-9]"),
        (np.arange(345), None),
        (
            np.rint(np.arange(330) * 1.02).astype(int),
            r"front runs (1.9|2.\d) % slower than it says.*set fps = 58\.[6-9]",
        ),
    ],
    ids=["dropped", "sound", "slower"],
)
def test_a_lag_that_changes_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], taken: np.ndarray, says: str | None
) -> None:
    motion = wandering(3, seed=4, frames=345)
    random = np.random.default_rng(5)
    for name in LAGS:
        mix = random.uniform(0.5, 1.5, 3) * [6, 8, 7] * random.choice([-1, 1], 3)
        (tmp_path / name).mkdir()
        for frame, source in enumerate(taken if name == "front" else np.arange(345)):
            width, height, lean = mix * motion[source]
            write_png(tmp_path / name / f"{frame:04d}.png", silhouette(26 + width, 50 + height, lean))
    (tmp_path / "scene.toml").write_text(SCENE.replace("frame_offset = 9 # a wrong guess\n", ""))
    code = main(["sync", str(tmp_path), "--quiet"])
    assert code == (4 if says else 0)
    if says:
        assert re.search(says, capsys.readouterr().out)


def test_one_camera_and_empty_masks_are_one_clear_line(unsynchronised: Path) -> None:
    scene = load_scene(unsynchronised, calibrated=False)
    with pytest.raises(InputError, match="synchronising needs two"):
        synchronise(replace(scene, cameras=scene.cameras[:1]))
    for file in (unsynchronised / "front").glob("*.png"):
        if file.stem > "0000":
            write_png(file, np.zeros((160, 120), bool))
    with pytest.raises(InputError, match="somebody in fewer than two frames"):
        synchronise(load_scene(unsynchronised, calibrated=False))


@pytest.mark.parametrize("frames", [2, 5, 12])
def test_a_few_frames_decide_nothing_and_are_no_error(frames: int) -> None:
    report = synchronise(load_scene(ROOT / "walk", str(frames)))
    assert not any(view.sure for view in report.views.values())


def test_all_pairs_outvote_a_period() -> None:
    """One pair alone sees a period too many; with the others it does not."""
    source = wandering(4, seed=1)
    random = np.random.default_rng(2)
    lags = np.array([0, 3, -5, 10])
    signals = [source[20 - lag : 160 - lag] @ random.standard_normal((4, 6)) for lag in lags]
    np.testing.assert_array_equal(common_offsets(pair_scores(signals, np.zeros(6), FPS, 20)), lags)


def made_scores(reach: int, *pairs: dict[int, float], views: int = 2) -> PairScores:
    """What pairs of views share at some lags, pair by pair; nothing at all others."""
    score = np.zeros((views, views, 2 * reach + 1))
    for (one, other), shared in zip(combinations(range(views), 2), pairs, strict=True):
        for lag, value in shared.items():
            score[one, other, reach + lag] = score[other, one, reach - lag] = value
    return PairScores(score, reach, 2)


@pytest.mark.parametrize(("share", "lag"), [(1.5, 2), (2.9, 2), (3.1, 40)])
def test_a_long_lag_must_score_three_times_as_high_as_a_short_one(monkeypatch, share: float, lag: int) -> None:
    """Steps repeat themselves, and the next one may fit a little better."""
    monkeypatch.setattr(sync, "pair_scores", lambda *_: made_scores(50, {2: 1.0, 40: share}))
    _, offsets = sync._offsets_by_motion([np.zeros((180, 6))] * 2, FPS, 1.0)
    np.testing.assert_array_equal(offsets, [0, lag])


@pytest.mark.parametrize(("third", "sure"), [(20, False), (1, True)])
def test_half_of_the_other_views_must_agree_alone(third: int, sure: bool) -> None:
    """One view that shares much decides for all; the others see the same lag or another one."""
    alone = {0: 0.2, third: 1.0}
    scores = made_scores(30, {0: 10.0}, alone, alone, {0: 1.0}, {0: 1.0}, {0: 1.0}, views=4)
    view = sync._judge(scores, 0, np.zeros(4, int), 0.0, LagCourse(), False)
    assert view.rival < 0.75
    assert view.sure == sure


def test_a_hull_is_of_one_moment(unsynchronised: Path) -> None:
    from ball_scene import RIG

    lags, radius = np.array([0, 2, -3]), 0.25
    path = 0.25 * wandering(3, seed=7, frames=100)

    class View:
        def __init__(self, k: int) -> None:
            self.k = k

        def __len__(self) -> int:
            return 80

        def at(self, frames: np.ndarray) -> np.ndarray:
            return np.stack([self.mask(path[10 + frame - lags[self.k]]) for frame in frames])

        def mask(self, centre: np.ndarray) -> np.ndarray:
            width, height = RIG.size[self.k]
            pixel = project(RIG, (centre + RIG_CENTRE)[None])[self.k, 0]
            depth = (RIG.R[self.k] @ (centre + RIG_CENTRE) + RIG.t[self.k])[2]
            y, x = np.mgrid[:height, :width]
            inside: np.ndarray = (x - pixel[0]) ** 2 + (y - pixel[1]) ** 2 < (radius * RIG.K[self.k, 0, 0] / depth) ** 2
            return inside

    RIG_CENTRE = np.array([0.0, 1.0, 0.0])
    agreement = HullAgreement(RIG, [View(k) for k in range(3)], np.zeros(3, int), 6, Sampling(25, 20_000, 3))
    found, _ = agreement.offsets()
    np.testing.assert_allclose(found - found[0], lags, atol=1)


@pytest.mark.parametrize(
    ("rate", "seconds", "sure"), [(1.0, 1.5, True), (1.0, 4, True), (50 / 60, 1.5, False), (50 / 60, 4, False)]
)
def test_the_parts_of_a_recording_must_agree(rate: float, seconds: float, sure: bool) -> None:
    """A camera of another rate gives another lag in each part, whatever the whole recording says."""
    frames, random = int(seconds * FPS), np.random.default_rng(3)
    source = wandering(4, seed=6, frames=400)
    at = 20 + np.arange(frames) / [[1.0], [1.0], [rate]]
    signals = [
        np.stack([np.interp(times, np.arange(len(source)), column) for column in source.T], axis=1)
        @ random.standard_normal((4, len(LIKE)))
        for times in at
    ]
    assert (margin_by_motion(signals, np.zeros(3, int), FPS) < 2.0) == sure


def test_too_short_a_recording_has_no_confidence_interval() -> None:
    signals = [wandering(len(LIKE), seed=seed, frames=20)[:20] for seed in range(3)]
    assert margin_by_motion(signals, np.zeros(3, int), FPS) == float("inf")


def test_signals_do_not_see_a_hole_in_time() -> None:
    """A frame without a silhouette is bridged, not taken for motion."""
    motion = wandering(3, seed=3)
    whole, holed = SilhouetteMotion(), SilhouetteMotion()
    for frame in range(60):
        mask = silhouette(*(26, 50, 0) + [5, 5, 5] * motion[frame])
        whole.add(mask)
        holed.add(np.zeros_like(mask) if frame in (20, 41) else mask)
    off = whole.signals(FPS) - holed.signals(FPS)
    assert np.abs(off).max() < 0.5 * whole.signals(FPS).std(axis=0).max()


def test_inline_tables_are_not_touched(tmp_path: Path) -> None:
    file = tmp_path / "scene.toml"
    file.write_text('cameras = { cam = { masks = "m" } }\n')
    with pytest.raises(InputError, match="by hand"):
        write_timing(file, {"cam": {"offset": 0.1}})
    file.write_text('[cameras."my cam"]')
    write_timing(file, {"my cam": {"offset": 0.1}})
    assert file.read_text() == '[cameras."my cam"]\noffset = 0.1\n'


def test_line_ends_stay(tmp_path: Path) -> None:
    file = tmp_path / "scene.toml"
    file.write_bytes(b"[cameras.cam] # mine\r\nmasks = 'm'\r\n")
    write_timing(file, {"cam": {"offset": 0.1}})
    assert file.read_bytes() == b"[cameras.cam] # mine\r\noffset = 0.1\r\nmasks = 'm'\r\n"


def test_a_jump_a_slope_and_chance_are_told_apart() -> None:
    frames = np.arange(25, 300, 50)
    scatter = np.array([0.3, -0.2, 0.1, -0.3, 0.2, 0.0])
    assert lag_course(frames, 2 + 2 * scatter) == lag_course(frames[:3], 9 * scatter[:3])
    jumped = lag_course(frames, np.where(frames > 150, 1.0, 3.0) + scatter)
    assert (jumped.jump, jumped.at, jumped.slope) == (-2, 150, 0.0)
    drifting = lag_course(frames, 4 + 0.02 * frames + scatter)
    assert drifting.jump == 0
    assert drifting.slope == pytest.approx(0.02, abs=0.002)
    assert drifting.start == pytest.approx(4, abs=0.4)
    assert lag_course(frames, 4 * scatter * [1, -1, 1, -1, 1, 1]).jump == 0
