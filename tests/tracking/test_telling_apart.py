"""Pixels that may be of several people are given to whoever's body explains them."""

from types import SimpleNamespace

import numpy as np
import pytest
from boxed_figure import FIGURE, rig_of, seen

from mmocap_warp.cli import main
from mmocap_warp.commands.inputs import truth_of
from mmocap_warp.errors import InputError
from mmocap_warp.formats.usd.usd_result import read_result
from mmocap_warp.masks.observation import unpack_masks
from mmocap_warp.result.evaluation import evaluate
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.synthesis.writing import write_made_scene
from mmocap_warp.tracking import telling_apart
from mmocap_warp.tracking.telling_apart import first_observations, told_apart, told_apart_in
from mmocap_warp.tracking.track_config import TrackConfig

VIEWS, UNTOLD = 5, 255
TABLES = """[foreground]
source = "masks"
keep = "all"
[labels]
several = {}
[people.anna]
label = 1
[people.ben]
label = 2
"""


def strip(first: int, last: int) -> np.ndarray:
    mask = np.zeros((8, 60), bool)
    mask[2:6, first:last] = True
    return mask


def test_an_area_without_labels_is_split_between_the_bodies():
    none, blob = strip(0, 0), strip(10, 50)
    anna, ben = told_apart_in([none, none], blob, [strip(11, 26), strip(34, 49)])
    np.testing.assert_array_equal(anna, strip(10, 30))
    np.testing.assert_array_equal(ben, strip(30, 50))


def test_where_two_bodies_are_nobody_is_told():
    none, blob = strip(0, 0), strip(10, 50)
    anna, ben = told_apart_in([none, none], blob, [strip(10, 35), strip(25, 50)])
    np.testing.assert_array_equal(anna, strip(10, 25))
    np.testing.assert_array_equal(ben, strip(35, 50))


def test_a_label_that_takes_another_body_in_is_split_and_others_stay():
    bodies, several = [strip(10, 32), strip(28, 50)], strip(10, 50)
    anna, ben = told_apart_in([several, strip(0, 0)], several, bodies)
    np.testing.assert_array_equal(anna, strip(10, 28))
    np.testing.assert_array_equal(ben, strip(32, 50))
    # Anna is in front of Ben, and both have their labels.
    labels = [strip(10, 32), strip(32, 50)]
    for made, label in zip(told_apart_in(labels, several, bodies), labels, strict=True):
        np.testing.assert_array_equal(made, label)
    # Ben is out of the picture: what Anna's body does not cover is hers.
    alone = told_apart_in([several, strip(0, 0)], several, [strip(12, 48), strip(0, 0)])
    np.testing.assert_array_equal(alone[0], several)


class Boxes:
    """Two figures that walk towards each other and are one blob, for a scene."""

    fps, rig = 30.0, rig_of(VIEWS)

    def __init__(self, places: list[tuple[float, float]], label: int) -> None:
        self.places, self.label = places, label

    def __len__(self) -> int:
        return len(self.places)

    def masks(self, frame: int) -> list[np.ndarray]:
        both = zip(*(seen(self.rig, FIGURE, place) for place in self.places[frame]), strict=True)
        return [np.uint8(self.label) * np.logical_or(*pair) for pair in both]


def made(folder, places, several=UNTOLD):
    tables = TABLES.format(several)
    boxes = Boxes(places, several)
    return load_scene(write_made_scene(folder, boxes, None, name="boxes", about="Boxes.", foreground=tables))


def test_who_stands_apart_is_told_before_any_pose_is_known(tmp_path):
    scene = made(tmp_path, [(-0.8, 0.8)])
    shown = [unpack_masks(each.words, scene.rig().size) for each in first_observations(scene, 1.0)]
    figures = [seen(scene.rig(), FIGURE, place) for place in (-0.8, 0.8)]
    common = np.array([[np.sum([a & b for a, b in zip(own, each, strict=True)]) for each in figures] for own in shown])
    who = common.argmax(axis=1)  # without labels either may be the first
    assert sorted(who) == [0, 1]
    assert (common.max(axis=1) > 0.5 * np.sum(figures) / 2).all()
    assert (common.min(axis=1) < 0.1 * common.max(axis=1)).all()


def test_who_is_one_blob_in_the_first_frame_is_refused(tmp_path):
    scene = made(tmp_path, [(-0.1, 0.1)])
    with pytest.raises(InputError, match="shows 1 of 2 people apart"):
        first_observations(scene, 1.0)


def test_blobs_are_split_by_where_everybody_was_in_the_frame_before(tmp_path, monkeypatch):
    """Stand-ins for bodies and trackers: a pose is a place along x, and each tracker is told where it goes next."""
    places = [(-0.4, 0.4), (-0.36, 0.36), (-0.32, 0.32)]
    scene, told = made(tmp_path, places), {0: [], 1: []}

    class Tracker:
        def __init__(self, subject, rig, config, fps):
            self.person, self.state = subject, SimpleNamespace(pose=places[0][subject])

        def step(self, observation):
            told[self.person].append(observation)
            self.state = SimpleNamespace(pose=places[len(told[self.person]) - 1][self.person])

    monkeypatch.setattr(telling_apart, "make_tracker", Tracker)
    monkeypatch.setattr(telling_apart, "body_silhouettes", lambda _, rig: lambda place: seen(rig, FIGURE, place))
    shared = undecided = 0
    for frame, (people, unsure) in enumerate(told_apart(scene, [0, 1], TrackConfig(device="cpu"))):
        figures = [seen(scene.rig(), FIGURE, place) for place in places[frame]]
        for k in range(VIEWS):
            both = figures[0][k] & figures[1][k]
            parts = [people[0][k], people[1][k], unsure[k]]
            np.testing.assert_array_equal(np.sum(parts, axis=0), figures[0][k] | figures[1][k])
            for n, own in enumerate((people[0][k], people[1][k])):
                wrong = own & ~figures[n][k]
                assert wrong.sum() < 0.12 * figures[n][k].sum()
            shared += both.sum()
            undecided += (unsure[k] & both).sum()
    assert undecided > 0.5 * shared > 0
    assert [len(each) for each in told.values()] == [3, 3]
    assert any(each.hidden is not None for each in told[0])


@pytest.mark.nightly
def test_two_who_are_one_blob_are_tracked(tmp_path, capsys):
    """In seven views, from subjects that are given; without labels that say so their error is above 30 mm."""
    folder = tmp_path / "two"
    flags = ["--sequence", "S1/Walking", "--sequence", "S2/Walking", "--together", "--frames", "12", "--blobs"]
    assert main(["study", "make", str(folder), *flags]) == 0
    main(["track", str(folder), "-o", str(folder / "result.usdc"), "--person", "all", "--device", "cpu"])
    assert "told apart by their poses" in capsys.readouterr().err
    assert (folder / "people" / "overlay.webm").exists()
    scene = load_scene(folder)
    for name in scene.people:
        result = read_result(folder / f"result.{name}.usdc")
        assert evaluate(result, truth_of(scene.of_person(name)))["mpjpe_mm"] < 30
