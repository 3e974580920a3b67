"""Cameras from scratch: nothing is known of where they stand, and a person of known height walks before them.

1. Each view alone gives its camera's tilt, roll and height over the floor, and the person's path (``floor_views``).
2. The path is the same in all views, so these are turned and shifted onto one floor (``floor_views``).
3. Planes through two cameras that touch the person touch both silhouettes. These equations need no model of the person,
   and determine the cameras' relative poses (``tangents``).
4. Heads and feet that two cameras see in one place give metres, floor and vertical (``level``).
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from mmocap_warp.calibration.solve import UnsolvableError, tangents
from mmocap_warp.calibration.solve.floor_views import FEWEST_FRAMES, place_on_floor, rigid_motion, standing_view
from mmocap_warp.calibration.solve.level import head_and_foot_points, level_world
from mmocap_warp.calibration.solve.person_axis import PersonInViews, person_in_views
from mmocap_warp.calibration.solve.tangents import MAX_MISS, Pinholes, solve_tangents
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.errors import InputError, UsageError
from mmocap_warp.scene.recording import Scene

_FRAMES = 100  # frames of the recording that are used, evenly spread
_MAX_PIXELS = 960  # pixels of an image's longer side
_GUESS = 1.2  # focal length over the image's longer side, as COLMAP guesses it: 45 degrees across
_WALKING = 0.986  # height of a walking person over that of a standing one: knees stay bent
_MIN_AGREED = 0.6  # share of a view's tangents that must agree with other views
_BLOCKS = 5  # blocks of consecutive frames, each left out once for the standard deviations
_MAX_PLACE_SIGMA, _MAX_TILT_SIGMA = 1.0, np.radians(10.0)  # metres and radians of a camera that is determined
_MAX_FOCAL_RATIO = 0.5  # a focal length known no better than this share of the guess's sigma stays as guessed


@dataclass(frozen=True, eq=False, repr=False)
class SolvedCameras:
    """Cameras found from a walking person."""

    rig: CameraRig  #: at full size, with the distortion that was given; the floor is at zero along ``rig.up``
    focal: tuple[Literal["given", "found", "guessed"], ...]  #: the source of each camera's focal length
    centre_sigma: np.ndarray  #: (camera,) standard deviation of the centres, in all directions together [m]
    tilt_sigma: np.ndarray  #: (camera,) standard deviation of their tilts [rad]
    focal_sigma: np.ndarray  #: (camera,) relative standard deviation of focal lengths; zero where given or guessed
    whole: np.ndarray  #: (camera,) int, frames in which the whole person was seen
    frames: range  #: the recording's numbers of the frames that were used
    heads: np.ndarray  #: (frame, 3) the top of the head [m]; NaN where no two cameras agreed on it
    missed: float  #: median of the tangents' residuals [px], in images of ``scale``
    agreed: np.ndarray  #: (camera,) share of each view's tangents that the other views agree on
    scale: float  #: of the images that were used

    def __repr__(self) -> str:
        sigma = 1000 * float(self.centre_sigma.max())
        return f"SolvedCameras: {', '.join(self.rig.names)}, centres within {sigma:.0f} mm, {len(self.frames)} frames"


def solve_cameras(scene: Scene, height: float) -> SolvedCameras:
    """Find a scene's cameras from the silhouettes of one person who walks.

    Of a calibration that the scene names, only the intrinsics are used. The height is that of the person, standing, in
    shoes [m].

    Raises:
        UsageError: a height that is no person's.
        UnsolvableError: the recording does not determine the cameras.
        InputError: a single camera, or masks that turn out unreadable.
    """
    if not 0.5 < height < 2.6:
        raise UsageError(f"--height must be a person's in metres, got {height:g}")
    if len(scene.cameras) < 2:
        raise InputError(scene.path, "names one camera, and solving needs two views at least", "name another camera")
    thinned, scale, person = _seen_person(scene)
    stature = _WALKING * height
    guessed, names = scene.calibration is None, scene.calibrated.names
    # The lenses, all at the origin; with a usual focal length where no calibration is named.
    lenses = scene.rig(scale)
    focal = np.repeat(_GUESS * lenses.size.max(axis=1, keepdims=True), 2, axis=1)
    focal = focal if guessed else lenses.K[:, [0, 1], [0, 1]]
    start = Pinholes(np.tile(np.eye(3), (len(names), 1, 1)), np.zeros((len(names), 3)), focal, lenses.K[:, :2, 2])
    # Rough cameras: each over its own floor, then all over one.
    matrices = np.tile(np.eye(3), (len(names), 1, 1))
    matrices[:, [0, 1], [0, 1]], matrices[:, :2, 2] = start.focal, start.middle
    views = [standing_view(*each, stature) for each in zip(names, person.head, person.foot, matrices, strict=True)]
    R, t = place_on_floor(names, views)
    rough = replace(start, R=R, centre=-np.einsum("kji,kj->ki", R, t))
    # Exact cameras, with free focal lengths where these are guesses.
    free = np.full(len(names), guessed)
    cameras, sigma = _solve(rough, person, stature, free)
    # Focal lengths that the walk does not determine are held at their guesses, and the rest is solved again.
    vague = free & (sigma[2] > _MAX_FOCAL_RATIO * tangents.FOCAL_SIGMA)
    if vague.any():
        rough = replace(rough, focal=np.where(vague[:, None], rough.focal, cameras.focal))
        free &= ~vague
        cameras, sigma = _solve(rough, person, stature, free)
    # Views must agree, and determine the cameras.
    found = tangents.find_tangents(cameras, person.hull)
    missed = np.abs(tangents.residuals(cameras, found))
    in_view = [missed[found.in_view(k)] < MAX_MISS for k in range(len(names))]
    agreed = np.array([float(agrees.mean()) if len(agrees) else 0.0 for agrees in in_view])
    _check(names, agreed, sigma)
    # The head's path, and everything in the scene's world.
    heads, frame, _, _ = head_and_foot_points(cameras, person)
    path = np.full((thinned.frame_count, 3), np.nan)
    for each in np.unique(frame):
        path[each] = np.median(heads[frame == each], axis=0)
    rig, path = _scene_rig(scene, cameras, start, path)
    return SolvedCameras(
        rig=rig, focal=tuple("given" if not guessed else "guessed" if kept else "found" for kept in vague),
        centre_sigma=sigma[0], tilt_sigma=sigma[1], focal_sigma=np.where(free, sigma[2], 0.0),
        whole=person.whole.sum(axis=1), frames=thinned.frames, heads=path, missed=float(np.median(missed)),
        agreed=agreed, scale=scale,
    )  # fmt: skip


def upright(rig: CameraRig, scene: Scene) -> CameraRig:
    """Cameras in metres, in a world with the floor at zero and z up, as a person who walks before them shows it.

    The rig's cameras are placed relative to each other. The scene is the person's recording by all or some of them,
    whose own calibration is not used.

    Raises:
        InputError: a camera that the rig does not have, or has at another size.
        UnsolvableError: the recording does not show where the floor is.
    """
    for name, size in zip(scene.calibrated.names, scene.calibrated.size.tolist(), strict=True):
        if name not in rig.names or rig.size[rig.names.index(name)].tolist() != size:
            problem = f"camera '{name}' is not among {', '.join(rig.names)}, or its images have another size"
            raise InputError(scene.path, problem, "film board and person with the same cameras, names and image sizes")
    own = rig.select(scene.calibrated.names)
    thinned, scale, person = _seen_person(replace(scene, calibrated=own))
    seen = thinned.rig(scale)
    cameras = Pinholes(own.R, own.centres, seen.K[:, [0, 1], [0, 1]], seen.K[:, :2, 2])
    # The vertical lies in the plane of each view's rays through head and foot.
    view = np.nonzero(person.whole)[0]
    if len(view) < FEWEST_FRAMES:
        raise UnsolvableError(f"{len(view)} masks show the whole person; at least {FEWEST_FRAMES} are needed")
    head, foot = (cameras.rays(view, ends[person.whole]) for ends in (person.head, person.foot))
    planes = np.cross(head, foot)
    up = np.linalg.eigh(planes.T @ planes)[1][:, 0]
    up *= np.sign(np.median((head - foot) @ up))
    side = np.linalg.svd(up[None])[2][1:]
    turn = np.stack([side[0], np.cross(up, side[0]), up])
    levelled = level_world(replace(cameras, R=own.R @ turn.T, centre=own.centres @ turn.T), person, None)
    # The whole rig moves as these cameras did.
    turn = levelled.R[0].T @ own.R[0]
    R = rig.R @ turn.T
    return replace(rig, R=R, t=rig.t - R @ (levelled.centre[0] - turn @ own.centres[0]), up="+z")


def _seen_person(scene: Scene) -> tuple[Scene, float, PersonInViews]:
    """The person in every view, in at most a hundred frames: these, the scale of the images, and what they show."""
    every = max(1, -(-scene.frame_count // _FRAMES))
    thinned = replace(scene.of_frames(scene.frames[::every]), foreground=replace(scene.foreground, repair=False))
    scale = min(1.0, _MAX_PIXELS / float(scene.calibrated.size.max()))
    return thinned, scale, person_in_views(list(thinned.observations(scale)), thinned.rig(scale).size)


def _solve(
    rough: Pinholes, person: PersonInViews, stature: float, free_focal: np.ndarray
) -> tuple[Pinholes, list[np.ndarray]]:
    """Cameras, and standard deviations (camera,) of centres [m], tilts [rad] and logarithms of focal lengths.

    They come from the jackknife over blocks of consecutive frames, because neighbouring frames err alike. Errors that
    all frames share, such as shadows, do not show in them.
    """
    cameras = level_world(solve_tangents(rough, person.hull, free_focal), person, stature)
    centres, tilts, zooms = [], [], []
    for block in np.array_split(np.arange(person.head.shape[1]), _BLOCKS):
        rest = person.without(block)
        # The cameras without this block, moved over the floor onto those with it.
        solved = level_world(solve_tangents(cameras, rest.hull, free_focal, tangents.OUTLIERS[-1:]), rest, stature)
        turn, shift = rigid_motion(solved.centre[:, :2], cameras.centre[:, :2])
        centres.append(np.column_stack([solved.centre[:, :2] @ turn.T + shift, solved.centre[:, 2]]))
        tilts.append(np.arcsin(-solved.R[:, 2, 2]))
        zooms.append(np.log(solved.focal[:, 0]))
    spread = [np.sqrt((_BLOCKS - 1) * np.var(each, axis=0)) for each in (centres, tilts, zooms)]
    return cameras, [np.linalg.norm(spread[0], axis=1), *spread[1:]]


def _check(names: tuple[str, ...], agreed: np.ndarray, sigma: list[np.ndarray]) -> None:
    """Raise an UnsolvableError unless views agree and determine the cameras' places."""
    worst = int(np.argmin(agreed))
    if agreed[worst] < _MIN_AGREED:
        raise UnsolvableError(
            f"only {100 * agreed[worst]:.0f} % of the outlines' tangents of camera '{names[worst]}' agree with other "
            f"views within {MAX_MISS:g} px; run mmocap sync, check that its lens has little distortion, and that all "
            "masks show the same person"
        )
    for k, name in enumerate(names):
        if sigma[0][k] > _MAX_PLACE_SIGMA or sigma[1][k] > _MAX_TILT_SIGMA:
            raise UnsolvableError(
                f"the recording does not determine camera '{name}': its place is known to {sigma[0][k]:.2f} m and its "
                f"tilt to {np.degrees(sigma[1][k]):.1f} degrees; record somebody who walks longer ways, with turns"
            )


