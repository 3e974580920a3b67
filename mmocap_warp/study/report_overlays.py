"""The paper's Fig. 8 and 9: the tracked body over what a camera saw, as drawings that follow the page's colours."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import islice

import cv2
import numpy as np

from mmocap_warp.body.model import BodyModel, Subject
from mmocap_warp.body.posing import Poser
from mmocap_warp.cameras.rig import CameraRig, project
from mmocap_warp.cameras.silhouette import intersection_over_union, silhouette
from mmocap_warp.display.chart import figure, outline, polyline
from mmocap_warp.display.overlay import Window
from mmocap_warp.masks.observation import Observation, unpack_masks
from mmocap_warp.study.baselines import is_of
from mmocap_warp.study.source import Clip, open_clip
from mmocap_warp.study.study_tables import Ranking
from mmocap_warp.study.summary import CellSummary, Contender, Measure, StudySummary

_SIZE = (360, 480)
_MARGIN = 1.12  # size of the window over that of what is drawn
_SMOOTHING = 0.8  # how far a simplified outline may be off [units of the drawing]
_SETTLED = 0.1  # share of a sequence that is left out of the search for extreme frames: it starts from a given pose


@dataclass(frozen=True)
class Picture:
    """A frame of a cell's typical run, drawn."""

    sequence: str
    algorithm: str
    frame: int
    camera: str  # the view's
    error: float  # the main measure in that frame
    drawing: str  # an ``svg`` element


@dataclass(frozen=True)
class Recording:
    """What pictures of a sequence are drawn from."""

    subject: Subject  # the tracked body
    rig: CameraRig  # the cameras of the masks
    seen: Mapping[int, Observation]  # masks by frame number


def open_recording(clip: Clip, frames: Iterable[int]) -> Recording:
    """A sequence with the masks of some frames; an InputError if there is no such sequence here."""
    from mmocap_warp.study.sequences import SEQUENCES

    wanted = set(frames)
    if clip.scene is None and clip.name in SEQUENCES:
        sequence = SEQUENCES[clip.name]
        seen = {frame: sequence.observation(frame) for frame in wanted if frame < sequence.frame_count}
        return Recording(sequence.subject, sequence.rig, seen)
    source = open_clip(clip)
    in_order = enumerate(islice(source.observations, max(wanted, default=-1) + 1))
    return Recording(source.subject, source.rig, {frame: seen for frame, seen in in_order if frame in wanted})


def extreme_frames(cell: CellSummary, measure: Measure) -> tuple[int, int]:
    """Positions of the best and the worst frame of a cell's typical run, once tracking has settled."""
    start = int(len(cell.typical_curve) * _SETTLED)
    settled = measure.sign * cell.typical_curve[start:]
    if not np.isfinite(settled).any():
        return start, start
    return start + int(np.nanargmin(settled)), start + int(np.nanargmax(settled))


def best_and_worst(
    study: StudySummary, measure: Measure, ranking: Ranking, clips: Mapping[str, Clip]
) -> Iterator[tuple[Picture, Picture]]:
    """The control's best and worst frame of each sequence whose recording is at hand."""
    for sequence, cell in study.known(ranking.rows[0].contender, ranking.sequences, measure).items():
        if sequence in clips:
            places = extreme_frames(cell, measure)
            recording = open_recording(clips[sequence], [int(cell.frames[place]) for place in places])
            if is_of(cell, clips[sequence], recording.subject, recording.rig):
                best, worst = (_picture(recording, cell, place) for place in places)
                if best is not None and worst is not None:
                    yield best, worst


def side_by_side(study: StudySummary, sequence: str, dof: int, budget: int, clip: Clip) -> list[list[Picture]]:
    """All algorithms at the same three frames in the same view: a list per algorithm; empty ones are left out."""
    cells = [cell for name in study.algorithms if (cell := study.find(sequence, Contender(name, dof, budget)))]
    if not cells:
        return []
    places = [int(min(len(cell.frames) for cell in cells) * share) for share in (0.3, 0.6, 0.9)]
    recording = open_recording(clip, [int(cells[0].frames[place]) for place in places])
    if not is_of(cells[0], clip, recording.subject, recording.rig):
        return []
    fullest = {number: int(np.argmax(seen.foreground)) for number, seen in recording.seen.items()}
    rows = ([_picture(recording, cell, at, fullest.get(int(cell.frames[at]))) for at in places] for cell in cells)
    drawn = ([picture for picture in row if picture is not None] for row in rows)
    return [row for row in drawn if row]


