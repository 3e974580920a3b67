"""Holes that open in masks from one frame to the next."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from recordings import write_recording

from mmocap_warp.fitting.clip_body import follow
from mmocap_warp.formats.usd.usd_body import read_subject
from mmocap_warp.masks.observation import Observation, unpack_masks
from mmocap_warp.result.result import STATUS
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.tracking import mending
from mmocap_warp.tracking.contour_tracker import ContourTracker
from mmocap_warp.tracking.frame_loop import track
from mmocap_warp.tracking.holes import HOLE_SECONDS, with_holes
from mmocap_warp.tracking.live import track_live
from mmocap_warp.tracking.track_config import TrackConfig

RATE = 60.0
SIZE = np.array([[200, 240], [200, 240]])


def person(shift: int = 0) -> np.ndarray:
    """(240, 200) bool: a head, a trunk with an arm beside it, and legs."""
    mask = np.zeros((240, 200), bool)
    mask[20:45, 85 + shift : 105 + shift] = True
    mask[45:130, 70 + shift : 120 + shift] = True
    mask[60:66, 120 + shift : 150 + shift] = True
    mask[130:220, 75 + shift : 92 + shift] = mask[130:220, 98 + shift : 115 + shift] = True
    return mask


def without_trunk(shift: int = 0) -> np.ndarray:
    mask = person(shift)
    mask[50:125, 60:160] = False
    return mask


def seen(views: Iterable[np.ndarray], hidden: list[np.ndarray] | None = None) -> Observation:
    return Observation.from_masks(list(views), None, hidden)


def followed(frames: list[np.ndarray], leaves: bool = False, rate: float = RATE) -> Iterator[Observation]:
    """The first view shows the frames' masks, the second the person; the body is there, or leaves after two frames."""
    gone = np.roll(person(), 100, axis=1)
    masks = (seen([mask, person()]) for mask in frames)
    return with_holes(masks, rate, lambda place: [gone if leaves and place >= 2 else person()] * 2)


def hidden(observation: Observation) -> np.ndarray:
    """(240, 200) bool, of the first view."""
    assert observation.hidden is not None
    first, second = unpack_masks(observation.hidden, SIZE)
    assert not second.any()
    return first


def test_a_trunk_that_vanishes_is_hidden_and_so_is_an_arm_beside_it() -> None:
    before, at, after = followed([person(), without_trunk(), person()])
    assert before.hidden is None
    assert before.holed is None
    assert hidden(at)[52:123, 72:118].all()
    assert hidden(at)[60:66, 120:140].all()
    assert not (hidden(at) & without_trunk()).any()  # the head and the legs are shown
    assert at.holed is not None
    assert at.holed.tolist() == [True, False]
    assert after.hidden is None  # it is back


def test_masks_themselves_keep_their_bits() -> None:
    frames = [person(), without_trunk(), person()]
    for given, got in zip(frames, followed(frames), strict=True):
        np.testing.assert_array_equal(unpack_masks(got.words, SIZE)[0], given)


def test_where_a_mask_shows_up_no_hole_is() -> None:
    arm = without_trunk()
    arm[80:86, 125:160] = True
    *_, after = followed([person(), without_trunk(), arm])
    assert not hidden(after)[:, 126:].any()
    assert hidden(after)[52:123, 72:118].all()


def test_a_hole_that_the_body_has_left_is_closed() -> None:
    observations = followed([person(), without_trunk(), without_trunk()], leaves=True)
    assert [each.hidden is None for each in observations] == [True, False, True]


def holed(share: float) -> np.ndarray:
    """(240, 200) bool: the person without a disc in the trunk, which takes less than such a share of it."""
    mask = person()
    cv2.circle(disc := np.zeros(mask.shape, np.uint8), (95, 85), 19, 1, -1)
    mask[disc > 0] = False
    assert person().sum() - mask.sum() < share * person().sum()
    return mask


@pytest.mark.parametrize("mask", [holed(0.25), without_trunk()])
def test_a_hole_that_is_small_or_in_too_many_views_is_followed_for_a_second_where_it_opened(mask) -> None:
    assert sum(each.hidden is not None for each in followed([person()] + [mask] * int(1.5 * RATE))) == RATE


def legless(shift: int = 0) -> np.ndarray:
    mask = person(shift)
    mask[140:] = False
    return mask


@pytest.mark.parametrize("lost", [legless, without_trunk])
def test_a_large_hole_goes_with_the_body_where_two_other_views_show_it(lost) -> None:
    """Legs are thin, and are hidden as a trunk is."""
    walks = [0, 0, *range(2, 60, 2), 58]
    frames = [lost(shift) if 0 < place < len(walks) - 1 else person(shift) for place, shift in enumerate(walks)]
    masks = (seen([frame, person(shift), person(shift)]) for frame, shift in zip(frames, walks, strict=True))
    before, *observations, after = with_holes(masks, RATE, lambda place: [person(walks[place - 1])] * 3)
    for shift, observation in zip(walks[1:-1], observations, strict=True):
        missing = person(shift) & ~lost(shift)
        assert observation.holed.tolist() == [True, False, False]
        assert (unpack_masks(observation.hidden, SIZE[:1])[0] & missing).sum() > 0.9 * missing.sum()
    assert before.hidden is None
    assert after.hidden is None


def test_a_large_hole_is_followed_for_ten_seconds_at_most() -> None:
    frames = [person()] + [legless()] * int((HOLE_SECONDS + 1) * RATE)
    masks = (seen([frame, person(), person()]) for frame in frames)
    assert sum(each.hidden is not None for each in with_holes(masks, RATE, lambda _: [person()] * 3)) == 10 * RATE