def _scene_rig(scene: Scene, cameras: Pinholes, start: Pinholes, path: np.ndarray) -> tuple[CameraRig, np.ndarray]:
    """The solved rig at full size, in a world with the scene's vertical, and the path (n, 3) in that world.

    The origin lies on the floor amid the person's path; the axis before the vertical's (y before z) points where the
    first camera looks.
    """
    # Right, ahead and up, in rows, as the first camera looks.
    calibrated = scene.calibrated
    ahead = cameras.R[0, 2] * [1.0, 1.0, 0.0]
    ahead /= np.linalg.norm(ahead)
    own = np.stack([np.cross(ahead, [0.0, 0.0, 1.0]), ahead, [0.0, 0.0, 1.0]])
    # The columns of `world` are where these point in the scene's world.
    up = calibrated.up_vector
    axis = "xyz".index(calibrated.up[1])
    world = np.zeros((3, 3))
    world[:, 2], world[(axis + 2) % 3, 1] = up, 1.0
    world[:, 0] = np.cross(world[:, 1], up)
    turn = world @ own
    # Focal lengths at full size.
    K = calibrated.K.copy()
    if scene.calibration is None:
        K[:, 0, 0] = K[:, 1, 1] = _GUESS * calibrated.size.max(axis=1)
    K[:, [0, 1], [0, 1]] *= cameras.focal / start.focal
    R = cameras.R @ turn.T
    return replace(calibrated, K=K, R=R, t=-np.einsum("kij,kj->ki", R, cameras.centre @ turn.T)), path @ turn.T
