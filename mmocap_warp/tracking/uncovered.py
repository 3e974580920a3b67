"""Mask area that no body explains, by body part: where a limb is that was lost before the trunk or folded away.

An overlap hardly notices a forearm, and no outline of the body tells of mask that the body does not cover. Area counts
here if it is deep, if the other views' masks agree that something is there, and if two views show it: what one view
alone shows may be a fault of its mask, unless it is as large as a hand. Views that show more than limbs beside the
body, somebody who passes by or a chest, do not count.
"""

from dataclasses import dataclass

import numpy as np
import warp as wp

from mmocap_warp.body.model import SkinMesh, Subject
from mmocap_warp.body.posing import make_body_arrays, make_joint_arrays
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.device.transfers import Download, Replays, Upload
from mmocap_warp.kernels.block import batch_of
from mmocap_warp.kernels.body.skinning import pose_vertices
from mmocap_warp.kernels.launching import Recordings
from mmocap_warp.kernels.silhouettes.beside import LANES, MOST_LOOKS, Look, Sight, find_cells, follow_rays, place_points
from mmocap_warp.kernels.structs import allocated
from mmocap_warp.masks.observation import Observation, words_per_row

_CELL = 0.02  # pixels are looked at that are so far apart at the body [m]
_SPACING = 0.1  # points of the skin are at most so far apart: then none of it is deep [m]
_SAME_PLACE = 1e-4  # points that are nearer to each other are one [m]
_DEEP = 0.06  # mask farther than this from every such point is uncovered [m]
_FAR = 0.5  # what is farther than this from the body is no limb of it [m]
_REACH = 1.2  # rays are followed so far before and behind the body's middle [m]
_STEP = 0.03  # between the points of a ray [m]
_MOST_RAYS = 48  # rays that are followed of a view
_LEAST_AREA = 0.002  # less than that beside a body is noise of a mask [m^2]
_LEAST_VIEWS = 4  # so many other views must be there for one of them to be allowed to disagree
_FAULT_AREA = 0.003  # what one view alone shows counts where it is more than that: a mask may have such faults [m^2]
_MOST_AREA = 0.12  # a view that leaves more than that uncovered shows somebody or something else [m^2]
_SHADOW_HEIGHT = 0.08  # what is so near to the height of the body's lowest point may be its shadow on the floor [m]

_LOOK_INTERVAL = 0.1  # seconds between the frames that are looked at for limbs that were lost
_JUDGE_INTERVAL = 1 / 30  # seconds between the frames whose final poses are judged
_CLEAR_AREA = 0.01  # area above the usual that says by itself that a limb is lost [m^2], in a body like a person
_REPEATED_AREA = 0.006  # the same, where two looks in a row show so much [m^2]
LASTING_AREA = 0.002  # the same, where two looks for lost limbs show the area [m^2], in a body as large as a person
_FINAL_LASTING_AREA = 0.003  # the same, in the median of final looks: a torso that fits badly shows 0.0025 [m^2]
LARGEST_USUAL_AREA = 0.01  # more near a part is never usual [m^2]: it may be a limb that is wrong in all frames
_USUAL_SHARE = 0.2  # of all looks at a clip, those that show less uncovered area than usual
_LASTING = 0.2  # seconds before and after a look, in the median of which area has to last
_AROUND = 0.2  # seconds within which a limb is in doubt before and after it stands out
_MOST_DOUBTFUL = 0.75  # share of the looks that a lost limb may stand out in
_LEAST_LOOKS = 10  # that this share is taken of
_BLAMED_SHARE = 0.3  # of the area, what is near a part that is in doubt


@dataclass(frozen=True, eq=False)
class Uncovered:
    """What one frame's masks show beside a body."""

    area: np.ndarray  # (part,) near each part, in the view that decides [m^2]
    place: np.ndarray  # (n, 3) where it is, about the middle of what the masks leave open [m]


def look_interval(rate: float, *, final: bool = False) -> int:
    """Frames from one that is looked at to the next, for limbs that were lost or to judge final poses."""
    return max(1, int((_JUDGE_INTERVAL if final else _LOOK_INTERVAL) * rate))


