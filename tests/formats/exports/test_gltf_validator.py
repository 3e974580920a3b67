"""Khronos' own glTF-Validator finds nothing, not even a hint; collected where node and the package are there."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import pytest
from synthetic import synthetic_result

from mmocap_warp.formats.table import export

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
