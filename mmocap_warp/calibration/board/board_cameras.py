"""Cameras from a board that is moved about: first each lens from frames near to it, then the places of all.

A small board far away does not tell focal length from distance, so places are solved with the lenses held. OpenCV's
``calibrateMultiview`` does that too, but only from boards of which all corners are seen.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from mmocap_warp.calibration.board.pattern import Board
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.errors import InputError

_LENS_FRAMES, _PLACE_FRAMES = 40, 120  # frames that are used for a lens, and for the places
_MIN_LENS_FRAMES, _MIN_COMMON = 8, 5  # frames that a lens needs, and a camera in common with the others
_MAX_FOCAL_SIGMA = 0.01  # of the focal length, as a share, of a lens that is determined
_BENT = 0.95  # residuals with a third radial term over those without, below which the lens has one
_MAX_STEPS = 60  # of the adjustment of the places
_BLURRED = 25  # percent of a camera's frames that are too blurred, or moved too fast, to be used
_MAX_RMS = 0.002  # residual of the places over the image's longer side; out of step it is ten times as much


@dataclass(frozen=True)
class Detections:
    """A board in the frames of one camera."""

    pixels: np.ndarray  # (frame, corner, 2) float32 [px]; NaN where a corner is not seen
    sharpness: np.ndarray  # (frame,) how sharp the board's edges are; 0 where it is not seen
    other: str | None = None  # what the images show of another board, in words

    @property
    def seen(self) -> np.ndarray:
        """(frame,) bool, whether the board is seen."""
        return np.isfinite(self.pixels[..., 0]).any(axis=1)

    @property
    def sharp(self) -> np.ndarray:
        """(frame,) bool, whether it is seen and not among the most blurred."""
        level = np.percentile(self.sharpness[self.seen], _BLURRED) if self.seen.sum() > _LENS_FRAMES // 2 else 0.0
        return self.seen & (self.sharpness >= level)


@dataclass(frozen=True, eq=False, repr=False)
class BoardCalibration:
    """Cameras found from a board."""

    rig: CameraRig  #: the cameras, in metres
    rms: np.ndarray  #: (camera,) root mean square of the residuals [px]
    focal_sigma: np.ndarray  #: (camera,) standard deviation of focal lengths, as a share; 0 where they were given
    lens_frames: np.ndarray  #: (camera,) int, frames that a camera's lens was found from
    place_frames: np.ndarray  #: (camera,) int, frames that its place was found from
    coverage: np.ndarray  #: (camera,) the share of the image, in 8x6 cells, that the board's corners covered
    points: tuple[np.ndarray, ...]  #: per camera (n, 2), corners [px]
    residuals: tuple[np.ndarray, ...]  #: per camera (n, 2), how far the calibration misses them [px]

    def __repr__(self) -> str:
        return f"BoardCalibration: {', '.join(self.rig.names)}, residuals {self.rms.max():.2f} px at most"


def detect_board(images: Iterable[np.ndarray | None], board: Board) -> Detections:
    """Look for the board in the BGR or gray images of one camera; None stands for a frame that it does not have."""
    pixels, sharpness, other = [], [], None
    nothing = np.full((len(board.corners), 2), np.nan, np.float32)
    for image in images:
        gray = image if image is None or image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        corners = None if gray is None else board.find(gray)
        if corners is None and gray is not None and other is None and not sharpness.count(0.0) % 10:
            other = board.other_boards(gray)
        pixels.append(nothing if corners is None else corners)
        sharpness.append(0.0 if corners is None or gray is None else _sharpness(gray, corners))
    return Detections(np.array(pixels).reshape(-1, *nothing.shape), np.array(sharpness), other)


def _sharpness(gray: np.ndarray, corners: np.ndarray) -> float:
    """The Laplacian's variance over that of the gray levels, made independent of how large the squares are."""
    left, top = np.nanmin(corners, axis=0).astype(int)
    right, bottom = np.nanmax(corners, axis=0).astype(int) + 2
    part = gray[max(top, 0) : bottom, max(left, 0) : right]
    edges = cv2.Laplacian(part, cv2.CV_32F)
    return float(edges.var() / max(part.var(), 1.0) * np.sqrt(part.size / np.isfinite(corners[:, 0]).sum()))