@pytest.mark.parametrize("rate", [60.0, 15.0])
def test_motion_opens_no_hole(rate: float) -> None:
    step = round(120 / rate)  # a person's width a third of a second
    assert all(each.hidden is None for each in followed([person(step * i) for i in range(8)], rate=rate))


def test_a_limb_that_is_gone_and_a_mask_that_is_lost_open_no_hole() -> None:
    armless, nothing = person(), np.zeros((240, 200), bool)
    armless[:, 120:] = False
    assert all(each.hidden is None for each in followed([person(), armless, nothing, person()]))


def test_a_body_is_not_drawn_where_nothing_that_vanished_is_as_wide_as_a_trunk() -> None:
    """Ragged masks lose much, but nowhere much at once: to draw a body takes longer than all else."""
    ragged = person()
    ragged[45:130:3] = False
    asked = []
    masks = (seen([mask, person()]) for mask in (person(), ragged, person(), without_trunk()))
    _, thin, *_ = with_holes(masks, RATE, lambda place: asked.append(place) or [person()] * 2)
    assert (thin.hidden, asked) == (None, [3])


def test_somebody_else_who_is_gone_opens_no_hole() -> None:
    both = person() | np.roll(person(), -70, axis=1)
    assert all(each.hidden is None for each in followed([both, person()]))


def test_what_hides_the_person_already_stays_hidden() -> None:
    thing = np.zeros((240, 200), bool)
    thing[150:200, 60:90] = True
    stream = (seen([mask, person()], [thing & ~mask, np.zeros_like(thing)]) for mask in (person(), without_trunk()))
    *_, at = with_holes(stream, RATE, lambda _: [person()] * 2)
    assert hidden(at)[150:200, 60:70].all()
    assert hidden(at)[52:123, 72:118].all()


@pytest.fixture(scope="module")
def holed_scene(tmp_path_factory) -> Path:
    """A figure before three cameras, whose trunk is missing in all of them from the fourth to the eighth frame."""
    folder = tmp_path_factory.mktemp("holes") / "made"
    write_recording(folder, 12)
    for file in sorted(folder.glob("masks/*/*.png")):
        if 3 <= int(file.stem) < 8:
            mask = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
            x, y, width, height = cv2.boundingRect(mask)
            mask[y + height // 4 : y + 3 * height // 4, x : x + width] = 0
            file.unlink()
            cv2.imwrite(str(file), mask)
    return folder / "scene.toml"


CONFIG = TrackConfig("contour", scale=0.5, device="cpu", threads=1)


def test_a_run_that_stops_at_an_open_hole_is_resumed_with_the_same_bits(holed_scene, tmp_path, monkeypatch):
    scene, subject = load_scene(holed_scene), read_subject(holed_scene.with_name("subject.usdc"))
    step, hidden_in = ContourTracker.step, []

    def stopping(self, seen):
        hidden_in.append(seen.hidden is not None)
        if len(hidden_in) == 12 + 6:
            raise KeyboardInterrupt
        return step(self, seen)

    monkeypatch.setattr(ContourTracker, "step", stopping)
    whole = track(scene, subject, CONFIG)
    with pytest.raises(KeyboardInterrupt):
        track(scene, subject, CONFIG, checkpoint=tmp_path / "made.checkpoint")
    resumed = track(scene, subject, CONFIG, checkpoint=tmp_path / "made.checkpoint", resume=True)
    assert all(hidden_in[3:8])
    assert not any([*hidden_in[:3], *hidden_in[9:12]])
    assert hidden_in[18:] == hidden_in[5:12]
    for field in ("pose", "raw_pose", "cost", "status", "joint_sigma"):
        np.testing.assert_array_equal(getattr(resumed, field), getattr(whole, field))


def test_mending_sees_the_holes_that_the_track_saw(holed_scene):
    scene = load_scene(holed_scene)
    result = track(scene, read_subject(holed_scene.with_name("subject.usdc")), CONFIG)
    seen = mending._observations(scene, result, 5, 10)
    assert [each.hidden is not None for each in seen] == [True, True, True, False, False]
    assert seen[0].holed.all()


def test_holes_are_followed_in_the_clip_that_a_body_is_fitted_to_and_live(holed_scene, monkeypatch):
    scene, subject = load_scene(holed_scene), read_subject(holed_scene.with_name("subject.usdc"))
    step, hidden_in = ContourTracker.step, []

    def watched(self, seen):
        hidden_in.append(seen.hidden is not None)
        return step(self, seen)

    monkeypatch.setattr(ContourTracker, "step", watched)
    rig = scene.rig(CONFIG.scale)
    found = follow(subject, rig, list(scene.observations(CONFIG.scale)), scene.rate, CONFIG)
    assert hidden_in[:5] == [False, False, False, True, True]
    assert [seen.hidden is not None for seen in found.observation] == hidden_in[:4]  # the fifth is lost
    hidden_in.clear()
    list(track_live(subject, rig, scene.masks(CONFIG.scale), scene.rate, CONFIG))
    assert all(hidden_in[3:8])
    assert not any([*hidden_in[:3], *hidden_in[9:12]])


def test_frames_with_holes_in_all_views_say_which_limbs_they_hide(holed_scene):
    result = track(load_scene(holed_scene), read_subject(holed_scene.with_name("subject.usdc")), CONFIG)
    (partial,) = np.nonzero(result.status[0] == STATUS.index("partial"))
    assert set(partial) & set(range(3, 8))
    assert set(partial) <= set(range(3, 8))
