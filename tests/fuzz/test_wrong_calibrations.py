"""Wrong calibration files of every reader, through the command line: one clear line each, exit code 3."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from calibration_readers import READERS
from worker import damaged

from mmocap_warp.cli import main
from mmocap_warp.cli.console import BAD_INPUT, OK

MOST_CASES, LONGEST_LINE = 2000, 1250
CALIBRATIONS = [reader for reader in READERS if not reader.name.startswith("draft-")]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("reader", CALIBRATIONS, ids=lambda reader: reader.name)
@pytest.mark.parametrize("most", [15, pytest.param(100, marks=pytest.mark.nightly)])
def test_wrong_files_are_one_clear_line_each(tmp_path, capfd, reader, most):
    reader.write(tmp_path)
    file = tmp_path / reader.file
    sound = file.read_bytes()
    command = ["calib", "convert", str(file), "--units", "m", "--size", "640x480", "--force", "-o"]
    assert main([*command, str(tmp_path / "written.toml")]) == OK
    capfd.readouterr()
    wrong = 0
    for case in range(MOST_CASES):
        file.write_bytes(damaged(reader, sound, 14, case))
        code = main([*command, str(tmp_path / "written.toml")])
        said = capfd.readouterr()
        assert code in (OK, BAD_INPUT), (case, said.err)
        if code == BAD_INPUT:
            assert (said.out, said.err.count("\n")) == ("", 1), case
            assert said.err.startswith("mmocap: ")
            assert "Traceback" not in said.err
            assert len(said.err) < LONGEST_LINE
            wrong += 1
        if wrong == most:
            return
    pytest.fail(f"{wrong} wrong files in {MOST_CASES}")
