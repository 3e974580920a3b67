"""A kill of what is quick; all commands and a hundred kills are a command, see docs/testing.md."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path


def test_a_killed_command_ends_with_the_same_files_and_leaves_none_cut_short():
    command = [sys.executable, Path(__file__).with_name("kill"), "--kills", "1", "--only", "mask"]
    told = subprocess.run(command, capture_output=True, text=True)
    assert told.returncode == 0, told.stdout + told.stderr
    assert "1 kills, " in told.stdout
    assert told.stdout.endswith(" 0 differ\n")
