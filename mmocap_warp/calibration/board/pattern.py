"""Boards: what ``charuco:5x7:40mm`` means, the drawing to print, and its corners in an image."""

import re
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import cv2
import numpy as np

from mmocap_warp.cameras.rig import METRES
from mmocap_warp.errors import UsageError

MIN_CORNERS = 6  # corners of a board that is used; fewer determine a pose badly
_MARKER_SHARE = 0.75  # side of a marker over that of its square
_MARGIN = 10.0  # millimetres of white around the printed board
_MAX_BENT = 0.5  # of a square's side: corners that a homography of the board misses by more are not the board's
_RULER = 100.0  # millimetres of the ruler that checks the print's scale
_SPECIFICATION = re.compile(
    r"(?P<kind>charuco|chessboard):(?P<columns>\d{1,2})x(?P<rows>\d{1,2}):(?P<square>\d+(\.\d+)?)(?P<unit>mm|cm|m|in)"
    r"(:(?P<marker>\d+(\.\d+)?)(?P<marker_unit>mm|cm|m|in))?(:(?P<dictionary>[4-7]x[4-7]_\d+))?"
)


@dataclass(frozen=True)
class Board:
    """A flat board of squares."""

    kind: str  # ``charuco`` or ``chessboard``
    columns: int  # of squares
    rows: int
    square: float  # side of a square [m]
    marker: float  # side of a ChArUco board's marker [m]
    dictionary: str = "4x4_50"  # of the markers

    def __str__(self) -> str:
        size = f"{self.kind}:{self.columns}x{self.rows}:{1000 * self.square:g}mm"
        return size if self.kind == "chessboard" else f"{size}:{1000 * self.marker:g}mm:{self.dictionary}"

    @classmethod
    def parse(cls, text: str) -> Self:
        """A board as text: ``charuco:5x7:40mm`` or ``charuco:5x7:40mm:30mm:4x4_50``; a UsageError for other text."""
        match = _SPECIFICATION.fullmatch(text.lower())
        if match is None:
            raise UsageError(
                "--board must be such as charuco:5x7:40mm, charuco:5x7:40mm:30mm:4x4_50 (with the markers' size and "
                f"dictionary) or chessboard:6x9:40mm, with the numbers of squares and the side of one, got '{text}'"
            )
        square = float(match["square"]) * METRES[match["unit"]]
        marker = float(match["marker"]) * METRES[match["marker_unit"]] if match["marker"] else _MARKER_SHARE * square
        dictionary = match["dictionary"] or cls.dictionary
        return cls(match["kind"], int(match["columns"]), int(match["rows"]), square, marker, dictionary)

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < 3:
            raise UsageError(f"--board must have at least 3x3 squares, got {self.columns}x{self.rows}")
        if not 0.001 <= self.square <= 2:
            raise UsageError(f"--board must have squares of 1 mm to 2 m, got {self.square:g} m")
        if self.kind == "chessboard":
            if (self.columns + self.rows) % 2 == 0:
                raise UsageError(
                    f"--board {self} looks the same when it is turned by half; take one with an odd and an even number "
                    "of squares, such as chessboard:6x9:40mm, or a ChArUco board"
                )
            return
        if not 0 < self.marker < self.square:
            raise UsageError(f"--board must have markers smaller than its squares, got {self.marker:g} m")
        if not hasattr(cv2.aruco, self._dictionary_name):
            raise UsageError(f"--board names the dictionary '{self.dictionary}', which OpenCV lacks; try 4x4_250")
        if self.columns * self.rows // 2 > int(self.dictionary.split("_")[1]):
            millimetres = f"{1000 * self.square:g}mm:{1000 * self.marker:g}mm"
            larger = f"name a larger one, such as {self.kind}:{self.columns}x{self.rows}:{millimetres}:4x4_1000"
            remedy = larger if self.columns * self.rows // 2 <= 1000 else "take fewer squares"
            raise UsageError(f"--board has more markers than the dictionary {self.dictionary}; {remedy}")

    @property
    def _dictionary_name(self) -> str:
        return f"DICT_{self.dictionary.upper()}"

    @cached_property
    def _markers(self) -> cv2.aruco.Dictionary:
        return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, self._dictionary_name))

    @cached_property
    def _charuco(self) -> cv2.aruco.CharucoBoard:
        return cv2.aruco.CharucoBoard((self.columns, self.rows), self.square, self.marker, self._markers)

    @property
    def corners(self) -> np.ndarray:
        """(corner, 3) float32, the inner corners on the board, row by row: x right, y down, z into the board [m]."""
        down, across = np.mgrid[1 : self.rows, 1 : self.columns]
        return (self.square * np.stack([across, down, 0 * down], axis=-1)).reshape(-1, 3).astype(np.float32)

    def find(self, gray: np.ndarray) -> np.ndarray | None:
        """The pixels of the corners (corner, 2) float32 in an image, NaN where not seen; None where too few are."""
        pixels = np.full((len(self.corners), 2), np.nan, np.float32)
        if self.kind == "charuco":
            corners, numbers, _, _ = cv2.aruco.CharucoDetector(self._charuco).detectBoard(gray)
            if numbers is None or len(numbers) < MIN_CORNERS:
                return None
            pixels[numbers.ravel()] = corners.reshape(-1, 2)
            seen = self.corners[numbers.ravel(), :2]
            return pixels if min(np.ptp(seen, axis=0)) > 0 else None  # corners on one line determine no pose
        return self._find_chessboard(gray)

    def _find_chessboard(self, gray: np.ndarray) -> np.ndarray | None:
        shape = self.rows - 1, self.columns - 1
        # The second search finds more boards, but not all that the first one finds.
        for exhaustive in (0, cv2.CALIB_CB_EXHAUSTIVE):
            grid = _chessboard_grid(gray, shape, exhaustive)
            if grid is not None and sorted(grid.shape[:2]) == sorted(shape) and _is_flat(grid):
                break
        else:
            return None
        grid = grid if grid.shape[:2] == shape else grid.swapaxes(0, 1)
        # The detector may begin at either end: rows go down, and the square at the first corner is the drawing's.
        across, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
        if across[0] * down[1] - across[1] * down[0] < 0:
            grid = grid[:, ::-1]
        first, last = (np.rint(each.mean(axis=(0, 1))).astype(int) for each in (grid[:2, :2], grid[-2:, -2:]))
        if gray[first[1], first[0]] > gray[last[1], last[0]]:  # the square at the first inner corner is black
            grid = grid[::-1, ::-1]
        return np.ascontiguousarray(grid.reshape(-1, 2), np.float32)

    def other_boards(self, gray: np.ndarray) -> str | None:
        """What an image shows of another board, in words; None where it shows none."""
        if self.kind == "chessboard":
            grid = _chessboard_grid(gray, (3, 3), cv2.CALIB_CB_EXHAUSTIVE)
            return None if grid is None else f"it shows a chessboard of {grid.shape[1] + 1}x{grid.shape[0] + 1} squares"
        for name in (self.dictionary, *(f"{bits}x{bits}_{count}" for bits in range(4, 8) for count in (50, 250, 1000))):
            dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{name.upper()}"))
            _, numbers, _ = cv2.aruco.ArucoDetector(dictionary).detectMarkers(gray)
            count = 0 if numbers is None else len(numbers)
            if name == self.dictionary and count >= 2 and numbers.max() >= self.columns * self.rows // 2:
                return f"it shows marker {numbers.max()}, which a board of {self.columns}x{self.rows} squares lacks"
            if name.split("_")[0] != self.dictionary.split("_")[0] and count >= 4:  # else the larger has them too
                return f"it shows markers of the dictionary {name}"
        return None

    def svg(self) -> str:
        """The board to be printed at 100 %, in millimetres, with a ruler that checks the print."""
        side, marker = 1000 * self.square, 1000 * self.marker
        width, height = self.columns * side + 2 * _MARGIN, self.rows * side + 3 * _MARGIN + 10
        cells = [(row, column) for row in range(self.rows) for column in range(self.columns)]
        black, white = ([cell for cell in cells if sum(cell) % 2 == odd] for odd in (0, 1))  # the first one is black
        shapes = [_rectangle(_MARGIN + column * side, _MARGIN + row * side, side, side) for row, column in black]
        if self.kind == "charuco":
            inset = (side - marker) / 2
            for number, (row, column) in enumerate(white):
                shapes += self._marker(number, _MARGIN + column * side + inset, _MARGIN + row * side + inset, marker)
        below = self.rows * side + 2 * _MARGIN
        ruler = min(_RULER, 10 * int(self.columns * side / 10))
        shapes.append(_rectangle(_MARGIN, below, ruler, 0.5))
        shapes += [_rectangle(_MARGIN + place, below, 0.3, 3) for place in np.arange(0, ruler + 1, 10)]
        text = f"{self} - print at 100 %: this ruler must measure {ruler:g} mm"
        words = f'<text x="{_MARGIN:g}" y="{below + 8:g}" font-family="sans-serif" font-size="3.5">{text}</text>'
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:g}mm" height="{height:g}mm" '
            f'viewBox="0 0 {width:g} {height:g}"><rect width="100%" height="100%" fill="white"/>\n'
            + "\n".join([*shapes, words])
            + "\n</svg>\n"
        )

    def _marker(self, number: int, left: float, top: float, side: float) -> list[str]:
        cells = self._markers.markerSize + 2
        bits = cv2.aruco.generateImageMarker(self._markers, number, cells)
        cell = side / cells
        return [_rectangle(left + x, top + y, cell, cell) for y, x in np.argwhere(bits == 0) * cell]


