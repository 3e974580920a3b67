"""What cameras are adjusted by, piece by piece: hulls over masks, points, shifted frames, groups of parameters."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from moving_person import BODY, FPS, RIG, ROOTING, motion, subject, write_scene
from synthetic import ring_rig

from mmocap_warp.body.rotations import turn
from mmocap_warp.body.skeleton import ROOT_ANGLES
from mmocap_warp.calibration.adjust.adjustment import AdjustConfig, Adjustment
from mmocap_warp.calibration.adjust.camera_changes import KINDS, LENS, POSITION, ROTATION, groups_of
from mmocap_warp.calibration.adjust.footage import Footage
from mmocap_warp.calibration.adjust.silhouette_agreement import LandmarkProblem, _covered_share, coherence, landmarks
from mmocap_warp.calibration.first_look import few_masks, few_views
from mmocap_warp.calibration.gross_mistake import _TURNS, _turned
from mmocap_warp.calibration.refine import refinement
from mmocap_warp.cameras.rig import CameraRig, project
from mmocap_warp.errors import InputError
from mmocap_warp.masks.observation import Observation, unpack_masks


def test_a_voxel_covers_a_disc_of_its_size() -> None:
    """Of half a voxel's diagonal across, in whole pixels and at least one."""
    mask = np.ones((101, 101), bool)
    for focal, radius in ((300.0, 4), (40.0, 1)):
        rig = CameraRig(
            ("a",), np.diag([focal, focal, 1.0])[None], np.eye(3)[None], np.zeros((1, 3)), np.array([[101, 101]]),
            np.zeros((1, 5)), "+y",
        )  # fmt: skip
        at = np.array([[50, 50], [-1, 50], [101, 50]])  # two of them outside of the image
        covered = 101**2 * _covered_share(rig, 0, np.array([0.0, 0.0, 2.0]), at, mask)
        assert abs(covered - np.pi * (radius + 0.5) ** 2) < 2 * radius + 2
        assert round(covered) % 2 == 1  # a disc about a pixel is symmetric


def test_three_views_are_compared_however_little_one_of_them_sees() -> None:
    rig = ring_rig(3)
    masks = [np.zeros((height, width), bool) for width, height in rig.size]
    middle = project(rig, np.zeros((1, 3)) + rig.centres.mean(axis=0))[:, 0].round().astype(int)
    for mask, (x, y) in zip(masks, middle, strict=True):
        mask[y, x] = True
    assert np.isfinite(coherence(rig, [Observation.from_masks(masks)])).all()
    masks[2][:] = False
    assert np.isnan(coherence(rig, [Observation.from_masks(masks)])).all()


def test_the_points_of_a_silhouette_are_its_centroid_and_its_highest_end() -> None:
    rig = ring_rig(2)
    masks = [np.zeros((height, width), bool) for width, height in rig.size]
    for mask in masks:
        mask[40:140, 60:70] = True
        mask[40:42, 60:70] = True
    points = landmarks(rig, [Observation.from_masks(masks)])[0]
    np.testing.assert_allclose(points[:, 0], [[64.5, 89.5]] * 2)
    np.testing.assert_allclose(points[:, 1], [[64.5, 40.5]] * 2, atol=0.51)


def test_points_meet_where_rays_do_and_err_by_metres_at_the_body() -> None:
    rig = ring_rig(3)
    there = np.random.default_rng(0).uniform((-0.3, 0.7, -0.3), (0.3, 1.3, 0.3), (4, 2, 3))
    seen = np.stack([project(rig, frame) for frame in there])  # (frame, camera, point, 2)
    problem = LandmarkProblem(rig, seen, FPS, np.zeros((3, len(KINDS))))
    none = np.zeros((3, len(KINDS)))
    np.testing.assert_allclose(problem.points(none), there, atol=1e-6)
    np.testing.assert_allclose(problem.errors(none), 0.0, atol=1e-6)
    off = seen.copy()
    off[:, 1:] = np.nan
    assert np.isnan(LandmarkProblem(rig, off, FPS, none).points(none)).all()
    raised = seen.copy()
    raised[:, 0, :, 1] += 5.0
    depth = np.einsum("ij,fpj->fpi", rig.R[0], there)[..., 2] + rig.t[0, 2]
    missed = np.abs(LandmarkProblem(rig, raised, FPS, none).errors(none)[:, 0, :, 1])
    assert (missed < 5.0 * depth / rig.K[0, 1, 1]).all()
    assert (missed > 0.5 * 5.0 * depth / rig.K[0, 1, 1]).all()


