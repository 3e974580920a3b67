"""Whole scenes of which some files have odd names, kinds, sizes or encodings: nothing hangs, or is written elsewhere.

What is damaged is a list of changes; a sound scene is copied and changed as it says, read, and its masks are written.
"""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path
from random import Random

from reader import Reader

_FILES = ("scene.toml", "calibration.toml", "body.usda", "masks/cam01/0001.png", "masks/cam02/0000.png")
_FOLDERS = ("masks/cam01", "masks/cam03", "masks")
_NAMES = (
    "../../x",
    "..",
    "a/b",
    "/x",
    "C:x",
    "a\x00b",
    "\x1b[2J",
    "NUL",
    ".x",
    "x.",
    "",
    "é" * 150,
    "cam 1",
    "カ",
    "a'b",
)
_NEIGHBOURS = ("._0000.png", ".DS_Store", "Thumbs.db", "0000 (1).png", "caf\udce9.png", "n" * 240 + ".png", "x\n.png")
_CONTENTS = {"empty": b"", "zeros": bytes(4096), "text": b"hello\n", "deep": b"[" * 5000, "png": b"\x89PNG\r\n\x1a\n"}
_KINDS = ("device", "pipe", "folder", "dangling", "loop", "huge", "unreadable", "missing", "outside")
_MAX_BYTES = 1 << 24  # of a file that is changed again
_ENCODINGS = ("utf-8-sig", "utf-16", "utf-32", "latin-1")


def _damage(random: Random, _: bytes) -> bytes:
    """Changes to a scene: what is done, to which file, and how."""
    changes = []
    for _ in range(random.choice((1, 1, 1, 2, 3))):
        what = random.choice(("name", "neighbour", "content", "kind", "kind", "encoding", "cut", "resize"))
        choices = {"name": _NAMES, "neighbour": _NEIGHBOURS, "content": tuple(_CONTENTS), "kind": _KINDS}
        how = random.choice(choices.get(what, _ENCODINGS if what == "encoding" else (0.1, 0.5, 0.99, 2.0)))
        file = random.choice(_FILES + _FOLDERS if what == "kind" else _FOLDERS if what == "neighbour" else _FILES)
        changes.append((what, file, how))
    return json.dumps(changes).encode()


def _write(folder: Path) -> None:
    from small_scene import make_scene
    from synthetic import synthetic_body

    from mmocap_warp.formats.usd.usd_body import write_body

    (folder / "sound").mkdir()
    make_scene(folder / "sound")
    write_body(folder / "sound" / "body.usda", synthetic_body())
    text = (folder / "sound" / "scene.toml").read_text()
    (folder / "sound" / "scene.toml").write_text(text.replace("[scene]", '[scene]\nbody = "body.usda"'))
    (folder / "secret").write_text("of somebody else")
    (folder / "changes.json").write_text("[]")


def _read(folder: Path) -> None:
    from mmocap_warp.formats.usd.usd_body import read_body
    from mmocap_warp.scene.mask_writing import write_masks
    from mmocap_warp.scene.scene_toml import load_scene

    inner = folder / "deep" / "deeper"
    shutil.rmtree(folder / "deep", ignore_errors=True)
    shutil.copytree(folder / "sound", inner / "scene")
    for what, file, how in json.loads((folder / "changes.json").read_bytes()):
        _change(inner / "scene", what, inner / "scene" / file, how)
    before = _others(folder, inner)
    try:
        (inner / "out").mkdir()
        scene = load_scene(inner / "scene")
        read_body(scene.body)
        write_masks(scene, inner / "out")
    finally:
        after = _others(folder, inner)
        assert after == before, f"wrote {set(after.items()) ^ set(before.items())}"


def _others(folder: Path, inner: Path) -> dict[str, bytes]:
    """What is outside the output: its files, and what is in those that are small."""
    found = {}
    for place, _, names in os.walk(folder):
        if not Path(place).is_relative_to(inner / "out"):
            paths = [Path(place, name) for name in names]
            found |= {str(path): path.lstat().st_mtime_ns for path in paths}
    return found


def _change(scene: Path, what: str, file: Path, how: object) -> None:
    """Do one change; where an earlier one has taken the file away there is nothing to do."""
    from mmocap_warp.formats.toml_table import quoted

    if what == "neighbour":
        if file.is_dir():
            (file / str(how)).write_bytes(b"\0\5\26\7")
    elif what == "kind":
        _replace(file, str(how))
    elif not file.is_file() or not os.access(file, os.R_OK) or file.stat().st_size > _MAX_BYTES:
        return
    elif what == "name":
        for each in (scene / "scene.toml", scene / "calibration.toml"):
            if each.is_file() and each.stat().st_size < _MAX_BYTES:
                text = each.read_bytes().decode(errors="replace").replace("[cameras.cam01]", f"[cameras.{quoted(how)}]")
                text = text.replace('["cam01"]', f"[{quoted(how)}]").replace('"cam01"', quoted(how))
                each.write_bytes(text.encode())
    elif what == "content":
        file.write_bytes(_CONTENTS[str(how)])
    elif what == "encoding":
        file.write_bytes(file.read_bytes().decode("latin-1").encode(str(how)))
    else:
        data, share = file.read_bytes(), float(how)
        file.write_bytes(data[: int(len(data) * share)] if share < 1 else data + data)


def _replace(file: Path, kind: str) -> None:
    """Put something of another kind in the place of a file or folder."""
    if not file.parent.is_dir():
        return
    if kind == "unreadable":
        file.chmod(0) if file.exists() else None
        return
    if file.is_symlink() or file.is_file():
        file.unlink()
    elif file.exists():
        file.rename(file.with_name("was")) if not file.with_name("was").exists() else shutil.rmtree(file)
    if kind == "pipe":
        os.mkfifo(file)
    elif kind == "folder":
        file.mkdir()
    elif kind == "huge":
        file.touch()
        os.truncate(file, 1 << 40)  # without a byte on the disk
    elif kind != "missing":
        targets = {"device": "/dev/zero", "dangling": "nowhere", "loop": file.name, "outside": "../../../../secret"}
        file.symlink_to(targets[kind])


READERS: tuple[Reader, ...] = (Reader("tree", "changes.json", _write, _read, _damage),)
