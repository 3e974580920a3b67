"""Drawing a posed body over what a camera saw: skin, contours and skeleton, as in the paper's Fig. 8-9."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from mmocap_warp.body.model import BodyModel
from mmocap_warp.body.skeleton import Skeleton
from mmocap_warp.cameras.silhouette import silhouette
from mmocap_warp.display.chart import COLOURS

Colour = tuple[int, int, int]


def _on_black(name: str) -> Colour:
    """Blue, green, red of a colour, as OpenCV orders them."""
    red, green, blue = bytes.fromhex(COLOURS[name][1][1:])
    return blue, green, red


MASK_COLOUR, MODEL_COLOUR = _on_black("mask"), _on_black("model")
LEFT_COLOUR, RIGHT_COLOUR = _on_black("left"), _on_black("right")
SIGMA_COLOUR = _on_black("deviations")  # of no limb: an ellipse is often smaller than the joint's dot that it lies on
COLOUR_OF_SIDE = {"left": LEFT_COLOUR, "right": RIGHT_COLOUR, "middle": _on_black("middle")}
INK: Colour = (235, 235, 235)
PAPER: Colour = (28, 28, 28)
_SEEN: Colour = (105, 105, 105)  # foreground where there is no image
_TINT = 0.35  # share of the skin's colour over the image
ELLIPSE = 10
"""Standard deviations from a joint to the rim of its ellipse: one or two are less than a pixel in most recordings."""
_NAME_HEIGHT = 20  # of a person's name over the body, with the room around it [px]
_PLATE = 0.6  # share of the plate's colour behind text
SUBPIXEL_BITS = 4  # binary digits after the point of OpenCV's coordinates


def legend(alone: bool, ellipses: bool) -> dict[str, Colour]:
    """What colours mean where one person is drawn ``alone``, or else several, whose names have their colours."""
    one = {"mask": MASK_COLOUR, "model": MODEL_COLOUR, "left": LEFT_COLOUR, "right": RIGHT_COLOUR}
    return (one if alone else {"mask": INK}) | ({f"ellipse: {ELLIPSE} sigma": SIGMA_COLOUR} if ellipses else {})


@dataclass(frozen=True)
class Window:
    """A part of a camera's image, drawn at another size."""

    corner: tuple[int, int]  # left and top pixel of the part
    extent: tuple[int, int]  # its width and height [px]
    size: tuple[int, int]  # width and height of the drawing [px]

    def points(self, pixels: np.ndarray) -> np.ndarray:
        """Where image points (n, 2) lie in the drawing; pixel centres are at integers in both."""
        return (pixels - self.corner + 0.5) * np.divide(self.size, self.extent) - 0.5

    def picture(self, image: np.ndarray, image_size: tuple[int, int], interpolation: int) -> np.ndarray:
        """The part of an image, resized; the image may have another resolution than the camera's ``image_size``."""
        ratio = np.divide((image.shape[1], image.shape[0]), image_size)
        left, top = np.rint(np.multiply(self.corner, ratio)).astype(int)
        right, bottom = np.rint(np.add(self.corner, self.extent) * ratio).astype(int)
        return cv2.resize(image[top:bottom, left:right], self.size, interpolation=interpolation)


@dataclass(frozen=True)
class Look:
    """How one of several people is told from the others."""

    name: str
    colour: Colour  # of skin, outline, skeleton and name; masks are outlined in ``INK``


@dataclass(frozen=True)
class ViewedBody:
    """A posed body in one camera's pixels."""

    body: BodyModel
    mask: np.ndarray | None  # bool, of the view at any resolution
    vertices: np.ndarray  # (vertex, 2), the projected tracking mesh [px]
    joints: np.ndarray  # (joint, 2), projected joint centres [px]
    spread: np.ndarray | None = None  # (joint, 2, 2), covariances of their places [px^2], drawn as ellipses
    look: Look | None = None  # None where it is the only one
    depth: float = 0.0  # of its root before the camera [m]


def plain(height: int, width: int, colour: Colour = PAPER) -> np.ndarray:
    """A picture of one colour, BGR, which OpenCV makes far sooner than NumPy."""
    return cv2.rectangle(np.empty((height, width, 3), np.uint8), (0, 0), (width, height), colour, cv2.FILLED)


def draw_view(
    window: Window, image_size: tuple[int, int], image: np.ndarray | None, bodies: Sequence[ViewedBody]
) -> np.ndarray:
    """Draw bodies over one camera's image, or over their masks where there is no image: BGR, of ``window.size``.

    Args:
        window: what to draw, and how large.
        image_size: the camera's width and height, in which the bodies are given.
        image: gray or BGR, of the view at any resolution.
        bodies: the nearest is drawn over the others; names come over all.
    """
    bodies = sorted(bodies, key=lambda seen: -seen.depth)
    masks = [
        None if mask is None else window.picture(mask.astype(np.uint8) * 255, image_size, cv2.INTER_LINEAR) > 127
        for mask in (seen.mask for seen in bodies)
    ]
    if image is not None:
        picture = window.picture(image, image_size, cv2.INTER_AREA)
        canvas = picture.copy() if picture.ndim == 3 else cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR)
    else:
        canvas = plain(window.size[1], window.size[0])
        for mask in masks:
            if mask is not None:
                cv2.copyTo(plain(mask.shape[0], mask.shape[1], _SEEN), mask.view(np.uint8), canvas)
    names: list[tuple[Look, np.ndarray]] = []
    for seen, mask in zip(bodies, masks, strict=True):
        model = silhouette(window.points(seen.vertices), seen.body.tracking_face, window.size)
        own = None if seen.look is None else seen.look.colour
        colour, joints = own or MODEL_COLOUR, window.points(seen.joints)
        skin = cv2.addWeighted(canvas, 1 - _TINT, plain(model.shape[0], model.shape[1], colour), _TINT, 0.0)
        cv2.copyTo(skin, model, canvas)
        if mask is not None:
            _draw_contour(canvas, mask.astype(np.uint8), INK if own else MASK_COLOUR)
        _draw_contour(canvas, model, colour)
        _draw_skeleton(canvas, joints, seen.body.skeleton, own)
        if seen.spread is not None:
            scale = np.divide(window.size, window.extent)
            _draw_ellipses(canvas, joints, seen.spread * np.outer(scale, scale))
        if seen.look is not None and model.any():
            names.append((seen.look, model))
    _write_names(canvas, names)
    return canvas