def test_what_a_late_camera_saw_lies_between_its_frames_and_beyond_them_is_unknown() -> None:
    seen = np.arange(5.0)[:, None, None, None] * np.ones((5, 2, 1, 2))
    problem = LandmarkProblem(ring_rig(2), seen, 10.0, np.zeros((2, len(KINDS))))
    later = problem._seen_later(np.array([0.0, 0.125]))[:, :, 0, 0]
    np.testing.assert_allclose(later[:, 0], np.arange(5.0))
    np.testing.assert_allclose(later[:, 1], [1.25, 2.25, 3.25, np.nan, np.nan])
    earlier = problem._seen_later(np.array([0.0, -0.05]))[:, 1, 0, 0]
    np.testing.assert_allclose(earlier, [np.nan, 0.5, 1.5, 2.5, 3.5])


@pytest.mark.parametrize("cause", _TURNS)
def test_pictures_that_were_turned_are_seen_by_a_turned_camera(cause: str) -> None:
    """With a principal point off the middle, but for quarters of a turn, after which it is not known."""
    by, point = _TURNS[cause], np.array([0.2, 1.1, -0.1])
    rig = ring_rig(2)
    K = rig.K.copy()
    quarter = "90" in cause
    K[:, :2, 2] = (rig.size - 1) / 2 + (0.0 if quarter else np.array([7.0, -4.0]))
    rig = replace(rig, K=K)
    middle = (rig.size - 1) / 2

    def seen(rig: CameraRig) -> np.ndarray:
        image = np.einsum("kij,kj->ki", rig.K, rig.R @ point + rig.t)
        return image[:, :2] / image[:, 2:] - middle

    before, after = seen(rig), seen(_turned(rig, [1], by))
    np.testing.assert_allclose(after, [before[0], by @ before[1]], atol=1e-9)


@pytest.mark.parametrize(("scale", "valid"), [(None, True), (1.0, True), (0.3, True), (0.0, False), (1.1, False)])
def test_masks_may_be_smaller_and_not_larger(scale: float | None, valid: bool) -> None:
    if valid:
        assert AdjustConfig(scale=scale).scale == scale
    else:
        with pytest.raises(ValueError, match="scale must be in"):
            AdjustConfig(scale=scale)


def test_parameters_of_a_camera_belong_together_by_kind_and_never_to_another_camera() -> None:
    group = groups_of(3)
    assert group.shape == (3, len(KINDS))
    assert len(np.unique(group)) == 3 * 6
    for camera in group:
        for kinds in (ROTATION, POSITION, slice(7, 9)):
            assert len(np.unique(camera[kinds])) == 1
        assert len(np.unique(camera[LENS])) == 3
    assert not np.isin(group[0], group[1:]).any()


@pytest.fixture
def scene(tmp_path: Path):
    return write_scene(tmp_path, frames=5)


def test_each_camera_gives_its_nearest_whole_frame(scene) -> None:
    """One has half as many frames, and one was late by more than a frame: what is left over is the rest."""
    first, second, *others = scene.cameras
    changed = replace(
        scene, cameras=(replace(first, rate=0.5, fraction=0.4), replace(second, frame_offset=1), *others), frame_count=3
    )
    footage, offset = Footage(changed, 1.0), np.array([0.0, 1.3 / FPS, 0.0, 0.0])
    all_masks = [unpack_masks(each.words, RIG.size) for each in scene.observations()]
    seen = [unpack_masks(each.words, RIG.size) for each in footage.observations(offset)]
    for frame, masks in enumerate(seen):
        np.testing.assert_array_equal(masks[0], all_masks[round(0.5 * frame)][0])
        np.testing.assert_array_equal(masks[1], all_masks[min(frame + 2, 4)][1])
        np.testing.assert_array_equal(masks[2], all_masks[frame][2])
    np.testing.assert_allclose(footage.rest(offset) * FPS, [0.8, 0.3, 0.0, 0.0], atol=1e-9)


def test_a_camera_gives_nothing_while_it_is_frozen(tmp_path: Path) -> None:
    """Every second frame is used, of which there would be too few to notice it."""
    scene = replace(write_scene(tmp_path, frames=26), fps=60.0)
    folder = tmp_path / "masks" / RIG.names[1]
    for frame in range(13, 26):
        shutil.copy(folder / "0012.png", folder / f"{frame:04d}.png")
    seen = Footage(scene, 1.0).observations(np.zeros(len(RIG)))
    assert [each.foreground.astype(bool).tolist() for each in seen] == 7 * [[True] * 4] + 6 * [
        [True, False, True, True]
    ]


