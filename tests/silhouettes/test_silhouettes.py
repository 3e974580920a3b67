"""Silhouettes of 1,000 random bodies: every way to draw them counts the same pixels, and they are the right ones."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
import reference
import warp as wp
from body_parts import hierarchical
from drawn import Drawing, cast_bits, counts_of, draw_bits, pictures_of
from person_skeleton import PARENT
from random_scenes import any_rig, indoor_rig, posed_vertices, random_masks, random_poses
from synthetic import SKELETON, ring_rig, synthetic_body, synthetic_subject

from mmocap_warp.body.model import BodyModel
from mmocap_warp.body.posing import Poser
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.formats.usd.usd_body import read_body
from mmocap_warp.kernels.views.projection import BEHIND, SUBPIXEL
from mmocap_warp.masks.observation import Observation
from mmocap_warp.scenes import ROOT
from mmocap_warp.silhouettes import RENDERERS
from mmocap_warp.silhouettes.objective import Objective

PEOPLE = 25  # bodies in a room, with six cameras each
ROOMS = 40 if wp.config.mode != "debug" else 4  # 1,000 bodies; fewer where every index is checked, which takes long
PIXELS_APART = 1e-4  # of the image: corners are moved by up to half of a sixteenth of a pixel to the grid
PARTS = {(dof, part.name): part.index for dof in (39, 28) for part in hierarchical(SKELETON, dof)}


@dataclass(frozen=True)
class Room:
    """Random cameras, one of them within the first person; random people; and noise for masks."""

    rig: CameraRig
    poses: np.ndarray
    masks: list[np.ndarray]


@cache
def room(seed: int) -> Room:
    poses = random_poses(PEOPLE, seed=seed).astype(np.float32)
    rig = any_rig(seed, inside=poses[0, :3])
    return Room(rig, poses, random_masks(rig.size, seed))


@cache
def real_body() -> BodyModel:
    """One whose limbs open into its trunk; the made-up one's are closed boxes."""
    return read_body(ROOT / "bodies" / "adult_man.usdc")


def objective_of(at: Room, device: str, renderer: str, threads: int = 1, body: BodyModel | None = None) -> Objective:
    subject = synthetic_subject()
    objective = Objective(
        body or subject.body, subject.root_base, at.rig, PEOPLE, renderer=renderer, device=device, threads=threads
    )
    objective.observe(Observation.from_masks(at.masks))
    return objective


def counts(objective: Objective, poses: np.ndarray) -> np.ndarray:
    """(candidate, camera, 2) of the poses; none is left from before."""
    values = np.full(objective.pose.shape, np.nan, np.float32)
    values[: len(poses)] = poses
    objective.pose.assign(values)
    objective.count.fill_(wp.vec2i(-1, -1))
    objective.evaluate(len(poses))
    return objective.count.numpy()[: len(poses)]


@cache
def counted(seed: int, device: str, renderer: str) -> np.ndarray:
    """(candidate, camera, 2) of all people in a room."""
    return counts(objective_of(room(seed), device, renderer), room(seed).poses).copy()


def posed(at: Room, device: str) -> wp.array:
    return posed_vertices(synthetic_body(), synthetic_subject().root_base, at.poses, device)


# What is tested


def test_the_cases_are_of_every_kind():
    """Views from inside, of people wholly and partly in view, cut by the near plane, and behind the camera."""
    kinds = dict.fromkeys(("inside", "whole", "part", "cut", "behind", "beside"), 0)
    mesh = synthetic_body().tracking
    for seed in range(ROOMS):
        at = room(seed)
        drawing = Drawing(mesh, at.rig, posed(at, "cpu"))
        model = drawing.count(at.masks)[..., 0]
        for c, views in enumerate(drawing.image()):
            for k, view in enumerate(views):
                behind, corner = view[:, 0] == BEHIND, np.array(at.rig.size[k]) * SUBPIXEL
                within = np.all((view >= 0) & (view < corner), axis=1)
                kinds["inside"] += model[c, k] == at.rig.size[k].prod()
                kinds["whole"] += within.all()
                kinds["part"] += within.any() and not within.all()
                kinds["cut"] += behind.any() and not behind.all()
                kinds["behind"] += behind.all()
                kinds["beside"] += not behind.any() and not within.any()
    assert min(kinds.values()) >= ROOMS / 2, kinds


# The same pixels


def test_both_renderers_count_the_same_pixels(device):
    for seed in range(ROOMS):
        np.testing.assert_array_equal(*(counted(seed, device, renderer) for renderer in RENDERERS))


@pytest.mark.parametrize("renderer", RENDERERS)
def test_any_number_of_threads_counts_the_same_pixels(renderer):
    for seed in range(ROOMS):
        at = room(seed)
        for threads in (2, 3):
            found = counts(objective_of(at, "cpu", renderer, threads), at.poses)
            np.testing.assert_array_equal(found, counted(seed, "cpu", renderer))


