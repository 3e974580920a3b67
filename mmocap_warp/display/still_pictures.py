"""Pictures of cameras that were found, with the floor as a grid, and of a body, with its joints and their limits."""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from mmocap_warp.body.model import BodyModel
from mmocap_warp.body.rotations import turn
from mmocap_warp.body.skeleton import TRANSLATION
from mmocap_warp.cameras.rig import CameraRig, project
from mmocap_warp.display import overlay
from mmocap_warp.display.overlay import COLOUR_OF_SIDE, PAPER, SUBPIXEL_BITS, Colour, fixed_point, plain, write_text
from mmocap_warp.formats.image_files import write_png

# Of the picture of the floor:
_SQUARE = 0.5  # side of a square of the grid [m]
_AROUND = 0.75  # width of the floor around the person's way [m]
_PIECE = 0.05  # lines are drawn in pieces of this length, as far as they are seen [m]
_GRID: Colour = (150, 190, 90)
_WAY: Colour = (60, 60, 240)
_ROW_HEIGHT = 480  # height of a row of views [px]
# Of the picture of a body:
_HEIGHT, _WIDTH = 900, 1000  # size of a view, at most [px]
_MARGIN, _HEADER = 60, 30  # margin of a view, and height of the line above the views [px]
_VIEWS = {
    "front": ((1.0, 0, 0), (0, 1.0, 0)),
    "left": ((0, 0, -1.0), (0, 1.0, 0)),
    "above": ((-1.0, 0, 0), (0, 0, 1.0)),
}  # where the picture's right and its top lie in the body's axes
_MESH: Colour = (74, 66, 58)
_AXIS_COLOURS: dict[str, Colour] = {"x": (90, 90, 255), "y": (110, 220, 110), "z": (255, 150, 70)}
_AXIS, _ARC = 0.03, 0.045  # half an axis, and the radius of the arc of its limits, as shares of the extent
_BOTH_WAYS = np.array([[-1.0], [1.0]])
_WHOLE_TURN = np.pi  # a joint that may turn farther is drawn with a whole circle


def floor_picture(shown: Sequence[np.ndarray], rig: CameraRig, heads: np.ndarray, frame: int, title: str) -> np.ndarray:
    """The views of one frame side by side, BGR, with the floor, the person's way and the body's axis, below a title.

    Args:
        shown: per camera, undistorted BGR, of the rig's sizes.
        rig: undistorted pinholes; the floor is at zero along ``up``.
        heads: (frame, 3), the top of the person's head [m]; NaN where not known. They show that of ``frame``.
    """
    # The floor's grid, the way over it, and the body's axis.
    up, head = rig.up_vector, heads[frame]
    known = heads[np.isfinite(heads[:, 0])]
    feet = known - (known @ up)[:, None] * up
    lines = [(*ends, _GRID, 1) for ends in _grid(feet, up)] + [(*ends, _WAY, 2) for ends in pairwise(feet)]
    if np.isfinite(head[0]):
        lines.append((head - (head @ up) * up, head, overlay.MODEL_COLOUR, 2))
    views = []
    for k, image in enumerate(shown):
        canvas = image.copy()
        camera = rig.select((rig.names[k],))
        for start, end, colour, thickness in lines:
            pieces = max(2, int(np.ceil(np.linalg.norm(end - start) / _PIECE)) + 1)
            for ends in map(np.array, pairwise(project(camera, np.linspace(start, end, pieces))[0])):
                if np.isfinite(ends).all() and np.abs(ends).max() < 1e5:
                    (x, y), (to_x, to_y) = np.rint(ends).astype(int).tolist()
                    cv2.line(canvas, (x, y), (to_x, to_y), colour, thickness, cv2.LINE_AA)
        width = max(1, round(image.shape[1] * _ROW_HEIGHT / image.shape[0]))
        views.append(cv2.resize(canvas, (width, _ROW_HEIGHT), interpolation=cv2.INTER_AREA))
        write_text(views[-1], rig.names[k], (8, 8))
    columns = int(np.ceil(np.sqrt(len(views))))
    rows = [np.concatenate(views[at : at + columns], axis=1) for at in range(0, len(views), columns)]
    width = max(row.shape[1] for row in rows)
    banner = plain(32, width)
    write_text(banner, title, (8, 6))
    return np.concatenate([banner, *[np.pad(row, ((0, 0), (0, width - row.shape[1]), (0, 0))) for row in rows]])