def calibrate_from_board(
    names: Sequence[str], sizes: np.ndarray, detections: Sequence[Detections], board: Board, known: CameraRig | None
) -> BoardCalibration:
    """Find lenses and places; the world is the first camera's.

    Args:
        names: of the cameras.
        sizes: (camera, 2) width and height [px].
        detections: the board in each camera's frames, which are in step.
        board: the board.
        known: lenses that are held, of cameras of these names; None where they are to be found.

    Raises:
        InputError: cameras that do not see the board, see too little of it, or are not in step.
    """
    _check_seen(names, detections, board)
    # The lenses, each from its own frames.
    given = None if known is None else known.select(tuple(names))
    lenses = [
        (given.K[k], given.distortion[k], 0.0, 0) if given else _solve_lens(names[k], sizes[k].tolist(), each, board)
        for k, each in enumerate(detections)
    ]
    K, distortion, focal_sigma, lens_frames = (np.array(each) for each in zip(*lenses, strict=True))
    # The places, from sharp frames that two cameras or more see.
    chosen = _common_frames(names, detections)
    seen = np.array([each.seen[chosen] for each in detections])
    pixels = np.array([each.pixels[chosen] for each in detections])
    R, t, residuals = _solve_places(pixels, seen, board, K, distortion)
    rms = np.array([np.sqrt((each**2).sum(axis=1).mean()) for each in residuals])
    worst = int(np.argmax(rms / sizes.max(axis=1)))
    if not rms[worst] < _MAX_RMS * sizes[worst].max():
        problem = f"the views of the board disagree by {rms[worst]:.1f} px, most in this camera"
        remedy = (
            "see that the cameras are in step (a scene has their offsets), that none moved, and that --board is right"
        )
        raise InputError(f"camera '{names[worst]}'", problem, remedy)
    return BoardCalibration(
        rig=CameraRig(tuple(names), K, R, t, np.asarray(sizes), distortion, "-y"),
        rms=rms,
        focal_sigma=focal_sigma,
        lens_frames=lens_frames,
        place_frames=seen.sum(axis=1),
        coverage=np.array([_coverage(each, size) for each, size in zip(detections, sizes, strict=True)]),
        points=tuple(view[np.isfinite(view[..., 0])] for view in pixels),
        residuals=tuple(residuals),
    )


def _check_seen(names: Sequence[str], detections: Sequence[Detections], board: Board) -> None:
    for name, each in zip(names, detections, strict=True):
        count = int(each.seen.sum())
        if count < _MIN_COMMON:
            problem = f"the board {board} is seen in {count} of {len(each.seen)} frames, at least {_MIN_COMMON} needed"
            remedy = "show the board to this camera, larger, sharper and in better light, or correct --board"
            if each.other is not None:
                problem, remedy = f"{problem}; {each.other}", "give --board as it was printed"
            raise InputError(f"camera '{name}'", problem, remedy)


def _solve_lens(
    name: str, size: list[int], detections: Detections, board: Board
) -> tuple[np.ndarray, np.ndarray, float, int]:
    """Intrinsics, distortion, the relative standard deviation of the focal length, and the number of frames."""
    chosen = _spread_frames(detections, np.array(size))
    if len(chosen) < _MIN_LENS_FRAMES:
        problem = f"{len(chosen)} frames show the board sharply, at least {_MIN_LENS_FRAMES} are needed for the lens"
        raise InputError(f"camera '{name}'", problem, "film the board for longer, or give the lenses with --known")
    views = [detections.pixels[frame] for frame in chosen]
    known = [np.isfinite(view[:, 0]) for view in views]
    on_board = [board.corners[each] for each in known]
    in_image = [view[each] for view, each in zip(views, known, strict=True)]
    # A third radial term is only used where the images need it: it takes part of the focal length's share else.
    plain, bent = (
        cv2.calibrateCameraExtended(on_board, in_image, size, None, None, flags=flags)  # type: ignore[call-overload]
        for flags in (cv2.CALIB_FIX_K3, 0)
    )
    answer = bent if bent[0] < _BENT * plain[0] else plain
    K, distortion, sigma = answer[1], answer[2].ravel()[:5], answer[5].ravel()
    share = float(sigma[:2].max() / K[0, 0])
    if not share < _MAX_FOCAL_SIGMA:
        problem = f"the board does not determine the focal length (known to {100 * share:.1f} %)"
        remedy = "hold the board close to this camera, tilted, in all parts of its image, or give --known"
        raise InputError(f"camera '{name}'", problem, remedy)
    return K, distortion, share, len(chosen)


