"""A checkpoint is continued by the run that it is of, and by no other: whatever differs, it is refused and told."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Callable
from copy import copy
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from walk_scene import walking

from mmocap_warp.body.model import BodyModel, SkinMesh, Subject
from mmocap_warp.body.skeleton import Skeleton
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.errors import InputError
from mmocap_warp.masks.frames import ImageFolder
from mmocap_warp.masks.mask_settings import ForegroundSettings
from mmocap_warp.scene.recording import Scene
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.scenes import ROOT
from mmocap_warp.tracking.checkpoint import read_checkpoint, run_identity, with_code_of
from mmocap_warp.tracking.frame_loop import track
from mmocap_warp.tracking.track_config import TrackConfig
from mmocap_warp.tracking.tracker import Tracker
from mmocap_warp.version import __version__

FRAMES = 3
CONFIG = TrackConfig("h-cmaes", scale=0.25, evaluations=20, device="cpu")
OTHERS = {
    "algorithm": "cmaes",
    "dof": 28,
    "preset": "paper",
    "cost": "iou",
    "device": "cuda:7",
    "up": "+y",
    "model": "knn",
    "keep": "nearest",
}
"""Another value, where not just any will do."""

Run = tuple[Scene, Subject, TrackConfig]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The first frames of the built-in walk in a folder of their own."""
    folder = tmp_path_factory.mktemp("identity") / "walk"
    shutil.copytree(ROOT / "walk", folder)
    made = walking()
    subject = Subject(made.body, made.root_base, made.poses[0], {})
    return replace(load_scene(folder), frame_count=FRAMES), subject, CONFIG