def _grid(feet: np.ndarray, up: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Ends of the lines of a grid on the floor around places (n, 3) on it."""
    a, b = (axis for axis in np.eye(3) if not np.any(axis[np.abs(up) > 0]))
    low = [np.floor(((feet @ axis).min() - _AROUND) / _SQUARE) for axis in (a, b)]
    high = [np.ceil(((feet @ axis).max() + _AROUND) / _SQUARE) for axis in (a, b)]
    x, y = (np.arange(first, last + 1) * _SQUARE for first, last in zip(low, high, strict=True))
    lines = [(a * each + b * y[0], a * each + b * y[-1]) for each in x]
    return lines + [(b * each + a * x[0], b * each + a * x[-1]) for each in y]


def draw_body(body: BodyModel, file: str | Path) -> None:
    """Draw a body in its bind pose from the front, from its left and from above.

    Each searched angle is a line along its axis, and an arc from its lowest to its highest value; what slides has a
    line from its lowest to its highest place.
    """
    points = np.concatenate([body.tracking.rest.astype(float), body.joint_rest, *_slides(body).values()])
    low, high = points.min(axis=0), points.max(axis=0)
    views = [_view(body, name, low, high) for name in _VIEWS]
    tall = max(map(len, views))
    edges = [((_HEADER, tall - len(view)), (0, 0), (0, 0)) for view in views]  # the paper is gray
    canvas = np.hstack([np.pad(view, edge, constant_values=PAPER[0]) for view, edge in zip(views, edges, strict=True)])
    skeleton, size = body.skeleton, high - low
    text = f"{body.name}   {size[0]:.3g} x {size[1]:.3g} x {size[2]:.3g} m   {len(skeleton.joints)} joints   "
    end = write_text(canvas, f"{text}{len(skeleton.searched())} degrees of freedom", (8, 9))
    moves = "turns about, slides along" if skeleton.sliding else "turns about"
    legend = {f"{moves} {axis}": colour for axis, colour in _AXIS_COLOURS.items()}
    for label, colour in {**legend, **COLOUR_OF_SIDE}.items():
        end = write_text(canvas, label, (end + 18, 9), colour)
    write_png(file, canvas)


class _Sheet:
    """One view: an image, and where points of the body lie in it; it shows the box from ``low`` to ``high`` (3,)."""

    def __init__(self, name: str, low: np.ndarray, high: np.ndarray) -> None:
        self.axes = np.array(_VIEWS[name])
        corners = np.stack([low, high]) @ self.axes.T
        self._low, extent = corners.min(axis=0), np.ptp(corners, axis=0)
        room = np.array([_WIDTH, _HEIGHT]) - 2 * _MARGIN
        self.scale = float((room / np.maximum(extent, 1e-9)).min())
        width, height = (np.ceil(self.scale * extent) + 2 * _MARGIN).astype(int)
        self.image = plain(height, width)

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """(n, 2) of points (n, 3)."""
        across, up = ((points @ self.axes.T - self._low) * self.scale + _MARGIN).T
        return np.stack([across, self.image.shape[0] - up], axis=1)

    def line(self, points: np.ndarray, colour: Colour, width: int = 1) -> None:
        """A line through points (n, 3)."""
        cv2.polylines(self.image, [fixed_point(self.pixels(points))], False, colour, width, cv2.LINE_AA, SUBPIXEL_BITS)

    def dot(self, point: np.ndarray, colour: Colour) -> None:
        """A dot at a point (3,)."""
        (centre,) = fixed_point(self.pixels(point[None])).tolist()
        cv2.circle(self.image, centre, 3 << SUBPIXEL_BITS, colour, -1, cv2.LINE_AA, SUBPIXEL_BITS)


def _view(body: BodyModel, name: str, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    sheet, skeleton = _Sheet(name, low, high), body.skeleton
    corner = sheet.pixels(body.tracking.rest.astype(float))[body.tracking_face]
    cv2.polylines(sheet.image, list(fixed_point(corner)), True, _MESH, 1, cv2.LINE_AA, SUBPIXEL_BITS)
    place = body.joint_rest.astype(float)
    for parent, joint in skeleton.bones:
        sheet.line(place[[parent, joint]], COLOUR_OF_SIDE[skeleton.side(skeleton.joints[joint])], 2)
    extent = float((high - low).max())
    for coordinate in skeleton.searched():
        joint, axis = divmod(int(coordinate) - 3, 3)
        if joint > 0 and not skeleton.slides[joint]:
            _draw_freedom(sheet, body, joint, axis, extent)
    # A slide is a line from the lowest place to the highest, with strokes across either end.
    for (joint, axis), ends in _slides(body).items():
        sheet.line(ends, _AXIS_COLOURS["xyz"[axis]], 2)
        for end in ends:
            for across in np.delete(skeleton.frame[joint].astype(float), axis, axis=1).T:
                sheet.line(end + _AXIS / 2 * extent * _BOTH_WAYS * across, _AXIS_COLOURS["xyz"[axis]])
    for joint, side in enumerate(map(skeleton.side, skeleton.joints)):
        sheet.dot(place[joint], COLOUR_OF_SIDE[side])
    _write_names(sheet, skeleton.joints, place)
    write_text(sheet.image, name, (8, 8))
    return sheet.image


def _draw_freedom(sheet: _Sheet, body: BodyModel, joint: int, axis: int, extent: float) -> None:
    """The axis, and an arc around it from the lowest angle to the highest, with a spoke where the bind pose is."""
    frame, centre = body.skeleton.frame[joint].astype(float), body.joint_rest[joint].astype(float)
    colour, along = _AXIS_COLOURS["xyz"[axis]], frame[:, axis]
    sheet.line(centre + _AXIS * extent * _BOTH_WAYS * along, colour, 2)
    low, high = np.clip(body.skeleton.limits[joint, axis].astype(float), -_WHOLE_TURN, _WHOLE_TURN)
    spoke = frame[:, 1 if axis != 1 else 2]  # y runs along the bone
    arc = turn("z", np.linspace(low, high, 25))[:, :, 0] @ np.stack([spoke, np.cross(along, spoke), along])
    sheet.line(centre + _ARC * extent * arc, colour)
    for end in (arc[0], arc[-1]):
        sheet.line(np.stack([centre, centre + _ARC * extent * end]), colour)


def _slides(body: BodyModel) -> dict[tuple[int, int], np.ndarray]:
    """The lowest and the highest place (2, 3) of each searched slide that has limits, by joint and axis."""
    skeleton, ends = body.skeleton, {}
    for coordinate in skeleton.searched_shifts():
        joint, axis = divmod(int(coordinate) - TRANSLATION, 3)
        limits = skeleton.limits[joint, axis].astype(float)
        if np.isfinite(limits).all():
            ends[joint, axis] = body.joint_rest[joint] + limits[:, None] * skeleton.frame[joint, :, axis].astype(float)
    return ends


def _write_names(sheet: _Sheet, names: tuple[str, ...], place: np.ndarray) -> None:
    """Each joint's name beside it, below the names that would be under it."""
    taken: list[tuple[float, float, float]] = []
    for name, (x, y) in sorted(zip(names, sheet.pixels(place).tolist(), strict=True), key=lambda one: one[1][1]):
        (width, height), _ = cv2.getTextSize(name, cv2.FONT_HERSHEY_SIMPLEX, 0.33, 1)
        left, top = min(x + 7, sheet.image.shape[1] - width - 4), y - 4
        while any(abs(top - other) < height + 3 and left < end and start < left + width for start, end, other in taken):
            top += height + 3
        taken.append((left, left + width, top))
        corner = round(left), round(min(top, sheet.image.shape[0] - 12.0)) + height
        cv2.putText(sheet.image, name, corner, cv2.FONT_HERSHEY_SIMPLEX, 0.33, overlay.INK, 1, cv2.LINE_AA)
