"""``mmocap calib convert``: what it writes, says and refuses."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from calibration_files import humaneva, write_colmap_model
from synthetic import ring_rig

from mmocap_warp.cli import main
from mmocap_warp.cli.console import BAD_INPUT, OK, USAGE
from mmocap_warp.formats.calibration.toml_rig import write_toml_rig
from mmocap_warp.formats.table import read_calibration

RIG = ring_rig(3)


def convert(*arguments: object) -> int:
    return main(["calib", "convert", *map(str, arguments)])


@pytest.mark.parametrize("name", ["b.toml", "intri.yml", "cameras.txt", "b.usda"])
def test_each_output_reads_back(tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str) -> None:
    write_toml_rig(tmp_path / "a.toml", RIG)
    (tmp_path / "out").mkdir()
    output = tmp_path / "out" / name
    assert convert(tmp_path / "a.toml", "-o", output, "--up", "+y", "--json") == OK
    told = json.loads(capsys.readouterr().out)
    assert [camera["name"] for camera in told["cameras"]] == list(RIG.names)
    assert {Path(file).name for file in told["files"]} == {path.name for path in (tmp_path / "out").glob("[!.]*")}
    again = read_calibration(output, "m", "+y")
    assert again.up == "+y"
    for key in ("K", "R", "t", "size", "distortion"):
        np.testing.assert_allclose(getattr(again, key), getattr(RIG, key), rtol=0, atol=1e-12)


def test_lengths_and_sizes_can_be_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_colmap_model(tmp_path, RIG)
    assert convert(tmp_path, "-o", tmp_path / "mm.toml", "--units", "mm") == BAD_INPUT  # a rig of 7 mm
    assert convert(tmp_path, "-o", tmp_path / "m.toml", "--units", "m") == OK
    (tmp_path / "cal").mkdir()
    (tmp_path / "cal/C1.cal").write_text(humaneva(RIG, 0))
    assert convert(tmp_path / "cal", "-o", tmp_path / "h.toml", "--size", "640x480") == OK
    assert capsys.readouterr().out.splitlines()[-1].endswith("h.toml: C1 as Pose2Sim/aniposelib TOML")
    assert convert(tmp_path / "cal", "-o", tmp_path / "h.toml", "--force") == BAD_INPUT
    assert "does not say how large the camera's images are; add the image size" in capsys.readouterr().err


@pytest.mark.parametrize("beside", ["images.txt", "points3D.txt", "cameras.txt"])
def test_nothing_is_replaced_without_force(tmp_path: Path, capsys: pytest.CaptureFixture[str], beside: str) -> None:
    write_toml_rig(tmp_path / "a.toml", RIG)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / beside).write_text("mine")
    assert convert(tmp_path / "a.toml", "-o", tmp_path / "out/cameras.txt") == BAD_INPUT
    assert f"{beside}: exists already; give --force" in capsys.readouterr().err
    assert [file.name for file in (tmp_path / "out").glob("[!.]*")] == [beside]
    assert convert(tmp_path / "a.toml", "-o", tmp_path / "out/cameras.txt", "--force") == OK


@pytest.mark.parametrize(
    ("options", "code", "words"),
    [
        (
            ["-o", "b.xml"],
            BAD_INPUT,
            "b.xml: ends in '.xml', which is none of the known formats; give Pose2Sim/anipose",
        ),
        (["-o", "b.toml", "--units", "km"], USAGE, "--units must be one of m, mm, cm, in, ft, got 'km'"),
        (["-o", "b.toml", "--up", "z"], USAGE, "--up must be one of +x"),
        (["-o", "b.toml", "--size", "640"], USAGE, "--size must be such as 1920x1080, got '640'"),
    ],
)
def test_wrong_usage(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], code: int, words: str
) -> None:
    write_toml_rig(tmp_path / "a.toml", RIG)
    assert convert(tmp_path / "a.toml", *options) == code
    told = capsys.readouterr().err
    assert words in told
    assert told.count("\n") == 1
