"""A name of a camera or a sequence that would lead elsewhere is refused by every command, and nothing is written."""

from __future__ import annotations

import os
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from small_scene import make_scene
from synthetic import synthetic_result

from mmocap_warp import cli
from mmocap_warp.cli.console import BAD_INPUT, OK
from mmocap_warp.commands.outputs import new_file
from mmocap_warp.errors import InputError
from mmocap_warp.formats.motion.captured_points import read_c3d
from mmocap_warp.formats.toml_table import quoted
from mmocap_warp.formats.usd.usd_body import read_body
from mmocap_warp.formats.usd.usd_result import write_result
from mmocap_warp.masks.frames import open_frames
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.whole_file import file_name

HOSTILE = (
    "../../x", "..", ".", "", "/absolute/x", "a/b", "a\\b", "C:\\x", "C:x", "a\0b", "a\nb", "\x1b[2J", "a\u202eb",
    "a|b", "a?", "a*", 'a"b', "<a>", "NUL", "con.png", "com1", ".hidden", "end.", "end ", "\udce9",
    "n" * 201, "é" * 101,
)  # fmt: skip
ODD = ("cam 1", "cam.1", "[cam]", "caméra", "カメラ", "a'b", "#1", "x=1", "-rf", "$HOME", "n" * 200)
COMMANDS = {
    "mask": ("mask", "{scene}", "-o", "{out}"),
    "cameras": ("cameras", "{scene}", "-o", "{out}"),
    "track": ("track", "{scene}", "-o", "{out}.usdc"),
    "fit": ("fit", "{scene}", "-o", "{out}.usdc"),
    "sync": ("sync", "{scene}", "--write"),
    "calib check": ("calib", "check", "{scene}", "-o", "{out}"),
    "calib refine": ("calib", "refine", "{scene}", "-o", "{out}.toml"),
    "calib solve": ("calib", "solve", "{scene}", "-o", "{out}.toml", "--height", "1.8"),
    "calib convert": ("calib", "convert", "{folder}/calibration.toml", "-o", "{out}/cameras.txt"),
    "show": ("show", "{folder}/result.usdc", "-o", "{out}.webm"),
    "view": ("view", "{folder}/result.usdc", "-o", "{out}.html"),
    "export": ("export", "{folder}/result.usdc", "-o", "{out}.glb"),
    "measure": ("measure", "{folder}/result.usdc", "-o", "{out}"),
    "study run": ("study", "run", "{folder}/STUDY.toml", "-o", "{out}"),
}


def renamed(folder: Path, name: str) -> None:
    """Let the first camera, and a sequence of a study, have another name wherever it is said."""
    for file in ("scene.toml", "calibration.toml"):
        text = (folder / file).read_text().replace("[cameras.cam01]", f"[cameras.{quoted(name)}]")
        text = text.replace("[cam01]", f"[{quoted(name)}]").replace('"cam01"', quoted(name))
        (folder / file).write_text(text)
    grid = f"[[grid]]\nsequences = [{quoted(name)}]\nalgorithms = ['h-pso']\ndof = [31]\n"
    (folder / "STUDY.toml").write_text(f"[sequences]\n{quoted(name)} = 'scene.toml'\n{grid}")


def files(folder: Path) -> dict[Path, bytes]:
    """All files of a folder but locks, by their paths."""
    found = (path for path in folder.rglob("*") if path.is_file() and not path.name.endswith(".lock"))
    return {path: path.read_bytes() for path in found}


@pytest.fixture(scope="module")
def result():
    return synthetic_result(frames=2, runs=1)


@pytest.mark.parametrize("command", COMMANDS)
def test_no_command_takes_a_name_that_leads_elsewhere(tmp_path: Path, capsys, result, command: str) -> None:
    inner = tmp_path / "a" / "b"
    inner.mkdir(parents=True)
    make_scene(inner)
    kept = {file: (inner / file).read_text() for file in ("scene.toml", "calibration.toml")}
    (inner / "out").mkdir()
    of_results = any("result.usdc" in part for part in COMMANDS[command])
    for name in HOSTILE[:6] if of_results else HOSTILE:
        for file, text in kept.items():
            (inner / file).write_text(text)
        if name.isprintable():  # a TOML file has no zero byte and no surrogate
            renamed(inner, name)
        else:
            renamed(inner, name.encode("utf-8", "replace").decode().replace("?", "\x7f"))
        if of_results:
            rig = replace(result.cameras, names=(name, *result.cameras.names[1:]))
            write_result(inner / "result.usdc", replace(result, cameras=rig))
        before = files(tmp_path)
        places = {"scene": str(inner), "folder": str(inner), "out": str(inner / "out" / "o")}
        code = cli.main([part.format(**places) for part in COMMANDS[command]])
        said = capsys.readouterr().err.splitlines()
        assert code == BAD_INPUT, (name, said)
        assert "cannot be the name of a file" in said[-1]
        assert files(tmp_path) == before