@pytest.fixture(scope="module")
def left(run: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The checkpoint of that run, stopped amid its last frame."""
    path, steps, step = tmp_path_factory.mktemp("left") / "checkpoint", iter(range(FRAMES)), Tracker.step

    def stopping(self, seen):
        if next(steps) == FRAMES - 1:
            raise KeyboardInterrupt
        return step(self, seen)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(Tracker, "step", stopping)
        with pytest.raises(KeyboardInterrupt):
            track(*run, checkpoint=path)
    return path


def other(thing: Any, name: str) -> Any:
    """The same dataclass with another value in a field."""
    value = getattr(thing, name)
    if name in OTHERS:
        value = OTHERS[name]
    elif isinstance(value, np.ndarray):
        value = value.copy() if value.size else np.zeros((1, *value.shape[1:]), value.dtype)
        value.flat[0] = value.flat[0] + 1 if value.dtype.kind in "iu" else value.flat[0] == 0  # some are infinite
    elif isinstance(value, tuple):
        value = value[::-1] if value[::-1] != value else (*value, "another")
    elif isinstance(value, dict):
        value = dict(list(value.items())[:-1])
    elif isinstance(value, str):
        value = "another"
    elif isinstance(value, bool):
        value = not value
    else:
        value = 0.3 if value is None else value / 2 if isinstance(value, float) and value else value + 1
    changed = copy(thing)
    object.__setattr__(changed, name, value)  # past the checks: what differs is refused before it is used
    return changed


def of_scene(change: Callable[[Scene], Scene]) -> Callable[[Run], Run]:
    return lambda run: (change(run[0]), *run[1:])


def of_subject(change: Callable[[Subject], Subject]) -> Callable[[Run], Run]:
    return lambda run: (run[0], change(run[1]), run[2])


def of_second_camera(name: str) -> Callable[[Run], Run]:
    def change(scene: Scene) -> Scene:
        first, second, *rest = scene.cameras
        return replace(scene, cameras=(first, other(second, name), *rest))

    return of_scene(change)


def of_part(part: str, name: str) -> Callable[[Run], Run]:
    return of_scene(lambda scene: replace(scene, **{part: other(getattr(scene, part), name)}))


def of_body(name: str) -> Callable[[Run], Run]:
    return of_subject(lambda subject: replace(subject, body=other(subject.body, name)))


def of_body_part(part: str, name: str) -> Callable[[Run], Run]:
    return of_subject(
        lambda subject: replace(subject, body=replace(subject.body, **{part: other(getattr(subject.body, part), name)}))
    )


def of_config(name: str) -> Callable[[Run], Run]:
    return lambda run: (*run[:2], other(run[2], name))


def swapped_images(scene: Scene) -> Scene:
    """The same files in another order."""
    first, *rest = scene.cameras
    masks = ImageFolder(first.masks.path, first.masks.files[1::-1] + first.masks.files[2:], first.masks.size)
    return replace(scene, cameras=(replace(first, masks=masks), *rest))


def subtracted(scene: Scene) -> Scene:
    """Masks made by subtraction, as if the masks were a recording."""
    cameras = tuple(replace(camera, video=camera.masks, background=camera.masks) for camera in scene.cameras)
    return replace(scene, cameras=cameras, foreground=replace(scene.foreground, source="background_video"))


def names(kind: type, *without: str) -> list[str]:
    return [field.name for field in fields(kind) if field.name not in without]


CHANGES: list[tuple[str, Callable[[Run], Run]]] = [
    ("images", of_scene(swapped_images)),
    ("foreground.source", of_scene(subtracted)),
    ("frames", of_scene(lambda scene: other(scene, "frame_count"))),
    ("frames", of_scene(lambda scene: other(scene, "stride"))),
    ("fps", of_scene(lambda scene: other(scene, "fps"))),
    ("frame offsets", of_second_camera("frame_offset")),
    ("frame offsets", of_second_camera("rate")),
    ("cameras", of_second_camera("recorded_scale")),
    ("cameras", of_second_camera("recorded_offset")),
    *(("cameras", of_part("calibrated", name)) for name in names(CameraRig)),
    *((f"foreground.{name}", of_part("foreground", name)) for name in names(ForegroundSettings, "source")),
    # No pose depends on the joint sets that a body carries.
    *(("body", of_body(name)) for name in names(BodyModel, "skin", "skeleton", "joint_sets")),
    *(("body", of_body_part("skin", name)) for name in names(SkinMesh)),
    *(("body", of_body_part("skeleton", name)) for name in names(Skeleton)),
    ("first pose", of_subject(lambda subject: other(subject, "root_base"))),
    ("first pose", of_subject(lambda subject: other(subject, "pose"))),
    *((name, of_config(name)) for name in names(TrackConfig, "threads", "renderer", "cameras")),
]


@pytest.mark.parametrize(("told", "change"), CHANGES, ids=[f"{i}-{told}" for i, (told, _) in enumerate(CHANGES)])
def test_another_run_is_refused_and_it_is_told_what_differs(told, change, run, left, monkeypatch):
    for module in ("checkpoint", "make_tracker", "pose_search", "frame_loop"):
        monkeypatch.setattr(f"mmocap_warp.tracking.{module}.resolve_device", lambda device: device)
    refusal = rf"is of a run that differs in its .*\b{re.escape(told)}\b.*; repeat that"
    with pytest.raises(InputError, match=refusal) as caught:
        track(*change(run), checkpoint=left, resume=True)
    assert "\n" not in str(caught.value)


def test_another_version_s_run_is_refused(run, left, monkeypatch):
    monkeypatch.setattr("mmocap_warp.tracking.checkpoint.__version__", "0.0.0")
    with pytest.raises(InputError, match=rf"begun by mmocap-warp {__version__} \(code \w{{8}}\), this is 0\.0\.0 \("):
        track(*run, checkpoint=left, resume=True)


def test_a_run_of_other_code_is_refused_and_both_are_named(run, left, monkeypatch):
    monkeypatch.setattr("mmocap_warp.tracking.checkpoint.code_hash", lambda _: "0123456789abcdef")
    with pytest.raises(InputError, match=r"this is .* \(code 01234567\), .*; go back .* --accept-changed-code, or"):
        track(*run, checkpoint=left, resume=True)


def test_a_run_of_other_code_goes_on_where_that_is_accepted(run, left, tmp_path, monkeypatch):
    resumed = tmp_path / "checkpoint"
    shutil.copy(left, resumed)
    monkeypatch.setattr("mmocap_warp.tracking.checkpoint.code_hash", lambda _: "0123456789abcdef")
    result = track(*run, checkpoint=resumed, resume=True, accept_changed_code=True)
    np.testing.assert_array_equal(result.pose, track(*run).pose)


def test_accepted_code_leaves_other_differences_to_be_refused(run, left, monkeypatch):
    mine = run_identity(*run)
    monkeypatch.setattr("mmocap_warp.tracking.checkpoint.code_hash", lambda _: "changed")
    accepted = with_code_of(left, run_identity(*run))
    assert accepted == mine
    read_checkpoint(left, accepted)
    with pytest.raises(InputError, match="differs in its fps;"):
        read_checkpoint(left, with_code_of(left, accepted | {"fps": 1.0}))


def test_an_image_of_other_content_is_noticed_and_a_touched_one_is_not(run, left, tmp_path):
    resumed = tmp_path / "checkpoint"
    shutil.copy(left, resumed)
    image = run[0].cameras[1].masks.files[2]
    content, told = image.read_bytes(), image.stat()
    image.write_bytes(content[:-20] + bytes(1) + content[-19:])
    os.utime(image, ns=(told.st_atime_ns, told.st_mtime_ns))  # as large and as old as before
    with pytest.raises(InputError, match="differs in its images;"):
        track(*run, checkpoint=resumed, resume=True)
    image.write_bytes(content)
    os.utime(image, (0, 0))
    assert len(track(*run, checkpoint=resumed, resume=True).frame_numbers) == FRAMES


@pytest.mark.parametrize("same_bits", [{"threads": 1}, {"renderer": "raster"}])
def test_what_gives_the_same_bits_may_change(same_bits, run, left, tmp_path):
    resumed = tmp_path / "checkpoint"
    shutil.copy(left, resumed)
    scene, subject, config = run
    result = track(scene, subject, replace(config, **same_bits), checkpoint=resumed, resume=True)
    assert len(result.frame_numbers) == FRAMES


def test_a_background_s_images_count_too(run, tmp_path):
    scene, subject, config = run
    scene = subtracted(scene)
    fewer = []
    for camera in scene.cameras:
        background = ImageFolder(camera.masks.path, camera.masks.files[:9], camera.masks.size)
        fewer.append(replace(camera, background=background))
    mine, theirs = (run_identity(one, subject, config) for one in (scene, replace(scene, cameras=tuple(fewer))))
    assert [name for name in mine if mine[name] != theirs[name]] == ["images"]


def test_an_image_that_cannot_be_read_is_wrong_input(run, left):
    scene, subject, config = run
    gone = replace(scene.cameras[0], masks=ImageFolder(Path("gone"), (Path("gone/0.png"),), (1, 1)))
    with pytest.raises(InputError, match="cannot be read"):
        track(replace(scene, cameras=(gone,)), subject, config, checkpoint=left, resume=True)
