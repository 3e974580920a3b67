"""Does what a recipe of CONTRIBUTING.md says, in a copy of the tree."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

from recordings import write_recording

ROOT = Path(__file__).resolve().parents[1]
QUICK = "evaluations = 60\n"
"""A setting of the scene, so that a recipe's commands take seconds."""


def copy_tree(folder: Path) -> None:
    """Copy what the recipes change, and link what they only read; a scene of three frames lies beside it."""
    linked = ("kernels", "scenes")  # a checkout may hold links of these names in the package
    without = shutil.ignore_patterns("__pycache__", *linked)
    shutil.copytree(ROOT / "mmocap_warp", folder / "mmocap_warp", ignore=without)
    for name in ("kernels", "tests", "instruments"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", folder)
    for name in ("docs", "scenes"):
        (folder / name).symlink_to(ROOT / name)
    (folder / "mmocap_warp" / "kernels").symlink_to(folder / "kernels")
    (folder / "mmocap_warp" / "scenes").symlink_to(ROOT / "scenes")
    write_recording(folder, frames=3)
    with (folder / "scene.toml").open("a", encoding="utf-8") as scene:
        scene.write(QUICK)


class Recipe:
    """A recipe's blocks, and the root of the copied tree to which :meth:`apply` applies them."""

    def __init__(self, title: str, folder: Path) -> None:
        text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
        section = re.split(r"^##+ ", text.split(f"\n### {title}\n")[1], flags=re.M)[0]
        self._blocks = re.findall(r"^```(\w+)\n(.*?)^```$", section, re.M | re.S)
        self.folder = folder

    def apply(self) -> None:
        """Write the recipe's files into the copy, and make its changes there."""
        for language, block in self._blocks:
            if language != "console":
                apply(block, self.folder)

    def run_commands(self) -> list[str]:
        """Run the recipe's commands in the copy's root; what each of them prints."""
        console = "".join(block for language, block in self._blocks if language == "console")
        return [self.run(*line.split()) for line in re.findall(r"^\$ (.+)$", console, re.M)]

    def run(self, program: str, *arguments: str) -> str:
        """Run ``mmocap``, ``pytest`` or ``python`` on the copy; what it prints."""
        module = {"mmocap": ["-m", "mmocap_warp"], "pytest": ["-m", "pytest", "-n0"], "python": []}[program]
        folders = [self.folder, self.folder / "tests", self.folder / "instruments"]
        paths = [*map(str, folders), *filter(None, [os.environ.get("PYTHONPATH")])]
        answer = subprocess.run(
            [sys.executable, *module, *arguments],
            cwd=self.folder,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(paths)},
            capture_output=True,
            text=True,
        )
        assert answer.returncode == 0, answer.stdout + answer.stderr
        return answer.stdout


def apply(block: str, folder: Path) -> None:
    """Write the file that a block holds, or change the one that it changes."""
    first, rest = block.split("\n", 1)
    kind, name = first.split(" ", 1)
    file = folder / name
    if kind == "#":
        assert not file.exists(), f"{name} exists already"
        file.write_text(rest, encoding="utf-8")
        return
    lines = rest.splitlines(keepends=True)
    before = "".join(line[1:] for line in lines if line[0] in " -")
    after = "".join(line[1:] for line in lines if line[0] in " +")
    text = file.read_text(encoding="utf-8")
    assert text.count(before) == 1, f"{name} holds this {text.count(before)} times:\n{before}"
    file.write_text(text.replace(before, after), encoding="utf-8")
