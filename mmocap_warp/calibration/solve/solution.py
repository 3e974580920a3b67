"""Cameras from scratch: nothing is known of where they stand, and a person of known height walks before them.

1. Each view alone says how its camera stands over the floor, and the person's way over it (``single_view``).
2. The way is the same in all views, so these are turned and shifted onto one floor (``floor_alignment``).
3. Planes through two cameras that touch the person touch both silhouettes: these equations know no model of the person,
   and settle how cameras lie to each other (``tangents``).
4. Heads and feet that two cameras see in one place give metres, floor and vertical (``level``).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from mmocap_warp.calibration.solve.floor_alignment import placed_on_floor, rigid_motion
from mmocap_warp.calibration.solve.level import head_points, levelled
from mmocap_warp.calibration.solve.person_axis import PersonInView, person_in_views
from mmocap_warp.calibration.solve.single_view import standing_view
from mmocap_warp.calibration.solve.tangents import (
    FOCAL_SIGMA,
    OUTLIERS,
    Pinholes,
    Tangents,
    adjusted,
    residuals,
    touching,
)
from mmocap_warp.calibration.solve.unsolvable import UnsolvableError
from mmocap_warp.cameras.rig import CameraRig

if TYPE_CHECKING:
    from mmocap_warp.scene.recording import Scene

_FRAMES = 100  # of the recording, evenly spread
_LONGEST = 960  # pixels of an image
_GUESS = 1.2  # focal length over the image's longer side, as COLMAP guesses it: 45 degrees across
_WALKING = 0.986  # height of the head's top over the floor while walking, of that while standing: knees stay bent
_AGREED = 3.0  # [px], of a tangent that two views agree on
_ENOUGH = 0.6  # of a view's tangents, that must agree with others
_BLOCKS = 5  # of consecutive frames, each left out once for the standard deviations
_VAGUE_PLACE, _VAGUE_TILT = 1.0, np.radians(10.0)  # [m, rad], standard deviations of cameras that are not determined
_VAGUE_FOCAL = 0.5  # of a guess's standard deviation; what is known no better stays as guessed

FocalSource = Literal["given", "found", "guessed"]


@dataclass(frozen=True, eq=False)
class SolvedCameras:
    """Cameras found from a walking person.

    Attributes:
        rig: at full size, with the distortion that was given; the floor is at zero along ``rig.up``.
        focal: where each camera's focal length is from.
        centre_sigma: (camera,) float64, standard deviation of the centres, in all directions together [m].
        tilt_sigma: (camera,) float64, of how far down they look [rad].
        focal_sigma: (camera,) float64, of the focal lengths, over their values; zero where given or guessed.
        whole: (camera,) int, frames in which the whole person was seen.
        frames: the recording's numbers of the frames that were used.
        heads: (frame, 3) float64, the top of the head [m]; NaN where no two cameras agreed on it.
        missed: median over tangents of what two views disagree by [px], in images of ``scale``.
        agreed: (camera,) float64, share of each view's tangents that the other views agree on.
        scale: of the images that were used.
    """

    rig: CameraRig
    focal: tuple[FocalSource, ...]
    centre_sigma: np.ndarray
    tilt_sigma: np.ndarray
    focal_sigma: np.ndarray
    whole: np.ndarray
    frames: range
    heads: np.ndarray
    missed: float
    agreed: np.ndarray
    scale: float


def solve_cameras(scene: Scene, height: float) -> SolvedCameras:
    """Find a scene's cameras from the silhouettes of one person who walks.

    Args:
        scene: the recording; where it names a calibration, its intrinsics are taken as given, its places are not looked
            at.
        height: of the person, standing, in shoes [m].

    Raises:
        ValueError: a height that is no person's, or a single camera.
        UnsolvableError: the recording does not tell where the cameras are.
        InputError: masks that turn out unreadable.
    """
    if not 0.5 < height < 2.6:
        raise ValueError(f"height must be a person's in metres, got {height:g}")
    if len(scene.cameras) < 2:
        raise ValueError("cameras are solved from two views at least; this scene has one")
    every = max(1, -(-scene.frame_count // _FRAMES))
    thinned = replace(scene.of_frames(scene.frames[::every]), foreground=replace(scene.foreground, repair=False))
    scale = min(1.0, _LONGEST / float(scene.calibrated.size.max()))
    start = _pinholes(scene, scale)
    sizes = thinned.rig(scale).size
    people = person_in_views(list(thinned.observations(scale)), sizes)
    stature = _WALKING * height
    guessed = scene.calibration is None
    names = scene.calibrated.names

    views = [
        standing_view(name, person, _matrix(start, k), stature)
        for k, (name, person) in enumerate(zip(names, people, strict=True))
    ]
    R, t = placed_on_floor(names, views)
    rough = replace(start, R=R, centre=-np.einsum("kji,kj->ki", R, t))
    free = np.full(len(names), guessed)
    cameras = _in_metres(adjusted(rough, _hulls(people), free), people, stature)
    sigma = _sigmas(cameras, people, stature, free)
    vague = free & (sigma[2] > _VAGUE_FOCAL * FOCAL_SIGMA)
    if vague.any():  # what is not determined stays where it was
        rough = replace(rough, focal=np.where(vague[:, None], rough.focal, cameras.focal))
        free &= ~vague
        cameras = _in_metres(adjusted(rough, _hulls(people), free), people, stature)
        sigma = _sigmas(cameras, people, stature, free)
    tangents = touching(cameras, _hulls(people))
    missed = np.abs(residuals(cameras, tangents))
    agreed = _agreed(tangents, missed, len(names))
    _check(names, agreed, sigma)

    heads, frame = head_points(cameras, tangents, missed, people)
    way = np.full((thinned.frame_count, 3), np.nan)
    for each in np.unique(frame):
        way[each] = np.median(heads[frame == each], axis=0)
    rig, way = _rig(scene, cameras, start, way)
    return SolvedCameras(
        rig=rig,
        focal=tuple("given" if not guessed else "guessed" if kept else "found" for kept in vague),
        centre_sigma=sigma[0],
        tilt_sigma=sigma[1],
        focal_sigma=np.where(free, sigma[2], 0.0),
        whole=np.array([int(person.whole.sum()) for person in people]),
        frames=thinned.frames,
        heads=way,
        missed=float(np.median(missed)),
        agreed=agreed,
        scale=scale,
    )


def _pinholes(scene: Scene, scale: float) -> Pinholes:
    """The lenses, at ``scale`` and nowhere yet; of a usual focal length where no calibration is named."""
    rig = scene.rig(scale)
    count = len(rig)
    focal = rig.K[:, [0, 1], [0, 1]]
    if scene.calibration is None:
        focal = np.repeat(_GUESS * rig.size.max(axis=1, keepdims=True), 2, axis=1)
    return Pinholes(np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3)), focal, rig.K[:, :2, 2])


def _matrix(cameras: Pinholes, k: int) -> np.ndarray:
    (fx, fy), (cx, cy) = cameras.focal[k], cameras.middle[k]
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def _hulls(people: list[PersonInView]) -> np.ndarray:
    return np.stack([person.hull for person in people])


def _in_metres(cameras: Pinholes, people: list[PersonInView], stature: float) -> Pinholes:
    tangents = touching(cameras, _hulls(people))
    return levelled(cameras, tangents, residuals(cameras, tangents), people, stature)


def _sigmas(
    cameras: Pinholes, people: list[PersonInView], stature: float, free_focal: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Standard deviations (camera,) of centres [m], tilts [rad] and logarithms of focal lengths.

    By the jackknife over blocks of consecutive frames: neighbours err alike, and residuals do not say how much. What
    all frames have in common, such as shadows, it does not see.
    """
    centres, tilts, zooms = [], [], []
    for block in np.array_split(np.arange(len(people[0].head)), _BLOCKS):
        rest = [person.without(block) for person in people]
        found = _in_metres(adjusted(cameras, _hulls(rest), free_focal, OUTLIERS[-1:]), rest, stature)
        turn, shift = rigid_motion(found.centre[:, :2], cameras.centre[:, :2])
        centres.append(np.column_stack([found.centre[:, :2] @ turn.T + shift, found.centre[:, 2]]))
        tilts.append(np.arcsin(-found.R[:, 2, 2]))
        zooms.append(np.log(found.focal[:, 0]))
    spread = [np.sqrt((_BLOCKS - 1) * np.var(each, axis=0)) for each in (centres, tilts, zooms)]
    return np.linalg.norm(spread[0], axis=1), spread[1], spread[2]


