"""``mmocap calib refine`` and ``check``: what they write, say and refuse, of what was found (which is tested apart)."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
from moving_person import RIG, write_scene

import mmocap_warp as mm
from mmocap_warp.calibration import camera_check as checking
from mmocap_warp.calibration.adjust.adjustment import AdjustConfig
from mmocap_warp.calibration.adjust.camera_changes import KINDS, OFFSET, Deviations, changed
from mmocap_warp.calibration.camera_check import BodyInView, CameraCheck, Finding
from mmocap_warp.calibration.gross_mistake import IMAGE_SIZE, MIRRORED, SWAPPED, Mistake
from mmocap_warp.calibration.refine import refinement as refining
from mmocap_warp.calibration.refine.refinement import Overlaps, Refinement
from mmocap_warp.cli import main
from mmocap_warp.cli.console import BAD_INPUT, CHECK_FAILED, OK, USAGE
from mmocap_warp.formats.table import read_calibration

CAMERAS = len(RIG)


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("scene")
    write_scene(folder, frames=2)
    return folder


def refinement(gain: float) -> Refinement:
    """The third camera turned and late; its principal point is not known."""
    change = np.zeros((CAMERAS, len(KINDS)))
    change[2, 1], change[2, OFFSET] = np.radians(2.0), 0.05
    moved = change != 0
    undetermined = np.zeros(change.shape, bool)
    undetermined[2, KINDS.index("centre_x")] = True
    before, after = (Overlaps(np.full(CAMERAS, iou), np.full(CAMERAS, iou - 0.1)) for iou in (0.8, 0.8 + gain))
    return Refinement(changed(RIG, change), change, 0.01 * np.ones(change.shape), moved, undetermined, 0, before, after)


@pytest.fixture
def given(monkeypatch: pytest.MonkeyPatch) -> list[AdjustConfig]:
    """Settings that refining was called with, which gains .05 for a seed of 0 and loses as much for others."""
    configs: list[AdjustConfig] = []

    def refine(scene, body, config, progress) -> Refinement:
        configs.append(config)
        progress("judged", 1.0)
        return refinement(0.05 if config.seed == 0 else -0.05)

    monkeypatch.setattr(refining, "refine", refine)
    return configs


def test_what_is_better_is_written_and_told(scene: Path, tmp_path: Path, capsys, given) -> None:
    output = tmp_path / "refined.toml"
    asked = ["--height", "1.8", "--fixed", "cam02", "--distance", "cam01", "cam02", "3.2", "--focal", "0"]
    assert main(["calib", "refine", str(scene), "-o", str(output), "--quiet", *asked]) == OK
    config = given[0]
    assert (config.height, config.fixed, config.distance) == (1.8, "cam02", ("cam01", "cam02", 3.2))
    assert config.deviations == Deviations(focal=0.0)
    told = capsys.readouterr().out
    assert "cam03   pan     +2.00" in told
    assert "not determined by these masks: cam03 centre x" in told
    assert "in the scene, [cameras.cam03] offset = 0.05" in told
    again = read_calibration(output, "m", RIG.up)
    np.testing.assert_allclose(again.R, refinement(0.05).rig.R, atol=1e-9)
    assert tomllib.loads(output.read_text())["metadata"]["offsets"]["cam03"] == 0.05


def test_masks_that_were_made_are_tracked_with_cameras_that_are_refined_again(
    scene: Path, tmp_path: Path, capsys, given
) -> None:
    made = mm.mask(scene, tmp_path / "made").scene
    assert main(["calib", "refine", str(made), "-o", str(tmp_path / "refined.toml"), "--quiet"]) == OK
    told = capsys.readouterr().out.splitlines()
    assert told[-1] == f"next: mmocap track {made} -o {tmp_path / 'made' / 'result.usdc'} --cameras refine"


def test_what_is_no_better_is_not_written(scene: Path, tmp_path: Path, capsys, given) -> None:
    output = tmp_path / "refined.toml"
    assert main(["calib", "refine", str(scene), "-o", str(output), "--quiet", "--json", "--seed", "1"]) == CHECK_FAILED
    told = json.loads(capsys.readouterr().out)
    assert told["better"] is False
    assert told["file"] is None
    assert told["cameras"]["cam03"]["pan"]["by"] == pytest.approx(2.0)
    assert told["cameras"]["cam03"]["centre_x"] == {
        "by": 0.0, "sigma": 0.01, "unit": "px", "moved": False, "determined": False,
    }  # fmt: skip
    assert not output.exists()


@pytest.mark.parametrize(
    "wrong", [["--fixed", "cam9"], ["--distance", "cam01", "cam9", "3"], ["--rotation", "-1"], ["--height", "0"]]
)
def test_wrong_settings_are_told_in_a_line(scene: Path, tmp_path: Path, capsys, wrong: list[str]) -> None:
    assert main(["calib", "refine", str(scene), "-o", str(tmp_path / "a.toml"), *wrong]) == USAGE
    assert wrong[0].removeprefix("--") in capsys.readouterr().err


def test_a_file_that_exists_is_kept(scene: Path, capsys) -> None:
    assert main(["calib", "refine", str(scene), "-o", str(scene / "calibration.toml")]) == BAD_INPUT
    assert "exists already" in capsys.readouterr().err


def test_findings_are_told_and_drawn(scene: Path, tmp_path: Path, capsys, monkeypatch) -> None:
    mask = np.zeros((40, 60), bool)
    mask[10:30, 20:40] = True
    findings = (
        Finding("cam03", "rotation", change=refinement(0.0).change, explained=0.9, others=("principal point",)),
        Finding.of(Mistake(("cam01",), MIRRORED)),
        Finding.of(Mistake(("cam02", "cam04"), SWAPPED)),
        Finding.of(Mistake(("cam04",), IMAGE_SIZE, 1.5)),
    )
    found = CameraCheck(
        RIG.names, np.full(4, 0.8), np.full(4, 0.7), findings, 0.5, (BodyInView("cam03", mask, mask, ~mask),)
    )
    monkeypatch.setattr(checking, "check", lambda scene, body, config, progress: found)
    assert main(["calib", "check", str(scene), "-o", str(tmp_path / "views"), "--quiet"]) == CHECK_FAILED
    told = capsys.readouterr().out
    assert "cam03: probably its rotation, to be changed by tilt +0.00 deg, pan +2.00 deg, roll +0.00 deg" in told
    assert "or else its principal point; explains 90 %" in told
    assert "cam01: pictures are mirrored" in told
    assert "cam02 and cam04: one has the other's masks, or its calibration" in told
    assert "cam04: pictures are 1.5 times as large" in told
    assert (tmp_path / "views" / "cam03.png").is_file()


def test_a_sound_rig_passes(scene: Path, capsys, monkeypatch) -> None:
    monkeypatch.setattr(
        checking,
        "check",
        lambda scene, body, config, progress: CameraCheck(RIG.names, np.full(4, 0.9), np.full(4, 0.8), (), 1.0),
    )
    assert main(["calib", "check", str(scene), "--quiet", "--json"]) == OK
    told = json.loads(capsys.readouterr().out)
    assert told["findings"] == []
    assert told["cameras"]["cam01"] == {"covered_by_the_others": 0.9, "iou": 0.8}


def test_what_is_not_known_of_two_cameras_is_a_dash(scene: Path, capsys, monkeypatch) -> None:
    none = CameraCheck(RIG.names, np.full(4, np.nan), None, (), 1.0)
    monkeypatch.setattr(checking, "check", lambda scene, body, config, progress: none)
    assert main(["calib", "check", str(scene), "--quiet"]) == OK
    assert [*capsys.readouterr().out.split("\n")[1].split()] == ["cam01", "-", "-"]
