"""How many frames 2-D keypoints are ahead of a scene's masks, by camera.

``python instruments/keypoint_lag.py scenes/balancing POSES``; POSES holds a folder for each camera, ``cam01_json`` and
so on, with a file of OpenPose (BODY_25B) for each frame. Those that the reference of scenes/balancing was triangulated
from are in Pose2Sim's history (commit 2b7e4b8, ``S00_P00_T01_BalancingTrial/pose``); its videos came later.

A mask's middle across a limb is where the limb was when the video was taken. Where the keypoints are ahead in time, the
middle lags behind them in proportion to the limb's velocity across itself: the slope is the lag in frames. No body and
no tracking has a part in it.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from mmocap_warp.scene.scene_toml import load_scene

# The ends of forearms, upper arms and lower legs among BODY_25B's keypoints.
LIMBS = ((7, 9), (8, 10), (5, 7), (6, 8), (13, 15), (14, 16))
ALONG = (0.35, 0.5, 0.65)  # where on a limb its middle is looked for
REACH = 70.0  # how far from the keypoints a limb's border may be [px]
WIDEST = 110.0  # where a mask is wider, it shows more than the limb [px]
SURE = 0.4  # confidence of both ends
HALF = 3  # frames to either side whose straight line is the velocity
FEWEST = 30  # frames of a limb that count


def keypoints(folder: Path) -> np.ndarray:
    """(frame, keypoint, 3) of a camera: pixels and confidence; zero where nobody was found."""
    frames = []
    for file in sorted(folder.glob("*.json")):
        people = json.loads(file.read_text())["people"]
        frames.append(np.reshape(people[0]["pose_keypoints_2d"], (-1, 3)) if people else np.zeros((25, 3)))
    return np.array(frames)


def middle(mask: np.ndarray, point: np.ndarray, across: np.ndarray) -> float:
    """How far from a point the middle of the mask's run through it is [px]; NaN where it is no limb's."""
    steps = np.arange(-REACH, REACH + 0.5, 0.5)
    column, row = (point + steps[:, None] * across).round().astype(int).T
    inside = (column >= 0) & (row >= 0) & (column < mask.shape[1]) & (row < mask.shape[0])
    filled = np.zeros(len(steps), bool)
    filled[inside] = mask[row[inside], column[inside]]
    empty, centre = np.flatnonzero(~filled), len(steps) // 2
    before, after = empty[empty < centre], empty[empty > centre]
    if not (filled[centre] and len(before) and len(after)):
        return np.nan
    first, last = steps[before[-1] + 1], steps[after[0] - 1]
    return (first + last) / 2 if last - first <= WIDEST else np.nan


def samples(points: np.ndarray, masks: list[np.ndarray], limb: tuple[int, int], along: float) -> np.ndarray:
    """(n, 2): a limb's velocity across itself, and how far its middle in the mask is from the keypoints [px]."""
    start, end = (points[:, number] for number in limb)
    sure = np.minimum(start[:, 2], end[:, 2]) > SURE
    place, found = (1 - along) * start[:, :2] + along * end[:, :2], []
    times = np.arange(-HALF, HALF + 1)
    for frame in range(HALF, len(points) - HALF):
        if not sure[frame + times].all():
            continue
        bone = (end - start)[frame, :2]
        across = np.array([-bone[1], bone[0]]) / np.linalg.norm(bone)
        velocity = times @ (place[frame + times] @ across) / (times @ times)
        found.append((velocity, middle(masks[frame], place[frame], across)))
    known = np.array(found).reshape(-1, 2)
    known = known[np.isfinite(known).all(axis=1)]
    return known - np.median(known, axis=0) if len(known) >= FEWEST else known[:0]


def slope(known: np.ndarray) -> tuple[float, float]:
    """The slope of the second column over the first, outliers weighted down, and its standard deviation."""
    x, y = known.T
    weight = np.ones(len(x))
    for _ in range(20):
        value = (weight * x * y).sum() / (weight * x * x).sum()
        left = y - value * x
        spread = 1.48 * np.median(np.abs(left))
        weight = 1 / (1 + (left / (2 * spread)) ** 2)
    return value, spread / np.sqrt((weight * x * x).sum())


def main(scene_file: Path, poses: Path) -> None:
    """Print the lag of each camera."""
    scene, everything = load_scene(scene_file), []
    for source in scene.cameras:
        masks = [mask > 0 for mask in source.masks.read()]
        points = keypoints(poses / f"{source.name}_json")
        known = np.concatenate([samples(points, masks, limb, along) for limb in LIMBS for along in ALONG])
        everything.append(known)
        print(f"{source.name}: keypoints ahead by {-slope(known)[0]:.2f} frames, +- {slope(known)[1]:.2f}")
    value, deviation = slope(np.concatenate(everything))
    print(f"all: {-value:.2f} +- {deviation:.2f}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", type=Path)
    parser.add_argument("poses", type=Path)
    given = parser.parse_args()
    main(given.scene, given.poses)