def _picture(recording: Recording, cell: CellSummary, place: int, camera: int | None = None) -> Picture | None:
    """A frame in one view: the one named, or else that in which body and mask agree least. None without masks."""
    frame = int(cell.frames[place])
    if frame not in recording.seen:
        return None
    sizes = [(int(width), int(height)) for width, height in recording.rig.size]
    masks = unpack_masks(recording.seen[frame].words, recording.rig.size)
    body, poser = recording.subject.body, Poser(recording.subject.body, recording.subject.root_base)
    vertices = project(recording.rig, poser.tracking_vertices(cell.typical_pose[place])[0])
    joints = project(recording.rig, poser.joint_transforms(cell.typical_pose[place])[0, :, :3, 3])
    if camera is None:
        models = [silhouette(vertices[k], body.tracking_face, size) > 0 for k, size in enumerate(sizes)]
        # A view that was not judged is no worse than any other.
        pairs = zip(masks, models, strict=True)
        camera = int(np.argmin([intersection_over_union(*pair) if pair[0].any() else 2.0 for pair in pairs]))
    drawing = _draw(masks[camera], vertices[camera], joints[camera], body, sizes[camera])
    name, error = recording.rig.names[camera], float(cell.typical_curve[place])
    return Picture(cell.cell.sequence, cell.cell.algorithm, frame, name, error, drawing)


def _draw(mask: np.ndarray, vertices: np.ndarray, joints: np.ndarray, body: BodyModel, size: tuple[int, int]) -> str:
    window = _window(mask, vertices, size)
    # The part of the mask in the window, with background where the window reaches beyond the image.
    (left, top), (width, height) = window.corner, window.extent
    part = np.zeros((height, width), np.uint8)
    inside = mask[max(top, 0) : top + height, max(left, 0) : left + width]
    part[max(-top, 0) :, max(-left, 0) :][: inside.shape[0], : inside.shape[1]] = inside * 255
    seen = cv2.resize(part, _SIZE, interpolation=cv2.INTER_LINEAR) > 127
    model = silhouette(window.points(vertices), body.tracking_face, _SIZE) > 0
    paths = {"seen": outline(_contours(seen)), "model": outline(_contours(model))}
    bones, skeleton = window.points(joints), body.skeleton
    for joint, parent in enumerate(skeleton.parent):
        if parent >= 0:
            side, ends = skeleton.side(skeleton.joints[joint]), bones[[parent, joint]]
            paths[f"bone {side}"] = paths.get(f"bone {side}", "") + polyline(*ends.T)
    order = ("seen", "model", "bone left", "bone right", "bone middle")
    return figure(_SIZE, "tracked body over the mask", [f'<path class="{k}" d="{paths.get(k, "")}"/>' for k in order])


def _window(mask: np.ndarray, vertices: np.ndarray, size: tuple[int, int]) -> Window:
    """Around mask and body, in the drawing's proportions; it may reach beyond the image."""
    inside = vertices[np.isfinite(vertices).all(axis=1)]
    rows, columns = np.nonzero(mask)
    points = np.concatenate([np.clip(inside, 0, size), np.stack([columns, rows], axis=1)])
    low, high = (points.min(axis=0), points.max(axis=0)) if len(points) else (np.zeros(2), np.array(size))
    unit = max((high - low) / _SIZE) * _MARGIN
    extent = np.maximum(np.rint(np.array(_SIZE) * unit), 8).astype(int)
    corner = np.rint((low + high - extent) / 2).astype(int)
    return Window((int(corner[0]), int(corner[1])), (int(extent[0]), int(extent[1])), _SIZE)


def _contours(filled: np.ndarray) -> list[np.ndarray]:
    found, _ = cv2.findContours(filled.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    smooth = (cv2.approxPolyDP(contour, _SMOOTHING, True)[:, 0] for contour in found)
    return [contour for contour in smooth if len(contour) > 2]
