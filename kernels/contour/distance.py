"""Signed distances to the contours of bit-packed masks, around the foreground of each view.

The distance of a pixel to the nearest one on the other side of a contour is found in two passes: along its row, and
then over the rows above and below, ``min over d of d^2 + (distance along the row d further)^2``. A contour runs half
way between two pixels, so half a pixel is taken off. That is exact; a small blur then takes the stairs out. Distances
are cut off a few pixels from a contour: what lies between has one sign, and nobody asks for more.

The passes work on boxes with a rim, in which the mask goes on beyond the image as at its border, so that no pass has
borders to mind.
"""

import numpy as np
import warp as wp

from mmocap_warp.kernels.block import CPU_FLAGS, LANES, lanes_of, shared_numbers, sync
from mmocap_warp.kernels.contour.residuals import FARTHEST, Fields
from mmocap_warp.kernels.native import native_sections

wp.set_module_options({"enable_backward": False, "cpu_compiler_flags": CPU_FLAGS})

_native = native_sections(__file__)

_RIM = wp.constant(FARTHEST + 2)  # rim around a box [px]: the distances need most of it, and the blur two pixels
_VIEW_LANES = 32 * LANES  # lanes of a GPU that share a view


@wp.struct
class Masks:
    """Masks of frames, 32 pixels to a word."""

    word: wp.array4d[wp.uint32]  # (frame, camera, row, word)
    size: wp.array[wp.vec2i]  # (camera,) width, height [px]
    place: wp.array[wp.int32]  # (frame,) of the fields that each frame has


@wp.struct
class Workings:
    """What the passes leave for the next one, in the boxes with their rims; ``room`` is that of a frame."""

    room: int
    inside: wp.array[wp.uint8]  # (frame, pixel) flat: whether it is of the mask
    across: wp.array[wp.uint8]  # (frame, pixel) flat: square of the distance along the row
    rough: wp.array[wp.float32]  # (frame, pixel) flat: signed distance [px]


@wp.struct
class _View:
    """A view's box, and where its pixels are in the workings."""

    box: wp.vec4i
    width: int  # with the rim
    pixels: int
    first: int


# Words of 32 pixels without foreground are skipped. The lowest and the highest bit of the others tell the columns.
@wp.func_native(_native("bounds"))
def _bounds(word: wp.array4d[wp.uint32], f: int, k: int, lane: int, lanes: int) -> wp.vec4i:
    """The first column and row with foreground and the last ones, of a lane's share of a mask."""


@wp.kernel
def _find_boxes(
    masks: Masks,
    lanes: int,
    scratch: wp.array[wp.uint32],
    # out
    box: wp.array2d[wp.vec4i],  # (frame, camera) x, y, width, height [px]
) -> None:
    f, k, lane = wp.tid()
    numbers = shared_numbers(scratch)
    size = masks.size[k]
    if lane == 0:
        numbers[0] = size[0]
        numbers[1] = size[1]
        numbers[2] = -1
        numbers[3] = -1
    sync()
    bounds = _bounds(masks.word, f, k, lane, lanes)
    wp.atomic_min(numbers, 0, bounds[0])
    wp.atomic_min(numbers, 1, bounds[1])
    wp.atomic_max(numbers, 2, bounds[2])
    wp.atomic_max(numbers, 3, bounds[3])
    sync()
    if lane == 0:
        x = wp.max(numbers[0] - FARTHEST, 0)
        y = wp.max(numbers[1] - FARTHEST, 0)
        end_x = wp.min(numbers[2] + FARTHEST + 1, size[0])
        end_y = wp.min(numbers[3] + FARTHEST + 1, size[1])
        box[f, k] = wp.where(numbers[2] < 0, wp.vec4i(), wp.vec4i(x, y, end_x - x, end_y - y))


def find_boxes(masks: Masks, scratch: wp.array[wp.uint32], box: wp.array[wp.vec4i]) -> None:
    """Boxes (frame, camera) around the foreground and what is near it; no width without foreground."""
    lanes = lanes_of(box.device)
    wp.launch(_find_boxes, (*box.shape, lanes), [masks, lanes, scratch], [box], block_dim=lanes, device=box.device)


def pixels_of(width: np.ndarray, height: np.ndarray) -> np.ndarray:
    """Pixels of boxes with their rims, which is what views need of the fields and of the workings."""
    rim = 2 * (FARTHEST + 2)
    return np.where(width > 0, (width + rim) * (height + rim), 0)


@wp.func
def _pixels_of(box: wp.vec4i) -> int:
    """See :func:`pixels_of`."""
    return wp.where(box[2] > 0, (box[2] + 2 * _RIM) * (box[3] + 2 * _RIM), 0)


@wp.kernel
def _place_boxes(
    masks: Masks,
    found: wp.array2d[wp.vec4i],  # (frame, camera)
    foreground: wp.array2d[wp.int32],  # (frame, camera) pixels
    fewest: int,
    room: int,
    # out
    fields: Fields,
) -> None:
    f = wp.tid()
    place = masks.place[f]
    start = room * place
    for k in range(found.shape[1]):
        box = wp.where(foreground[f, k] < fewest, wp.vec4i(), found[f, k])
        fields.box[place, k] = box
        fields.start[place, k] = start
        start += _pixels_of(box)


