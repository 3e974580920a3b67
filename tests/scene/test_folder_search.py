"""Which videos are of which camera, and which of one take, by their names and their folders'."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ball_scene import RIG
from drafted import lay_out, project, sources, videos

from mmocap_warp.formats.calibration.toml_rig import write_toml_rig
from mmocap_warp.scene.drafting import draft_scene
from mmocap_warp.scene.folder_search import Medium, takes

__all__ = ["project", "videos"]


def test_a_number_that_is_a_cameras_name_may_be_in_a_folders_name(videos: Path, project: Path) -> None:
    write_toml_rig(project / "calibration.toml", replace(RIG, names=("1", "2", "3")))
    lay_out(videos, project, "take_1/cam_{}.mkv", cam01="1", cam02="2", cam03="3")
    assert sources(project) == {name: f"take_1/cam_{name}.mkv" for name in "123"}


def test_a_running_number_beside_each_cameras_name_is_no_take(videos: Path, project: Path) -> None:
    serials = ("21001", "21002", "21003")
    write_toml_rig(project / "calibration.toml", replace(RIG, names=serials))
    names = {name: f"{k}_{serial}" for k, (name, serial) in enumerate(zip(RIG.names, serials, strict=True), 1)}
    lay_out(videos, project, "Walk01_Miqus_{}.mkv", **names)
    assert sources(project) == {s: f"Walk01_Miqus_{k}_{s}.mkv" for k, s in enumerate(serials, 1)}


def test_cameras_of_two_takes_are_not_joined() -> None:
    media = [Medium(Path(f"take{k}/cam{k}.mp4"), (f"take{k}", f"cam{k}"), "recording") for k in (1, 2)]
    assert [len(take) for take in takes(media, "recording", ("cam1", "cam2")).values()] == [1, 1]


def test_folders_that_are_links_are_looked_through(videos: Path, project: Path) -> None:
    write_toml_rig(project / "calibration.toml", RIG)
    (project / "videos").symlink_to(videos)
    (videos / "again").symlink_to(project)  # a loop
    assert draft_scene(project).cameras == RIG.names
