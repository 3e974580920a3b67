"""The Blender extension without Blender; docs/interchange/blender_extension.py tries it in Blender."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
import tomllib
import types
from pathlib import Path
from zipfile import ZipFile

import pytest

import mmocap_warp

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture
def extension(monkeypatch):
    """The extension's module, with stand-ins for Blender's."""
    contents = {
        "bpy": {"types": types.SimpleNamespace(Operator=type("Operator", (), {}), Panel=object)},
        "bpy.props": {"StringProperty": dict},
        "bpy_extras": {},
        "bpy_extras.io_utils": {"ImportHelper": type("ImportHelper", (), {})},
    }
    for name, content in contents.items():
        stand_in = types.ModuleType(name)
        vars(stand_in).update(content)
        monkeypatch.setitem(sys.modules, name, stand_in)
    spec = importlib.util.spec_from_file_location("blender_extension", ROOT / "blender" / "__init__.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_archive_holds_manifest_code_and_licence(tmp_path):
    subprocess.run([sys.executable, ROOT / ".ci" / "blender", tmp_path], check=True, stdout=subprocess.DEVNULL)
    (archive,) = tmp_path.iterdir()
    with ZipFile(archive) as package:
        assert package.namelist() == ["blender_manifest.toml", "__init__.py", "LICENSE"]
        manifest = tomllib.loads(package.read("blender_manifest.toml").decode())
        assert "GNU GENERAL PUBLIC LICENSE" in package.read("LICENSE").decode()
    assert archive.name == f"{manifest['id']}-{mmocap_warp.__version__}.zip"
    assert manifest["license"] == ["SPDX:GPL-3.0-or-later"]
    assert max(map(len, (manifest["tagline"], *manifest["permissions"].values()))) <= 64  # Blender's bound
    assert not manifest["tagline"].endswith(".")


@pytest.mark.parametrize(
    ("file", "images_of_cam1"),
    [
        ("cam1.mp4", "cam1.mp4"),
        ("videos/cam1.MOV", "videos/cam1.MOV"),
        ("images/cam1/0000.png", "images/cam1/0000.png"),
        ("cam1/._0000.png", None),
        ("cam10.mp4", None),
        ("cam1.toml", None),
    ],
)
def test_images_are_found_by_the_cameras_name(extension, tmp_path, file, images_of_cam1):
    (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / file).touch()
    wanted = images_of_cam1 and tmp_path / images_of_cam1
    assert extension.find_images(tmp_path, "cam1") == wanted