@pytest.fixture
def quickly_judged(monkeypatch) -> None:
    """Of the masks that are written, those of one frame are compared."""
    monkeypatch.setattr("mmocap_warp.masks.mask_check._COMPARED_FRAMES", 1)


@pytest.mark.usefixtures("quickly_judged")
@pytest.mark.parametrize("name", ODD)
def test_odd_names_are_folders_of_that_name(tmp_path: Path, name: str) -> None:
    make_scene(tmp_path)
    renamed(tmp_path, name)
    assert cli.main(["mask", str(tmp_path), "-o", str(tmp_path / "out"), "--quiet"]) == OK
    assert len(list((tmp_path / "out" / name).glob("*.png"))) == 3
    assert cli.main(["cameras", str(tmp_path / "out"), "-o", str(tmp_path / "axes")]) == OK
    assert (tmp_path / "axes" / f"{name}.png").is_file()


@pytest.fixture
def not_utf8(tmp_path: Path) -> Path:
    """A folder, of a name that is not UTF-8, with the scene in it."""
    folder = Path(os.fsdecode(os.fsencode(tmp_path) + b"/caf\xe9"))
    try:
        folder.mkdir()
    except OSError:
        pytest.skip("the file system has UTF-8 names alone")
    (tmp_path / "scene").mkdir()
    make_scene(tmp_path / "scene")
    shutil.copytree(tmp_path / "scene", folder, dirs_exist_ok=True)
    return folder


@pytest.mark.usefixtures("quickly_judged")
def test_images_are_read_in_a_folder_whose_name_is_not_utf8(not_utf8: Path) -> None:
    assert len(list(load_scene(not_utf8).masks())) == 3
    assert cli.main(["cameras", str(not_utf8)]) == OK


def test_masks_of_such_a_folder_are_refused_before_the_work(not_utf8: Path, capsys) -> None:
    """Their scene.toml would have to name the folder, and TOML files are UTF-8."""
    before = files(not_utf8.parent)
    assert cli.main(["mask", str(not_utf8), "-o", str(not_utf8.parent / "masks")]) == BAD_INPUT
    line = capsys.readouterr().err.splitlines()[-1]
    assert r"caf\udce9" in line
    assert "has a name that is not UTF-8; rename the file or its folder" in line
    assert files(not_utf8.parent) == before


@pytest.mark.parametrize("command", ["mask", "cameras", "track", "fit", "show", "view", "export", "calib check"])
def test_such_an_output_is_refused_before_the_work(not_utf8: Path, capsys, result, command: str) -> None:
    """And so are videos and bodies that OpenCV and USD would have to find there."""
    plain = not_utf8.parent / "scene"
    write_result(plain / "result.usdc", result)
    before = files(not_utf8.parent)
    places = {"scene": str(plain), "folder": str(plain), "out": str(not_utf8 / "o")}
    assert cli.main([part.format(**places) for part in COMMANDS[command]]) == BAD_INPUT
    assert "has a name that is not UTF-8" in capsys.readouterr().err.splitlines()[-1]
    assert files(not_utf8.parent) == before


@pytest.mark.parametrize("suffix", [".mkv", ".usda", ".c3d"])
def test_what_native_libraries_would_read_there_is_refused(not_utf8: Path, suffix: str) -> None:
    (not_utf8 / f"a{suffix}").write_bytes(b"#usda 1.0")
    readers = {".mkv": open_frames, ".usda": read_body, ".c3d": read_c3d}
    with pytest.raises(InputError, match="not UTF-8"):
        readers[suffix](not_utf8 / f"a{suffix}")


def test_a_name_that_leaves_no_room_for_endings_is_refused_before_the_work(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="has a name of over 200 bytes"):
        new_file(tmp_path / f"{'n' * 240}.usdc", ".usdc")


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_name_is_no_files(name: str) -> None:
    with pytest.raises(InputError, match="cannot be the name of a file"):
        file_name(name, "here")
