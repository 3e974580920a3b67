"""Runs the tests of a file in a copy of the tree, as it is or with a mutant in it."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

from mutant import Mutant

SURVIVED, KILLED, UNBUILT, TIMEOUT = "survived", "killed", "does not build", "timeout"
_UNBUILT = re.compile(
    r"WarpCodegen|kernel build failed|overload for|errors? during collection|Error parsing|ParseError"
)


class Copy:
    """A tree to mutate.

    Args:
        root: the repository.
        folder: where the copy is made.
        cache: Warp's kernel cache; trees may share one, as modules are told apart by their code.
    """

    def __init__(self, root: Path, folder: Path, cache: Path) -> None:
        self._root, self._folder = root, folder
        skipped = shutil.ignore_patterns("__pycache__", ".*")
        for name in ("mmocap_warp", "tests", "instruments"):
            shutil.copytree(root / name, folder / name, ignore=skipped, symlinks=True)
        shutil.copytree(root / "kernels", folder / "kernels", ignore=skipped)
        (folder / "scenes").symlink_to(root / "scenes")
        for name in ("kernels", "scenes"):  # where the installed package has them
            (folder / "mmocap_warp" / name).unlink(missing_ok=True)
            (folder / "mmocap_warp" / name).symlink_to(f"../{name}")
        shutil.copy(root / "pyproject.toml", folder)
        self._environment = os.environ | {
            "PYTHONPATH": os.pathsep.join([str(folder), *filter(None, [os.environ.get("PYTHONPATH")])]),
            "PYTHONDONTWRITEBYTECODE": "1",  # a changed file of the same second and size would be taken for the old one
            "MMOCAP_MUTATION": "1",  # which the tests' own settings heed
            "WARP_CACHE_PATH": str(cache),
            "CUDA_VISIBLE_DEVICES": "",
        }

    def outcome(self, mutant: Mutant, tests: list[str], limit: float) -> tuple[str, float, str]:
        """What the tests make of a mutant: one of the words above, the seconds, and what the tests said last."""
        file, source = self._folder / mutant.file, (self._root / mutant.file).read_text(encoding="utf-8")
        file.write_text(mutant.applied(source), encoding="utf-8")
        try:
            return self.run(tests, limit)
        finally:
            file.write_text(source, encoding="utf-8")

    def run(self, tests: list[str], limit: float) -> tuple[str, float, str]:
        """Run tests up to the first that fails, for at most so many seconds."""
        # The project's own options are for all cores; a trial has one.
        options = ["-x", "-q", "-rfE", "--tb=short", "-p", "no:cacheprovider", "-n", "0"]
        options += ["-o", "addopts=--import-mode=importlib"]
        began = time.monotonic()
        run = subprocess.Popen(
            [sys.executable, "-m", "pytest", *options, *tests],
            cwd=self._folder,
            env=self._environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            start_new_session=True,
        )
        try:
            output, _ = run.communicate(timeout=limit)
        except subprocess.TimeoutExpired:
            os.killpg(run.pid, signal.SIGKILL)
            run.communicate()
            return TIMEOUT, time.monotonic() - began, f"after {limit:.0f} s"
        seconds = time.monotonic() - began
        if run.returncode == 0:
            return SURVIVED, seconds, ""
        told = [line for line in output.splitlines() if line.startswith(("FAILED", "ERROR"))]
        status = UNBUILT if _UNBUILT.search(output) else KILLED
        return status, seconds, (told or output.splitlines() or [""])[-1][:300]
