"""Characters by way of Blender: a program in its place says what it is given, writes a prepared file, fails, hangs."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from made_up_rigs import write_creature

from mmocap_warp import cli
from mmocap_warp.cli import console
from mmocap_warp.errors import InputError
from mmocap_warp.formats.rigged import by_blender
from mmocap_warp.formats.rigged.gltf import read_gltf
from mmocap_warp.formats.usd.usd_body import read_body, read_motions

pytestmark = pytest.mark.skipif(os.name == "nt", reason="the program in Blender's place is a script of a shell")

CHECKED = f"""
test "$1 $2 $3 $4 $5" = "--background --factory-startup --python-exit-code 1 --python-expr" || exit 7
test "$7" = -- -a $# = 9 || exit 7
"{sys.executable}" -c 'import ast, sys; ast.parse(sys.argv[1])' "$6" || exit 7
cp "$(dirname "$8")/made.glb" "$9"
"""
"""Checks its arguments and writes a prepared file."""


@pytest.fixture
def character(tmp_path: Path) -> Path:
    write_creature(tmp_path / "made.glb")
    (tmp_path / "creature.fbx").write_bytes(b"Kaydara FBX Binary")
    return tmp_path / "creature.fbx"


def program(folder: Path, script: str) -> str:
    path = folder / "blender"
    path.write_text(f"#!/bin/sh\n{script}")
    path.chmod(0o755)
    return str(path)


def test_what_blender_writes_is_read(character: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    blender = program(character.parent, CHECKED)
    read, same = by_blender.read_fbx(character, None, blender), read_gltf(character.with_name("made.glb"))
    assert read.joints == same.joints
    np.testing.assert_array_equal(read.vertex, same.vertex)
    np.testing.assert_array_equal(read.motions["Nod"].world, same.motions["Nod"].world)
    # As a command, from another folder, with the program found on the PATH.
    monkeypatch.setenv("PATH", f"{character.parent}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.chdir(character.parent)
    assert cli.main(["body", "import", character.name, "-o", "creature.usdc", "--quiet"]) == console.OK
    assert read_body(character.with_suffix(".usdc")).name == "creature"
    assert list(read_motions(character.with_suffix(".usdc"))) == ["Nod"]


@pytest.mark.parametrize(
    ("script", "said"),
    [
        ("echo Blender quit; echo '  RuntimeError: no FBX' >&2; exit 1", "which says: RuntimeError: no FBX;"),
        ("exit 11", "which says: nothing;"),
        ("exit 0", "which wrote nothing;"),
        ("kill -9 $$", "which says: nothing;"),
        ("sleep 60 & echo $! > child; wait", "which takes more than 0 s;"),
        ('echo no >"$9"', "as Blender reads it, .*; "),
    ],
)
def test_a_blender_that_fails_is_told_in_one_line(
    character: Path, monkeypatch: pytest.MonkeyPatch, script: str, said: str
) -> None:
    monkeypatch.chdir(character.parent)
    monkeypatch.setattr(by_blender, "_SECONDS", 0.4 if "wait" in script else 60.0)
    with pytest.raises(InputError, match=f"creature.fbx: .*{said}"):
        by_blender.read_fbx(character, None, program(character.parent, script))
    if "wait" in script:  # and what it has started is ended with it
        state = Path(f"/proc/{Path('child').read_text().strip()}/stat")
        patience = time.monotonic() + 5.0  # what was killed may still be about to die
        while (alive := state.exists() and state.read_text().split()[2] != "Z") and time.monotonic() < patience:
            time.sleep(0.01)
        assert not alive


@pytest.mark.parametrize("known", [["filepath", "export_materials"], ["filepath"]])
def test_an_old_blender_gets_the_options_that_it_knows_and_says_why_it_fails(
    known: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    given: dict[str, object] = {}
    properties = SimpleNamespace(properties=dict.fromkeys(known))

    class Export:
        def get_rna_type(self) -> SimpleNamespace:
            return properties

        def __call__(self, **options: object) -> None:
            given.update(options)

    def read(filepath: str) -> None:
        if filepath == "bad.fbx":
            raise RuntimeError("Error: Python: Traceback\nTypeError: no version\n\nLocation: ops.py:113\n")

    operators = SimpleNamespace(
        wm=SimpleNamespace(read_factory_settings=lambda use_empty: None),
        import_scene=SimpleNamespace(fbx=read),
        export_scene=SimpleNamespace(gltf=Export()),
    )
    monkeypatch.setitem(sys.modules, "bpy", SimpleNamespace(ops=operators))
    monkeypatch.setattr(sys, "argv", ["blender", "--", "good.fbx", "made.glb"])
    exec(by_blender._SCRIPT, {})
    assert given == {"filepath": "made.glb"} | ({"export_materials": "NONE"} if "export_materials" in known else {})
    monkeypatch.setattr(sys, "argv", ["blender", "--", "bad.fbx", "made.glb"])
    with pytest.raises(SystemExit, match=r"^TypeError: no version$"):
        exec(by_blender._SCRIPT, {})


def test_without_blender_the_remedies_are_named(character: Path, capsys: pytest.CaptureFixture[str]) -> None:
    absent, output = str(character.with_name("no-blender")), str(character.with_suffix(".usdc"))
    command = ["body", "import", str(character), "-o", output, "--blender", absent]
    assert cli.main(command) == console.BAD_INPUT
    said = capsys.readouterr().err
    assert f"there is no program '{absent}'" in said
    assert "install Blender, name its program with --blender, or save the file as .glb" in said
    broken = character.with_name("blender")
    broken.write_bytes(b"\x7fELF")
    broken.chmod(0o755)
    with pytest.raises(InputError, match="cannot be started"):
        by_blender.read_fbx(character, None, str(broken))
