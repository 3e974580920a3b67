"""Views of a board that is moved about, as cameras with lenses see it: blurred, noisy and with its exact places."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from mmocap_warp.calibration.board.pattern import Board
from mmocap_warp.cameras.rig import CameraRig

_PIXELS = 40  # of a square in the drawing


def board_rig(cameras: int, width: int = 640, height: int = 480) -> CameraRig:
    """Cameras on an arc of 2 m around the room's middle, all with another lens."""
    K, R, t = [], [], []
    for k in range(cameras):
        angle = 0.35 * (k - 0.5 * (cameras - 1))
        centre = np.array([2 * np.sin(angle), -2 * np.cos(angle), 1.2 + 0.1 * k])
        ahead = np.array([0.0, 0.0, 1.0]) - centre
        ahead /= np.linalg.norm(ahead)
        right = np.cross(ahead, [0, 0, 1.0])
        right /= np.linalg.norm(right)
        focal = (0.95 + 0.03 * k) * width
        K.append([[focal, 0, width / 2 + 3 * k - 4], [0, focal, height / 2 - 2 * k + 3], [0, 0, 1]])
        R.append(np.stack([right, np.cross(ahead, right), ahead]))
        t.append(-R[-1] @ centre)
    size, distortion = np.tile([width, height], (cameras, 1)), np.tile([-0.12, 0.04, 0, 0, 0.0], (cameras, 1))
    names = tuple(f"cam{k + 1}" for k in range(cameras))
    return CameraRig(names, np.array(K, float), np.array(R), np.array(t), size, distortion)


def board_course(rig: CameraRig, board: Board, close: int, common: int, seed: int = 0) -> list[tuple]:
    """Turns and shifts from the board to the world: ``close`` frames before each camera, then ``common`` amid all."""
    draw = np.random.default_rng(seed)
    middle = board.square * np.array([board.columns, board.rows, 0]) / 2
    poses = []
    for k in range(len(rig)):
        for _ in range(close):
            turn = cv2.Rodrigues(draw.uniform([-0.6, -0.6, -0.5], [0.6, 0.6, 0.5]))[0]
            depth = draw.uniform(11, 16) * board.square
            place = np.array([*draw.uniform([-0.28, -0.2], [0.28, 0.2]) * depth, depth])
            poses.append((rig.R[k].T @ turn, rig.R[k].T @ (place - turn @ middle - rig.t[k])))
    facing = rig.R[len(rig) // 2].T
    for _ in range(common):
        turn = facing @ cv2.Rodrigues(draw.uniform([-0.4, -0.3, -0.5], [0.4, 0.3, 0.5]))[0]
        poses.append((turn, draw.uniform([-0.3, -0.7, 0.8], [0.3, 0.2, 1.2]) - turn @ middle))
    return poses


def _picture(board: Board) -> np.ndarray:
    """The board without a margin, gray, ``_PIXELS`` to a square."""
    if board.kind == "charuco":
        return np.asarray(board._charuco.generateImage((board.columns * _PIXELS, board.rows * _PIXELS)))
    squares = (np.indices((board.rows, board.columns)).sum(axis=0) % 2).astype(np.uint8) * 255
    return squares.repeat(_PIXELS, axis=0).repeat(_PIXELS, axis=1)


def render_board(
    rig: CameraRig, k: int, board: Board, turn: np.ndarray, shift: np.ndarray, noise: np.random.Generator, blur=0.7
) -> np.ndarray:
    """The gray image of a camera: the board's drawing through homography and lens, blurred, with noise."""
    width, height = rig.size[k]
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(-1, 1, 2).astype(np.float32)
    rays = cv2.undistortPoints(pixels, rig.K[k], rig.distortion[k])[:, 0]
    R, t = rig.R[k] @ turn, rig.R[k] @ shift + rig.t[k]
    to_board = np.linalg.inv(np.column_stack([R[:, :2], t]))  # a ray to the board's plane
    on_plane = np.column_stack([rays, np.ones(len(rays))]) @ to_board.T
    ahead = 1 / on_plane[:, 2]
    places = on_plane[:, :2] * ahead[:, None] / board.square * _PIXELS - 0.5
    drawing = cv2.copyMakeBorder(_picture(board), *[_PIXELS // 2] * 4, cv2.BORDER_CONSTANT, value=255)
    corners = np.array([[0, 0, 0], [board.columns, board.rows, 0]]) * board.square
    across = np.linalg.norm(np.diff((corners @ R.T + t)[:, :2] / (corners @ R.T + t)[:, 2:], axis=0)) * rig.K[k, 0, 0]
    smaller = np.hypot(board.columns, board.rows) * _PIXELS / max(across, 1.0)
    drawing = cv2.GaussianBlur(drawing, (0, 0), max(0.3, 0.4 * smaller))  # before it is sampled, against aliasing
    map_xy = np.where((ahead > 0)[:, None], places + _PIXELS // 2, -1e4).astype(np.float32).reshape(height, width, 2)
    image = cv2.remap(drawing, map_xy, None, cv2.INTER_LINEAR, borderValue=110)
    image = cv2.GaussianBlur(image, (0, 0), blur).astype(np.float32) * 0.8 + 25
    return np.clip(image + noise.normal(0, 2.0, image.shape), 0, 255).astype(np.uint8)


def in_world_of(rig: CameraRig, k: int) -> CameraRig:
    """The same cameras in the axes of one of them."""
    R = rig.R @ rig.R[k].T
    return replace(rig, R=R, t=rig.t - R @ rig.t[k])