def test_who_is_followed_from_a_known_pose_is_not_the_larger_one(scene) -> None:
    """Masks are those near the first pose where they are to be, and where the pose is known."""
    frames = list(scene.masks())
    with_other = [[mask.copy() for mask in masks] for masks in frames]
    for masks in with_other:
        for mask in masks:
            mask[:, : mask.shape[1] // 6] = True  # larger than the person
    scene, near = (
        replace(scene, foreground=replace(scene.foreground, join=1.0, keep=keep)) for keep in ("all", "nearest")
    )
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(type(scene), "_raw_masks", lambda self, k, scale, read, _: ([with_other[f][k]] for f in read))
        followed, alone, others = (
            few_masks(each, 10_000, start)[1] for each, start in ((near, subject()), (near, None), (scene, subject()))
        )
    for one, other, whole, found in zip(alone, others, with_other, followed, strict=True):
        for k in range(len(RIG)):
            assert not found[k][:, :2].any()
            assert one[k][:, :2].all()
            np.testing.assert_array_equal(other[k], whole[k])


def test_images_are_as_much_larger_as_the_subject_is_too_small(monkeypatch) -> None:
    asked: list[int] = []
    masks = [np.zeros((240, 320), bool) for _ in range(2)]
    for mask in masks:
        mask[100:140, 150:160] = True  # about 41 pixels from end to end

    def few(scene, side, start):
        asked.append(side)
        return ring_rig(2), [masks]

    monkeypatch.setattr("mmocap_warp.calibration.first_look.few_masks", few)
    views = few_views(SimpleNamespace(calibrated=SimpleNamespace(size=np.array([[1920, 1080]]))))
    assert 40 < views.diameter < 46
    assert asked == [320, round(320 * 80 / views.diameter)]


@pytest.mark.parametrize("begins", [0, 3])
def test_the_person_is_tracked_again_from_the_pose_of_the_first_frame_in_the_new_world(monkeypatch, begins) -> None:
    """The solution's where it has that frame, else that which it was tracked from; both turned and shifted."""
    shift, quarter = np.array([1.0, 2.0, 3.0]), turn("y", 0.5)
    rooted = motion().rooted[np.arange(begins, begins + 2)]
    start = subject()
    solution = SimpleNamespace(change=np.zeros((4, len(KINDS))), rooted=rooted, beta=None)
    person = SimpleNamespace(
        subject=start, motion=SimpleNamespace(rooting=ROOTING), found=np.arange(begins, begins + 2)
    )
    tracked = []

    class Stub:
        space = SimpleNamespace(model=lambda beta: BODY)
        world_is_chosen = False

        def __init__(self, *_: object) -> None: ...

        def start(self) -> np.ndarray:
            return solution.change

        def stillest_camera(self, change: np.ndarray) -> int:
            return 0

        def relative_to(self, change: np.ndarray, fixed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            return change, quarter, shift

        def fit_body(self, change: np.ndarray) -> object:
            return start

        def add_whole_lags(self, change: np.ndarray, person: object) -> tuple[np.ndarray, object]:
            return change, person

        def sigma_with_fixed(self, fixed: int) -> np.ndarray:
            return solution.change

        def solve(self, *_: object, again: bool) -> object:
            return solution

        def track_person(self, change: np.ndarray, subject: object) -> object:
            tracked.append(subject)
            return person

    monkeypatch.setattr(refinement, "Adjustment", Stub)
    monkeypatch.setattr(refinement, "_select_and_judge", lambda *given: given[-1])
    assert refinement.refine(None, BODY) == 0
    assert len(tracked) == 3
    expected = ROOTING.leave(rooted[:1], start.pose[ROOT_ANGLES])[0] if begins == 0 else start.pose.copy()
    expected[:3] = quarter @ expected[:3] + shift
    for again in tracked[1:]:
        np.testing.assert_allclose(again.pose, expected)
        np.testing.assert_allclose(again.root_base, quarter @ start.root_base)


def test_a_clip_that_is_too_short_is_refused_before_anything_is_fitted(tmp_path, monkeypatch):
    monkeypatch.setattr("mmocap_warp.calibration.adjust.adjustment.fit_clip", pytest.fail)
    scene = write_scene(tmp_path, RIG, 7)
    with pytest.raises(InputError, match=r"too few frames \(7\): cameras are compared by 8 or more; give a longer"):
        Adjustment(scene, BODY, AdjustConfig(device="cpu")).fit_body(np.zeros((len(RIG), len(KINDS))))