@pytest.mark.parametrize("renderer", RENDERERS)
@pytest.mark.parametrize("people", [1, 4, 11])
def test_a_smaller_batch_counts_the_same_pixels(device, people, renderer):
    """On a GPU several blocks share a view where there are few."""
    for seed in range(min(ROOMS, 6)):
        objective = objective_of(room(seed), device, renderer)
        for first in (0, PEOPLE - people):
            chosen = slice(first, first + people)
            found = counts(objective, room(seed).poses[chosen])
            np.testing.assert_array_equal(found, counted(seed, device, renderer)[chosen])


def moved(at: Room, index: np.ndarray, runs: int, particles: int) -> np.ndarray:
    """(run particle, 51) poses: those of the first people, changed in coordinates ``index`` alone."""
    poses = np.repeat(at.poses[:runs], particles, axis=0)
    poses[:, index] += np.random.default_rng(0).normal(0, 0.3, (len(poses), len(index))).astype(np.float32)
    return poses


@pytest.mark.parametrize("renderer", RENDERERS)
def test_a_moving_part_counts_the_pixels_of_the_whole(device, renderer):
    """Each of the six parts of 39 and of 28 degrees of freedom, five runs from poses of their own, in every room.

    The second generation is cut to three of the five particles.
    """
    runs = 5
    for seed in range(ROOMS):
        at = room(seed)
        objective = objective_of(at, device, renderer)
        base = wp.array(at.poses[:runs], dtype=wp.float32, device=device)
        for index in list(PARTS.values())[seed % 2 :: 2]:
            generations = [moved(at, index, runs, particles) for particles in (5, 3)]
            objective.release()
            whole = [counts(objective, poses).copy() for poses in generations]
            objective.hold(base, index)
            for poses, expected in zip(generations, whole, strict=True):
                np.testing.assert_array_equal(counts(objective, poses), expected)


@pytest.mark.parametrize("renderer", RENDERERS)
def test_a_moving_part_of_a_real_body_counts_the_pixels_of_the_whole(device, renderer):
    """And both renderers count the same."""
    runs = 5
    for seed in range(4):
        at = room(seed)
        objective = objective_of(at, device, renderer, body=real_body())
        whole = objective_of(at, device, "raster", body=real_body())
        np.testing.assert_array_equal(counts(objective, at.poses), counts(whole, at.poses))
        for index in list(PARTS.values())[seed % 3 :: 3]:
            poses = moved(at, index, runs, 3)
            objective.hold(wp.array(at.poses[:runs], dtype=wp.float32, device=device), index)
            np.testing.assert_array_equal(counts(objective, poses), counts(whole, poses))


def test_a_moving_part_counts_the_same_with_threads():
    """Threads take candidates of several runs, and begin in the middle of one."""
    at, index = room(1), PARTS[39, "left leg"]
    poses = moved(at, index, 5, 5)
    whole = counts(objective_of(at, "cpu", "raster"), poses)
    for renderer in RENDERERS:
        for threads in (1, 2, 3, 5):
            objective = objective_of(at, "cpu", renderer, threads)
            objective.hold(wp.array(at.poses[:5], dtype=wp.float32, device="cpu"), index)
            np.testing.assert_array_equal(counts(objective, poses), whole)


def inner_rig(body: BodyModel, pose: np.ndarray, size: tuple[int, int]) -> CameraRig:
    """Cameras in the body's joints that look at the joint above: out of a limb, into the rest of the body."""
    frames = Poser(body, np.eye(3)).joint_transforms(pose)[0].astype(float)
    rig = ring_rig(cameras=len(PARENT) - 1, size=size)
    for j in range(1, len(PARENT)):
        forward = frames[PARENT[j], :3, 3] - frames[j, :3, 3]
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, frames[j, :3, np.abs(frames[j, :3, :3].T @ forward).argmin()])
        right /= np.linalg.norm(right)
        rig.R[j - 1] = np.stack([right, np.cross(forward, right), forward])
        rig.t[j - 1] = -rig.R[j - 1] @ frames[j, :3, 3]
    return rig


@pytest.mark.parametrize("renderer", RENDERERS)
def test_a_moving_part_that_is_cut_shows_the_inside_of_what_stays(device, renderer):
    body = real_body()
    for seed in range(3):
        start = random_poses(1, seed=seed, reach=0.2, bend=0.3).astype(np.float32)
        rig = inner_rig(body, start, size=(64, 48))
        objective = Objective(body, np.eye(3), rig, 3, renderer=renderer, device=device)
        objective.observe(Observation.from_masks(random_masks(rig.size)))
        for index in PARTS.values():
            poses = np.repeat(start, 3, axis=0)
            poses[:, index] += np.random.default_rng(seed).normal(0, 0.1, (3, len(index))).astype(np.float32)
            objective.release()
            whole = counts(objective, poses).copy()
            objective.hold(wp.array(start, dtype=wp.float32, device=device), index)
            np.testing.assert_array_equal(counts(objective, poses), whole)