def _write_names(canvas: np.ndarray, names: list[tuple[Look, np.ndarray]]) -> None:
    """Each name over the top of its silhouette (height, width), below the names that would be under it."""
    taken: list[tuple[int, int, int]] = []  # left, right and top
    for look, model in names:
        highest, width = int(model.any(axis=1).argmax()), text_width(look.name)
        left = int(np.flatnonzero(model[highest]).mean()) - width // 2
        left, top = max(4, min(left, canvas.shape[1] - width - 4)), max(4, highest - _NAME_HEIGHT)
        while any(left < end and start < left + width and abs(top - y) < _NAME_HEIGHT for start, end, y in taken):
            top += _NAME_HEIGHT
        if top + _NAME_HEIGHT < canvas.shape[0]:
            write_text(canvas, look.name, (left, top), look.colour)
            taken.append((left, left + width, top))


def text_width(text: str, size: float = 0.45) -> int:
    """How wide a line is that :func:`write_text` writes [px]."""
    return cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, size, 1)[0][0]


def write_text(canvas: np.ndarray, text: str, corner: tuple[int, int], colour: Colour = INK, size: float = 0.45) -> int:
    """Write a line on a dark plate whose top left corner is ``corner``; returns where the line ends [px]."""
    (width, height), below = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, size, 1)
    left, top = corner
    plate = canvas[max(top - 4, 0) : top + height + below, max(left - 4, 0) : left + width + 4]
    plate[:] = cv2.addWeighted(plate, 1 - _PLATE, np.full_like(plate, PAPER), _PLATE, 0.0)
    cv2.putText(canvas, text, (left, top + height), cv2.FONT_HERSHEY_SIMPLEX, size, colour, 1, cv2.LINE_AA)
    return left + width


def fixed_point(values: np.ndarray) -> np.ndarray:
    """Coordinates [px] as OpenCV takes them, int32 with ``SUBPIXEL_BITS`` binary digits after the point."""
    return np.rint(values * (1 << SUBPIXEL_BITS)).astype(np.int32)


def _draw_contour(canvas: np.ndarray, filled: np.ndarray, colour: Colour) -> None:
    contours, _ = cv2.findContours(filled, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(canvas, contours, -1, colour, 1, cv2.LINE_AA)


def _draw_skeleton(canvas: np.ndarray, joints: np.ndarray, skeleton: Skeleton, colour: Colour | None) -> None:
    """In one colour, or each limb in that of its side."""
    drawable = np.isfinite(joints).all(axis=1) & (np.abs(joints) < 8.0 * max(canvas.shape)).all(axis=1)
    fixed = fixed_point(np.where(drawable[:, None], joints, 0.0)).tolist()
    colours = [colour or COLOUR_OF_SIDE[skeleton.side(name)] for name in skeleton.joints]
    for parent, joint in skeleton.bones:
        if drawable[joint] and drawable[parent]:
            cv2.line(canvas, fixed[parent], fixed[joint], colours[joint], 2, cv2.LINE_AA, SUBPIXEL_BITS)
    for of_joint, centre, seen in zip(colours, fixed, drawable, strict=True):
        if seen:
            cv2.circle(canvas, centre, 2 << SUBPIXEL_BITS, of_joint, -1, cv2.LINE_AA, SUBPIXEL_BITS)


def _draw_ellipses(canvas: np.ndarray, joints: np.ndarray, covariances: np.ndarray) -> None:
    """``ELLIPSE`` standard deviations around each joint, up to half of the image."""
    for centre, covariance in zip(joints, covariances, strict=True):
        drawable = np.isfinite(covariance).all() and (np.abs(centre) < 8.0 * max(canvas.shape)).all()  # no NaN is
        if not drawable:
            continue
        variance, axes = np.linalg.eigh(covariance)
        radii = np.minimum(ELLIPSE * np.sqrt(np.maximum(variance, 0.0)), max(canvas.shape) / 2)
        middle, half = (fixed_point(values).tolist() for values in (centre, radii))
        angle = float(np.degrees(np.arctan2(axes[1, 0], axes[0, 0])))
        cv2.ellipse(canvas, middle, half, angle, 0.0, 360.0, SIGMA_COLOUR, 1, cv2.LINE_AA, SUBPIXEL_BITS)
