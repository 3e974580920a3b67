"""Khronos' own glTF-Validator finds nothing, not even a hint; collected where node and the package are there."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import pytest
from synthetic import synthetic_result

from mmocap_warp.formats.exports.glb import write_body_glb
from mmocap_warp.formats.table import export
from mmocap_warp.formats.usd.usd_body import read_body, read_motions
from mmocap_warp.rigging.shipped import body_file

SCRIPT = """
const validator = require("gltf-validator"), bytes = require("fs").readFileSync(process.argv[1]);
validator.validateBytes(new Uint8Array(bytes)).then(report => console.log(JSON.stringify(report)));
"""


@pytest.mark.parametrize("frames", [1, 6])
def test_the_validator_finds_nothing(tmp_path: Path, frames: int) -> None:
    path = tmp_path / "walk.glb"
    export(synthetic_result(frames, up="+z"), path)
    answer = subprocess.run(["node", "-e", SCRIPT, str(path)], capture_output=True, text=True, check=True)
    report = json.loads(answer.stdout)
    assert report["issues"]["messages"] == []
    assert report["info"]["hasSkins"]
    assert report["info"]["animationCount"] == 1


@pytest.mark.parametrize(("name", "motions"), [("fox", 3), ("hand", 2), ("anymal", 1), ("panda", 1)])
def test_nor_in_a_body_with_its_own_motions(name: str, motions: int, tmp_path: Path) -> None:
    write_body_glb(read_body(body_file(name)), read_motions(body_file(name)), tmp_path / "body.glb")
    command = ["node", "-e", SCRIPT, str(tmp_path / "body.glb")]
    report = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    assert report["issues"]["messages"] == []
    assert report["info"]["animationCount"] == motions