def _rectangle(x: float, y: float, width: float, height: float) -> str:
    return f'<rect x="{x:.3f}" y="{y:.3f}" width="{width:.3f}" height="{height:.3f}"/>'


def _chessboard_grid(gray: np.ndarray, least: tuple[int, int], exhaustive: int) -> np.ndarray | None:
    """The pixels (row, column, 2) of all inner corners of the chessboard in an image, which has so many or more."""
    cv2.setRNGSeed(0)  # the search draws random numbers
    flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_LARGER | exhaustive
    good, corners, squares = cv2.findChessboardCornersSBWithMeta(gray, least[::-1], flags=flags)
    return corners.reshape(*squares.shape, 2) if good else None


def _is_flat(grid: np.ndarray) -> bool:
    """Whether corners are the picture of a flat grid: the exhaustive search puts some on what is beside the board."""
    flat = np.moveaxis(np.indices(grid.shape[:2]), 0, -1).reshape(-1, 2).astype(np.float32)
    to_image, _ = cv2.findHomography(flat, grid.reshape(-1, 2))
    if to_image is None:
        return False
    missed = cv2.perspectiveTransform(flat[:, None], to_image).reshape(grid.shape) - grid
    side = np.linalg.norm(np.diff(grid, axis=1), axis=2).mean()
    return bool(np.linalg.norm(missed, axis=2).max() < _MAX_BENT * side)