class UncoveredArea:
    """Finds mask area that a posed body does not cover, in undistorted cameras at the masks' size."""

    def __init__(self, subject: Subject, rig: CameraRig, device: str = "cpu") -> None:
        body, mesh, size = subject.body, subject.body.tracking, subject.body.relative_size
        corner, share = _points_of_faces(mesh, _SPACING * size)
        part = np.array(body.skeleton.part)[mesh.heaviest_joint]
        self._near_part = np.concatenate([part, part[corner[:, 0]]])[::4]  # rays look for every fourth point
        self._parts, self._size, self._cameras, self._up = len(body.skeleton.parts), size, len(rig), rig.up_vector
        vertices, points, pixels = len(mesh.rest), len(mesh.rest) + len(corner), int(rig.size.prod(axis=1).max())
        # The body, posed.
        self._body = make_body_arrays(body, subject.root_base, mesh, device)
        self._joints = make_joint_arrays(1, len(body.joint_rest), device)
        self._vertex = wp.array(np.arange(vertices), dtype=wp.int32, device=device)
        self._batch = batch_of(0, 1, 1, device)
        # What the views see, and what is found there.
        back, turn = np.swapaxes(rig.R, 1, 2), rig.K @ rig.R
        width, height = rig.size.max(axis=0).tolist()
        words = (len(rig), height, words_per_row(width))
        self._sight = sight = allocated(
            Sight, device, word=words, possible=words, shows=len(rig), size=rig.size.astype(np.int32), turn=turn,
            shift=np.einsum("kij,kj->ki", rig.K, rig.t), focal=rig.K[:, 0, 0].copy(),
            origin=-np.einsum("kij,kj->ki", back, rig.t), into_world=back @ np.linalg.inv(rig.K),
        )  # fmt: skip
        by_view = dict.fromkeys(("depth", "scale", "step", "radius", "count"), len(rig))
        by_ray = dict.fromkeys(("place", "nearest", "apart"), (len(rig), _MOST_RAYS))
        self._look = look = allocated(
            Look, device, posed=(1, vertices), corner=corner.astype(np.int32), share=share,
            cell=_CELL * size, deep=_DEEP * size, least=_LEAST_AREA * size**2, most=_MOST_AREA * size**2,
            reach=_REACH * size, stride=_STEP * size, point=points, pixel=(len(rig), points), partial=LANES,
            number=1, mark=(len(rig), pixels), in_row=(len(rig), height), **by_view, **by_ray,
        )  # fmt: skip
        self._pose = pose = wp.zeros((1, body.skeleton.coordinates), dtype=wp.float32, device=device)
        self._masks = [Upload(array) for array in (sight.word, sight.possible, sight.shows)]
        self._posed = Upload(pose)
        self._answers = Download([look.scale, look.step, look.count, look.place, look.nearest, look.apart])
        self._device, self._replays, self._recordings = device, Replays(device), Recordings()
        self._seen: Observation | None = None
        self._looks = 0

    def observe(self, observation: Observation) -> None:
        """Take a frame's masks, unless they were taken last."""
        if observation is not self._seen:
            shows = observation.foreground > 0
            for upload, values in zip(self._masks, (observation.words, observation.possible, shows), strict=True):
                upload.values[...] = values
                upload.send(self._cameras)
            self._seen = observation

    def of(self, poses: np.ndarray, observation: Observation, *, shadows: bool = True) -> list[Uncovered]:
        """The area beside poses (n, coordinate), each by itself; without ``shadows``, what may be one is left out."""
        self.observe(observation)
        return [self._beside(pose, shadows) for pose in poses]

    def _beside(self, pose: np.ndarray, shadows: bool) -> Uncovered:
        """The area beside a pose (coordinate,)."""
        if self._looks == MOST_LOOKS:
            self._look.mark.zero_()
            self._look.number.zero_()
            self._looks = 0
        self._looks += 1
        self._posed.values[0] = pose
        self._replays.run("look", lambda: self._recordings.run("look", self._device, self._launch))
        scale, step, count, *of_rays = self._answers.read(self._cameras)
        pixel = (step / np.where(step > 0, scale, np.inf)) ** 2  # the area of a cell [m^2]
        counts = np.flatnonzero((step > 0) & (count * pixel <= _MOST_AREA * self._size**2)).tolist()
        # The floor is taken to be where the body is lowest. A shadow lies there, and all views agree on it.
        floor = np.nan if shadows else (self._look.posed.numpy()[0] @ self._up).min()

        # What is beside the body in each view, as far as the other views agree, near the body. Views with less than the
        # two that show most do not decide.
        area: list[np.ndarray] = [np.zeros(self._parts)] * 2  # the view with most of it first
        places = [np.empty((0, 3))]
        for k in sorted(counts, key=lambda view: -count[view] * pixel[view]):
            if count[k] * pixel[k] < max(_LEAST_AREA * self._size**2, area[1].sum()):
                break
            every = -(-count[k] // _MOST_RAYS)
            place, nearest, apart = (values[k, : -(-count[k] // every)] for values in of_rays)
            near = (nearest >= 0) & (apart < (_FAR * self._size) ** 2)
            near &= ~(np.abs(place @ self._up - floor) <= _SHADOW_HEIGHT * self._size)
            part = self._near_part[nearest[near]]
            if not len(part):
                continue
            of_view = np.bincount(part, np.full(len(part), every * pixel[k]), self._parts)
            area = sorted([*area, of_view], key=lambda each: -each.sum())[:2]
            places.append(place[near])
        # The view with the second most area decides, or that with the most, less what may be a fault of its mask.
        most, second = (each.sum() for each in area)
        alone = max(most - _FAULT_AREA * self._size**2, 0.0)
        return Uncovered(area[0] * (alone / most) if alone > second else area[1], np.concatenate(places))

    def _launch(self) -> None:
        """All launches of a look, and what is found on its way to the host."""
        self._posed.send(1)
        pose_vertices(self._body, self._pose, self._vertex, self._batch, self._joints, self._look.posed)
        place_points(self._sight, self._look)
        find_cells(self._sight, self._look)
        follow_rays(self._sight, self._look, _LEAST_VIEWS)
        self._answers.fetch(self._cameras)


def parts_in_doubt(
    size: float, rate: float, looked: np.ndarray, area: np.ndarray, frames: int, *, may_lack: bool = True
) -> np.ndarray:
    """(frame, part) bool: parts near mask area that nothing explains, for a moment in plenty or for a while.

    The area (look, part) [m^2] was uncovered in the frames ``looked`` at, their positions (look,) ascending. ``size``
    is the body's as a share of a person's, and ``rate`` in frames a second. What nearly all looks show is no
    doubt if the body ``may_lack`` something.
    """
    # More area than usual, at once, in two looks in a row, or for some time.
    usual = np.minimum(np.quantile(area, _USUAL_SHARE, axis=0), LARGEST_USUAL_AREA * size**2)
    excess = np.maximum(area - usual, 0.0)
    total = excess.sum(axis=1)
    beside = np.pad(total, 1)
    repeated = np.minimum(total, np.maximum(beside[:-2], beside[2:]))
    first, last = np.searchsorted(looked, [looked - _LASTING * rate - 0.5, looked + _LASTING * rate + 0.5])
    around = [slice(*ends) for ends in zip(first, last, strict=True)]
    lasting = np.array([np.median(total[looks]) for looks in around])
    doubtful = stands_out(size, total, repeated, lasting, _FINAL_LASTING_AREA)
    if may_lack and is_usual((total > LASTING_AREA * size**2).sum(), len(looked)):
        return np.zeros((frames, area.shape[1]), bool)
    # It is put down to the parts that most of it is near, over the looks around.
    near = np.stack([excess[looks].sum(axis=0) for looks in around])
    blamed = (near >= _BLAMED_SHARE * near.sum(axis=1, keepdims=True)) & doubtful[:, None]
    # A limb is lost before it stands out, and back after it did: the frames before and after are in doubt, too.
    doubt, after = np.zeros((frames, area.shape[1]), bool), max(1, round(_AROUND * rate))
    for frame, parts in zip(looked, blamed, strict=True):
        doubt[max(0, frame - after + 1) : frame + after] |= parts
    return doubt


def stands_out(
    size: float, area: np.ndarray, repeated: np.ndarray, lasting: np.ndarray, least_lasting: float = LASTING_AREA
) -> np.ndarray:
    """Whether uncovered areas above the usual say that a limb is lost: of a look, of two in a row, and lasting ones.

    A lasting area counts above ``least_lasting`` [m^2], in a body as large as a person.
    """
    large = (area > _CLEAR_AREA * size**2) | (repeated > _REPEATED_AREA * size**2)
    return np.asarray(large | (lasting > least_lasting * size**2))


def is_usual(standing_out: np.ndarray, looks: np.ndarray | int) -> np.ndarray:
    """Whether so many of the looks show no lost limb, but something that the body lacks: a skirt, a bag, a stick."""
    return np.asarray((standing_out > _MOST_DOUBTFUL * looks) & (looks >= _LEAST_LOOKS))


def _points_of_faces(mesh: SkinMesh, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Points on triangles that are larger than a spacing [m]: their corners (n, 3), and the share of each (n, 3)."""
    corners = mesh.rest[mesh.face]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    divisions = np.ceil(longest / spacing).astype(int)
    corner, share = [np.empty((0, 3), int)], [np.empty((0, 3))]
    for n in np.unique(divisions[divisions > 1]):
        i, j = (axis.ravel() for axis in np.mgrid[: n + 1, : n + 1])
        grid = np.stack([i, j, n - i - j], axis=1)[i + j <= n] / n
        faces = mesh.face[divisions == n]
        corner.append(np.repeat(faces, len(grid), axis=0))
        share.append(np.tile(grid, (len(faces), 1)))
    corners_of, share_of = np.concatenate(corner), np.concatenate(share)
    # Corners are vertices, and faces have their edges' points in common.
    own = (share_of > 0).sum(axis=1) > 1
    place = np.einsum("nc,ncx->nx", share_of[own], mesh.rest[corners_of[own]])
    first = np.sort(np.unique(np.round(place / _SAME_PLACE), axis=0, return_index=True)[1])
    return corners_of[own][first], share_of[own][first]