def place_boxes(
    masks: Masks, found: wp.array[wp.vec4i], foreground: wp.array[wp.int32], fewest: int, room: int, fields: Fields
) -> None:
    """Say where the fields of frames are: each place has room for so many values.

    ``found`` (frame, camera) are boxes, of which those count that have so many pixels of ``foreground`` (frame, camera)
    at least.
    """
    wp.launch(_place_boxes, found.shape[0], [masks, found, foreground, fewest, room], [fields], device=found.device)


@wp.func
def _view_of(masks: Masks, fields: Fields, room: int, f: int, k: int) -> _View:
    view = _View()
    place = masks.place[f]
    view.box = fields.box[place, k]
    view.width = view.box[2] + 2 * _RIM
    view.pixels = _pixels_of(view.box)
    view.first = fields.start[place, k] - (place - f) * room
    return view


@wp.func_native(_native("unpack"))
def _unpack(
    word: wp.array4d[wp.uint32],
    f: int,
    k: int,
    x: int,
    y: int,
    width: int,
    count: int,
    inside: wp.array[wp.uint8],
    first: int,
) -> None:
    """Pixels from x on; beyond the image the row goes on as at its ends."""


# For every pixel all distances d are tried from far to near, without a branch: a pixel at d on either side that differs
# overwrites what a farther one left. Compilers turn that into vectors of bytes.
@wp.func_native(_native("search_rows", FARTHEST_SQUARED=FARTHEST**2, MOST_STEPS=FARTHEST - 1))
def _search_rows(inside: wp.array[wp.uint8], first: int, count: int, across: wp.array[wp.uint8]) -> None:
    """Squares of the distances to the other side along the row."""


# Of the pixels above and below, d rows away, each knows its own squared distance along its row, or zero if it is on the
# other side itself. So the smallest ``along + d^2`` is the squared distance in the plane, and needs only bytes. Half a
# pixel is taken off, because the contour runs between two pixels' centres.
@wp.func_native(_native("search_columns", FARTHEST_SQUARED=FARTHEST**2, FIRST_STEP=1 - FARTHEST, FARTHEST=FARTHEST))
def _search_columns(
    inside: wp.array[wp.uint8],
    across: wp.array[wp.uint8],
    first: int,
    count: int,
    width: int,
    rough: wp.array[wp.float32],
) -> None:
    """Signed distances to the other side."""


# The weights are those of a normal distribution at 0, 1 and 2 px, made to add up to one, first along the row, then
# down the five rows.
@wp.func_native(_native("blur"))
def _blur(
    rough: wp.array[wp.float32], centre: int, first: int, count: int, width: int, value: wp.array[wp.float32]
) -> None:
    """By a normal distribution of 1 px within two pixels."""


@wp.kernel
def _draw(
    masks: Masks,
    fields: Fields,
    lanes: int,
    # out
    workings: Workings,
) -> None:
    f, k, lane = wp.tid()
    view = _view_of(masks, fields, workings.room, f, k)
    size = masks.size[k]
    many = wp.where(lanes == 1, view.width, 1)
    for i in range(lane * many, view.pixels, lanes * many):
        row = i // view.width
        x = view.box[0] - _RIM + i - row * view.width
        y = wp.clamp(view.box[1] - _RIM + row, 0, size[1] - 1)
        _unpack(masks.word, f, k, x, y, size[0], many, workings.inside, view.first + i)


@wp.kernel
def _search(
    masks: Masks,
    fields: Fields,
    lanes: int,
    rows: bool,
    # in and out
    workings: Workings,
) -> None:
    f, k, lane = wp.tid()
    view = _view_of(masks, fields, workings.room, f, k)
    rim = wp.where(rows, FARTHEST, FARTHEST * view.width)
    many = wp.where(lanes == 1, view.pixels - 2 * rim, 1)
    for i in range(rim + lane * many, view.pixels - rim, lanes * many):
        if rows:
            _search_rows(workings.inside, view.first + i, many, workings.across)
        else:
            _search_columns(workings.inside, workings.across, view.first + i, many, view.width, workings.rough)


@wp.kernel
def _smooth(
    masks: Masks,
    workings: Workings,
    lanes: int,
    # in and out
    fields: Fields,
) -> None:
    f, k, lane = wp.tid()
    view = _view_of(masks, fields, workings.room, f, k)
    wide = view.box[2]
    many = wp.where(lanes == 1, wide, 1)
    for i in range(lane * many, wide * view.box[3], lanes * many):
        row = i // wide
        at = view.first + (row + _RIM) * view.width + _RIM + i - row * wide
        _blur(workings.rough, at, fields.start[masks.place[f], k] + i, many, view.width, fields.value)


def measure_distances(masks: Masks, workings: Workings, fields: Fields) -> None:
    """Fill the fields of the masks' places, of which box and start are known."""
    device = fields.value.device
    lanes = _VIEW_LANES if lanes_of(device) > 1 else 1
    dim = (*masks.word.shape[:2], lanes)
    wp.launch(_draw, dim, [masks, fields, lanes], [workings], device=device)
    for rows in (True, False):
        wp.launch(_search, dim, [masks, fields, lanes, rows], [workings], device=device)
    wp.launch(_smooth, dim, [masks, workings, lanes], [fields], device=device)