def _spread_frames(detections: Detections, size: np.ndarray) -> list[int]:
    """Sharp frames, each as unlike those before as can be in the board's place, extent and tilt."""
    frames = np.flatnonzero(detections.sharp)
    features = np.array([_look(detections.pixels[frame], size) for frame in frames]).reshape(len(frames), -1)
    if not len(frames):
        return []
    chosen = [int(np.argmax(features[:, 2]))]  # the closest board first
    distance = np.full(len(frames), np.inf)
    while len(chosen) < min(_LENS_FRAMES, len(frames)):
        distance = np.minimum(distance, np.linalg.norm(features - features[chosen[-1]], axis=1))
        distance[chosen] = -1.0
        chosen.append(int(np.argmax(distance + 0.5 * features[:, 2])))
    return [int(frame) for frame in frames[chosen]]


def _look(pixels: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Where a board lies in the image, how large it is and how it is turned and tilted, as shares of the image."""
    seen = pixels[np.isfinite(pixels[:, 0])] / size.max()
    spread = np.cov(seen.T)
    return np.array([*seen.mean(axis=0), 2 * np.sqrt(np.trace(spread)), *(2 * np.sqrt(np.abs(spread[[0, 1], [0, 1]])))])


def _common_frames(names: Sequence[str], detections: Sequence[Detections]) -> np.ndarray:
    """Frames for the places: sharp ones which connect all cameras."""
    seen = np.array([each.seen for each in detections])
    sharp = seen & [each.sharp for each in detections]
    joint = (sharp.sum(axis=0) >= 2).nonzero()[0]
    # Cameras that share frames, directly or through others, with the first one.
    shared = (seen[:, None, joint] & seen[None, :, joint]).sum(axis=-1) >= _MIN_COMMON
    group = np.eye(len(names), dtype=bool)[0]
    for _ in names:
        group = group | shared[group].any(axis=0)
    if not group.all():
        name = names[int(np.flatnonzero(~group)[0])]
        problem = f"sees the board in fewer than {_MIN_COMMON} frames in common with '{names[0]}' and those beside it"
        remedy = "show the board to both at once, or give a scene whose offsets put the cameras in step"
        raise InputError(f"camera '{name}'", problem, remedy)
    if len(joint) <= _PLACE_FRAMES:
        return joint
    # Frames that most cameras see come first, with those of the camera that has fewest counted more.
    worth = (seen[:, joint] / seen[:, joint].sum(axis=1, keepdims=True)).sum(axis=0)
    return np.sort(joint[np.argsort(-worth, kind="stable")[:_PLACE_FRAMES]])


def _solve_places(
    pixels: np.ndarray, seen: np.ndarray, board: Board, K: np.ndarray, distortion: np.ndarray
) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
    """With the lenses held: R and t of each camera from the first, and by how much (corner, 2) it misses corners [px].

    All places are adjusted together, so that all corners are as near as can be to where they are seen.
    """
    from scipy.optimize import least_squares
    from scipy.sparse import coo_matrix

    cameras, frames = np.nonzero(seen)
    known = np.isfinite(pixels[cameras, frames, :, 0])
    first_cameras, first_boards = _first_places(pixels, seen, board, K, distortion)
    free = 6 * (len(K) - 1)

    def missed(x: np.ndarray) -> list[np.ndarray]:
        to_camera = _matrices(np.concatenate([first_cameras[:1], x[:free].reshape(-1, 6)]))[cameras]
        there = to_camera @ _matrices(x[free:].reshape(-1, 6))[frames]
        points = board.corners @ np.swapaxes(there[:, :3, :3], 1, 2) + there[:, None, :3, 3]
        off = []
        for k in range(len(K)):
            corners = points[cameras == k].reshape(-1, 3)
            image, _ = cv2.projectPoints(corners, np.zeros(3), np.zeros(3), K[k], distortion[k])
            off.append((pixels[k, seen[k]] - image.reshape(-1, len(board.corners), 2))[known[cameras == k]])
        return off

    def differences(x: np.ndarray) -> np.ndarray:
        return np.concatenate(missed(x)).ravel()

    # A difference depends on its camera, unless that is the first one, and on its board.
    view = np.repeat(np.arange(len(cameras)), 2 * known.sum(axis=1))
    of_camera = np.flatnonzero(cameras[view])
    row = np.concatenate([np.repeat(of_camera, 6), np.repeat(np.arange(len(view)), 6)])
    begin = np.concatenate([6 * (cameras[view][of_camera] - 1), free + 6 * frames[view]])
    column = (begin[:, None] + np.arange(6)).ravel()
    start = np.concatenate([first_cameras[1:].ravel(), first_boards.ravel()])
    depends = coo_matrix((np.ones(len(row)), (row, column)), (len(view), len(start)))
    x = least_squares(differences, start, jac_sparsity=depends, x_scale="jac", loss="soft_l1", max_nfev=_MAX_STEPS).x
    placed = _matrices(np.append(first_cameras[0], x[:free]).reshape(-1, 6))
    return placed[:, :3, :3], placed[:, :3, 3], missed(x)


def _first_places(
    pixels: np.ndarray, seen: np.ndarray, board: Board, K: np.ndarray, distortion: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Cameras (camera, 6) and boards (frame, 6) as rotation vectors and shifts, along pairs that share most frames."""
    # The board's place before each camera, by itself.
    alone = np.zeros((*seen.shape, 4, 4))
    for k, f in np.argwhere(seen):
        known = np.isfinite(pixels[k, f, :, 0])
        corners, image = board.corners[known], pixels[k, f, known].astype(float)
        _, turn, shift = cv2.solvePnP(corners, image, K[k], distortion[k], flags=cv2.SOLVEPNP_IPPE)
        alone[k, f] = _matrices(np.concatenate([turn, shift]).T)[0]
    # From camera to camera: of the answers of all frames the one that most others are near to.
    place, reached, shared = np.tile(np.eye(4), (len(K), 1, 1)), [0], seen.astype(int) @ seen.T
    while len(reached) < len(K):
        i, j = max(((i, j) for i in reached for j in range(len(K)) if j not in reached), key=lambda pair: shared[pair])
        both = seen[i] & seen[j]
        steps = (alone[j, both] @ np.linalg.inv(alone[i, both]))[:, :3]
        apart = np.linalg.norm((steps[:, None] - steps).reshape(len(steps), len(steps), 12), axis=2)
        place[j] = np.vstack([steps[np.argmin(np.median(apart, axis=1))], [0, 0, 0, 1]]) @ place[i]
        reached.append(j)
    first = seen.argmax(axis=0)  # the camera that places the board of a frame
    return _vectors(place), _vectors(np.linalg.inv(place[first]) @ alone[first, np.arange(len(first))])


def _matrices(vectors: np.ndarray) -> np.ndarray:
    """(n, 4, 4) of rotation vectors and shifts (n, 6)."""
    matrices = np.tile(np.eye(4), (len(vectors), 1, 1))
    matrices[:, :3, :3] = [cv2.Rodrigues(each[:3])[0] for each in vectors]
    matrices[:, :3, 3] = vectors[:, 3:]
    return matrices


def _vectors(matrices: np.ndarray) -> np.ndarray:
    """The inverse of :func:`_matrices`."""
    turns = [cv2.Rodrigues(each[:3, :3])[0][:, 0] for each in matrices]
    return np.concatenate([turns, matrices[:, :3, 3]], axis=1)


def _coverage(detections: Detections, size: np.ndarray) -> float:
    """The share of an image's 8x6 cells that hold a corner in any frame."""
    pixels = detections.pixels[np.isfinite(detections.pixels[..., 0])]
    cells = np.clip((pixels / size * [8, 6]).astype(int), 0, [7, 5])
    return len(np.unique(cells, axis=0)) / 48


def on_floor(found: BoardCalibration, detections: Sequence[Detections], board: Board, frame: int) -> CameraRig:
    """The cameras in the world of the board in a frame: first corner at zero, z up; an InputError if none sees it."""
    rig = found.rig
    counts = [int(np.isfinite(each.pixels[frame, :, 0]).sum()) for each in detections]
    k = int(np.argmax(counts))
    if not counts[k]:
        raise InputError(f"--floor {frame}", "no camera sees the board in that frame", "name a frame in which one does")
    known = np.isfinite(detections[k].pixels[frame, :, 0])
    in_image = detections[k].pixels[frame, known]
    _, turn, shift = cv2.solvePnP(board.corners[known], in_image, rig.K[k], rig.distortion[k])
    # The board's z points into the floor: turn it by half about x, so that z is up.
    to_camera = cv2.Rodrigues(turn)[0] @ np.diag([1.0, -1.0, -1.0])
    to_first, origin = rig.R[k].T @ to_camera, rig.R[k].T @ (shift.ravel() - rig.t[k])
    return replace(rig, R=rig.R @ to_first, t=rig.R @ origin + rig.t, up="+z")