def _check(names: tuple[str, ...], agreed: np.ndarray, sigma: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
    """See that views agree and that their places are determined.

    Raises:
        UnsolvableError: they are not.
    """
    worst = int(np.argmin(agreed))
    if agreed[worst] < _ENOUGH:
        raise UnsolvableError(
            f"only {100 * agreed[worst]:.0f} % of the outlines' tangents of camera '{names[worst]}' agree with other "
            f"views within {_AGREED:g} px; is it synchronous (mmocap sync), its lens without much distortion, and do "
            "all masks show one and the same person?"
        )
    for k, name in enumerate(names):
        if sigma[0][k] > _VAGUE_PLACE or sigma[1][k] > _VAGUE_TILT:
            raise UnsolvableError(
                f"the recording does not determine camera '{name}': its place is known to {sigma[0][k]:.2f} m and its "
                f"tilt to {np.degrees(sigma[1][k]):.1f} degrees; record somebody who walks longer ways, with turns"
            )


def _agreed(tangents: Tangents, missed: np.ndarray, cameras: int) -> np.ndarray:
    """(camera,) share of each view's tangents that the other views agree on; zero where it has none."""
    agrees = missed < _AGREED
    shares = []
    for k in range(cameras):
        mine = (tangents.first == k) | (tangents.second == k)
        shares.append(float(agrees[mine].mean()) if mine.any() else 0.0)
    return np.array(shares)


def _rig(scene: Scene, cameras: Pinholes, start: Pinholes, way: np.ndarray) -> tuple[CameraRig, np.ndarray]:
    """The scene's rig, found, in a world with the scene's vertical, and places (n, 3) in it.

    The origin lies on the floor amid the person's way; the axis before the vertical's (y before z) points where the
    first camera looks.
    """
    calibrated = scene.calibrated
    ahead = cameras.R[0, 2] * [1.0, 1.0, 0.0]
    ahead /= np.linalg.norm(ahead)
    own = np.stack([np.cross(ahead, [0.0, 0.0, 1.0]), ahead, [0.0, 0.0, 1.0]])  # right, ahead and up, in rows
    up = calibrated.up_vector
    axis = "xyz".index(calibrated.up[1])
    world = np.zeros((3, 3))  # its columns are where right, ahead and up point
    world[:, 2], world[(axis + 2) % 3, 1] = up, 1.0
    world[:, 0] = np.cross(world[:, 1], up)
    turn = world @ own
    K = calibrated.K.copy()
    if scene.calibration is None:
        K[:, 0, 0] = K[:, 1, 1] = _GUESS * calibrated.size.max(axis=1)
    K[:, [0, 1], [0, 1]] *= cameras.focal / start.focal
    R = cameras.R @ turn.T
    centre = cameras.centre @ turn.T
    return replace(calibrated, K=K, R=R, t=-np.einsum("kij,kj->ki", R, centre)), way @ turn.T
