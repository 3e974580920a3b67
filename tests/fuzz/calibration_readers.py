"""Readers of calibrations, and of folders that have one but no scene yet."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import mutations
from reader import LINES, Reader
from scene_readers import write_video

if TYPE_CHECKING:
    from mmocap_warp.cameras.rig import CameraRig


def _write_toml_rig(folder: Path) -> None:
    from synthetic import ring_rig

    from mmocap_warp.formats.calibration.toml_rig import write_toml_rig

    write_toml_rig(folder / "calibration.toml", ring_rig(2))


def _write_qualisys(folder: Path) -> None:
    turn = " ".join(f'r{i}{j}="{float(i == j)}"' for i in (1, 2, 3) for j in (1, 2, 3))
    lens = 'focalLengthU="64000" focalLengthV="64000" centerPointU="20480" centerPointV="15360" skew="0"'
    bent = 'radialDistortion1="0" radialDistortion2="0" radialDistortion3="0" tangentalDistortion1="0"'
    cameras = "".join(
        f'<camera serial="{name}"><fov_video left="0" top="0" right="639" bottom="479"/>\n'
        f'<transform x="{x}" y="0" z="1000" {turn}/>\n<intrinsic {lens} {bent} tangentalDistortion2="0"/></camera>\n'
        for name, x in (("a", 0), ("b", 2000))
    )
    (folder / "some.qca.txt").write_text(
        f'<?xml version="1.0"?>\n<calibration>\n<cameras>{cameras}</cameras></calibration>'
    )


def _write_rig(folder: Path, name: str, fisheye: bool = True) -> None:
    """Two cameras, the second one a fisheye where the format has any."""
    import numpy as np
    from synthetic import ring_rig

    from mmocap_warp.formats.table import write_calibration

    rig = ring_rig(2)
    lens = np.array([[-0.1, 0.02, 0.001, 0.002, 0.003], [0.04, -0.01, 0.004, -0.001, 0.0]])
    bent = replace(rig, K=rig.K * [[0.5, 1, 1], [1, 0.5, 1], [1, 1, 1]], distortion=lens, fisheye=("cam02",))
    write_calibration(folder / name, bent if fisheye else rig)


def _write_opencv(folder: Path) -> None:
    _write_rig(folder, "intri.yml", fisheye=False)


def _write_colmap(folder: Path) -> None:
    from calibration_files import write_colmap_model
    from synthetic import ring_rig

    write_colmap_model(folder, ring_rig(2))


def _write_made(folder: Path, file: str, content: Callable[[CameraRig], str]) -> None:
    from synthetic import ring_rig

    (folder / file).write_text(content(ring_rig(3)))


def _caliscope(rig: CameraRig) -> str:
    from calibration_files import caliscope

    return caliscope(rig)


def _multical(rig: CameraRig) -> str:
    from calibration_files import multical

    return multical(rig)


def _write_cal_folder(folder: Path) -> None:
    from calibration_files import humaneva
    from synthetic import ring_rig

    rig = ring_rig(2)
    for k, name in enumerate(rig.names):
        (folder / f"{name}.cal").write_text(humaneva(rig, k))


def _write_plain_usd(folder: Path) -> None:
    """As another program's: without this one's attributes."""
    from pxr import Usd

    _write_rig(folder, "calibration.usda")
    stage = Usd.Stage.Open(str(folder / "calibration.usda"))
    for prim in stage.Traverse():
        for name in [name for name in prim.GetPropertyNames() if name.startswith("mmocap:")]:
            prim.RemoveProperty(name)
    stage.GetRootLayer().Export(str(folder / "calibration.usda"))


def _read_rig(folder: Path, name: str) -> None:
    from mmocap_warp.formats.table import read_calibration

    read_calibration(folder / name, "m", "+y", {"": (640, 480)}).undistorted()


def _known(name: str, file: str, write: Callable[[Path], object], damage: mutations.Mutation = LINES) -> Reader:
    """A calibration that is read by its file's name."""
    return Reader(name, file, write, partial(_read_rig, name=file), damage)


def _write_project(folder: Path, calibration: Callable[[Path], object]) -> None:
    """Videos and their calibration, as they are before there is a scene file."""
    from mmocap_warp.formats.table import read_calibration

    calibration(folder)
    found = next(file for file in sorted(folder.iterdir()) if file.name != "extri.yml")
    for name in read_calibration(found, "m", "+y", {"": (32, 24)}).names:
        write_video(folder, f"{name}.avi", "MJPG")


def _draft(folder: Path) -> None:
    """As ``mmocap init`` does: draft a scene, write it, and load it where nothing is missing."""
    import tomllib

    from mmocap_warp.scene.drafting import draft_scene
    from mmocap_warp.scene.scene_toml import load_scene

    draft = draft_scene(folder)
    tomllib.loads(draft.text)
    if not draft.missing:
        (folder / "scene.toml").write_bytes(draft.text.encode())
        load_scene(folder / "scene.toml", masks=False)


READERS: tuple[Reader, ...] = (
    _known("calibration.toml", "calibration.toml", _write_toml_rig),
    _known("fisheye.toml", "calibration.toml", partial(_write_rig, name="calibration.toml")),
    _known("caliscope.toml", "camera_array.toml", partial(_write_made, file="camera_array.toml", content=_caliscope)),
    _known("qualisys.qca.txt", "some.qca.txt", _write_qualisys),
    _known("opencv-intri.yml", "intri.yml", _write_opencv),
    _known("opencv-extri.yml", "extri.yml", _write_opencv),
    _known("colmap-cameras.txt", "cameras.txt", partial(_write_rig, name="cameras.txt")),
    _known("colmap-images.txt", "images.txt", _write_colmap),
    _known(
        "multical.json",
        "calibration.json",
        partial(_write_made, file="calibration.json", content=_multical),
        mutations.json_text,
    ),
    _known("humaneva-folder.cal", "cam02.cal", _write_cal_folder),
    _known("cameras.usda", "calibration.usda", partial(_write_rig, name="calibration.usda")),
    _known("cameras.usdc", "calibration.usdc", partial(_write_rig, name="calibration.usdc"), mutations.any_bytes),
    _known("other-cameras.usda", "calibration.usda", _write_plain_usd),
    *(
        Reader(f"draft-{file}", file, partial(_write_project, calibration=write), _draft, LINES)
        for file, write in (
            ("calibration.toml", _write_toml_rig),
            ("some.qca.txt", _write_qualisys),
            ("intri.yml", _write_opencv),
            ("cameras.txt", _write_colmap),
            ("calibration.json", partial(_write_made, file="calibration.json", content=_multical)),
        )
    ),
    Reader(
        "draft-cam01.avi",
        "cam01.avi",
        partial(_write_project, calibration=_write_toml_rig),
        _draft,
        mutations.any_bytes,
    ),
)