# The right pixels


def test_pixels_are_those_of_the_reference(device):
    """Bit by bit, by exact edge tests in integers; where the near plane cuts a body the reference does not draw it."""
    mesh, views_drawn = synthetic_body().tracking, 0
    for seed in range(min(ROOMS, 11)):
        at = room(seed)
        vertices = posed(at, device)
        drawing = Drawing(mesh, at.rig, vertices)
        found = drawing.count(at.masks)
        pictures = pictures_of(draw_bits(mesh, at.rig, vertices), at.rig.size)
        for c, views in enumerate(drawing.image()):
            for k, view in enumerate(views):
                behind = view[:, 0] == BEHIND
                if behind.any() and not behind.all():
                    continue
                picture = reference.covered(view, mesh.face, *at.rig.size[k])
                np.testing.assert_array_equal(pictures[c][k], picture)
                assert found[c, k].tolist() == [picture.sum(), (picture & at.masks[k]).sum()]
                views_drawn += 1
    assert views_drawn > 1000 or ROOMS < 11


def test_silhouettes_are_drawn_as_they_are_counted(device):
    for seed in range(ROOMS):
        at = room(seed)
        bits = draw_bits(synthetic_body().tracking, at.rig, posed(at, device))
        expected = counts_of(pictures_of(bits, at.rig.size), at.masks)
        np.testing.assert_array_equal(counted(seed, device, "raster"), expected)


def apart(some: np.ndarray, others: np.ndarray) -> int:
    """Pixels that differ."""
    return int(np.bitwise_count(some ^ others).sum(dtype=int))


def test_pixels_are_those_that_single_rays_hit(device, record_property):
    """In images of 320 x 240 and smaller, whether or not the near plane cuts a body."""
    faces, sizes = synthetic_body().tracking.face, ((320, 240), (211, 160), (320, 97))
    differ, pixels = 0, 0
    for seed in range(min(ROOMS, 14)):
        at = Room(indoor_rig(sizes, seed), random_poses(PEOPLE, seed=seed), [])
        vertices = posed(at, device)
        differ += apart(draw_bits(synthetic_body().tracking, at.rig, vertices), cast_bits(faces, at.rig, vertices))
        pixels += PEOPLE * int(at.rig.size.prod(axis=1).sum())
    record_property("pixels_apart", f"{differ} of {pixels}")
    assert differ < PIXELS_APART * pixels


def test_pixels_from_inside_a_body_are_those_that_single_rays_hit(device):
    mesh = real_body().tracking
    for seed in range(2):
        pose = random_poses(1, seed=seed, reach=0.2, bend=0.3)
        rig = inner_rig(real_body(), pose, size=(320, 240))
        vertices = posed_vertices(real_body(), np.eye(3), pose, device)
        drawn = draw_bits(mesh, rig, vertices)
        assert apart(drawn, cast_bits(mesh.face, rig, vertices)) < PIXELS_APART * rig.size.prod(axis=1).sum()
        covered = np.bitwise_count(drawn).sum(axis=(2, 3), dtype=int) / rig.size.prod(axis=1)
        assert np.any(covered == 1.0)
        assert np.any(covered < 1.0)  # seen from outside, past the near plane


def test_a_gpu_draws_what_the_cpu_draws(device):
    if device == "cpu":
        pytest.skip("compares a CUDA device with the CPU")
    mesh, differ, pixels = synthetic_body().tracking, 0, 0
    for seed in range(ROOMS):
        at = room(seed)
        differ += apart(*(draw_bits(mesh, at.rig, posed(at, where)) for where in ("cpu", device)))
        pixels += PEOPLE * int(at.rig.size.prod(axis=1).sum())
    assert differ < PIXELS_APART * pixels


def test_a_real_body_is_drawn_right(device):
    """A few thousand triangles in images of 640 x 480: drawn, counted in both ways, and by one ray a pixel."""
    body, rig = real_body(), ring_rig(cameras=2)
    vertices = posed_vertices(body, np.eye(3), random_poses(3, reach=0.3, bend=0.6), device)
    bits = draw_bits(body.tracking, rig, vertices)
    assert apart(bits, cast_bits(body.tracking.face, rig, vertices)) < PIXELS_APART * bits.size * 32
    masks = random_masks(rig.size)
    expected = counts_of(pictures_of(bits, rig.size), masks)
    for renderer in RENDERERS:
        np.testing.assert_array_equal(Drawing(body.tracking, rig, vertices, renderer).count(masks), expected)
