"""Peak memory and time of each command's work on a long recording: seven cameras of 640x480.

    python docs/benchmarks/memory.py --frames 20000 --evaluations 12

The recording is made up frame by frame and never held: the built-in walk, to and fro. Each step runs in a process of
its own, because a process does not give back what it once had. On Linux, whose kernel says what a process's peak was.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from itertools import cycle, islice
from pathlib import Path

import numpy as np

CAMERAS, SIZE = 7, (640, 480)


def memory(field: str) -> float:
    """Of this process, ``VmRSS`` (now) or ``VmHWM`` (at its peak) [MB]."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith(field)).split()[1]) / 1024


def recording(frames: int):
    """The subject, the cameras, and the masks of each frame in turn."""
    from mmocap_warp.body.model import Subject
    from mmocap_warp.body.posing import Poser
    from mmocap_warp.cameras.rig import CameraRig, project
    from mmocap_warp.cameras.silhouette import silhouette

    sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "instruments"))
    from walk_scene import walking

    walk = walking()
    angle = 2 * np.pi * np.arange(CAMERAS) / CAMERAS
    towards = -np.stack([np.cos(angle), np.sin(angle), np.zeros(CAMERAS)], axis=1)
    right = np.stack([np.sin(angle), -np.cos(angle), np.zeros(CAMERAS)], axis=1)
    R = np.stack([right, np.tile([0.0, 0.0, -1.0], (CAMERAS, 1)), towards], axis=1)
    K = np.tile(np.array([[650.0, 0, 319.5], [0, 650.0, 239.5], [0, 0, 1]]), (CAMERAS, 1, 1))
    t = np.einsum("kij,kj->ki", R, 4.0 * towards - [0, 0, 1.0])
    names = tuple(f"cam{k}" for k in range(CAMERAS))
    rig = CameraRig(names, K, R, t, np.tile(SIZE, (CAMERAS, 1)), np.zeros((CAMERAS, 5)), "+z")
    subject = Subject(walk.body, walk.root_base, walk.poses[0], {})
    poser, faces = Poser(walk.body, walk.root_base), walk.body.tracking_face
    stride = [
        np.packbits([silhouette(view, faces, SIZE) > 0 for view in project(rig, poser.tracking_vertices(pose)[0])])
        for pose in walk.poses
    ]

    def masks() -> Iterator[list[np.ndarray]]:
        for bits in islice(cycle(stride + stride[-2:0:-1]), frames):
            yield list(np.unpackbits(bits).astype(bool).reshape(CAMERAS, *SIZE[::-1]))

    return subject, rig, masks, poser


def step_start(frames: int, evaluations: int, result: Path) -> Callable[[], object]:
    """Track two frames: what any run takes."""
    return partial(_track, 2, evaluations, result.with_name("start.usdc"))


def step_track(frames: int, evaluations: int, result: Path) -> Callable[[], object]:
    """Track the recording and write the result."""
    return partial(_track, frames, evaluations, result)


def step_contours(frames: int, evaluations: int, result: Path) -> Callable[[], object]:
    """Track it with the default tracker, smooth it and write the result."""
    return partial(_track, frames, evaluations, result.with_name("contours.usdc"), "search-contour")


def _track(frames: int, evaluations: int, path: Path, algorithm: str = "h-cmaes") -> None:
    from mmocap_warp.formats.usd.usd_result import write_result
    from mmocap_warp.masks.observation import Observation
    from mmocap_warp.tracking.frame_loop import track_observations
    from mmocap_warp.tracking.track_config import TrackConfig

    subject, rig, masks, _ = recording(frames)
    config = TrackConfig(algorithm, evaluations=evaluations, device="cpu")
    write_result(path, track_observations(subject, rig, map(Observation.from_masks, masks()), 60.0, config))


def step_read(frames: int, evaluations: int, result: Path) -> Callable[[], object]:
    """Read the result."""
    from mmocap_warp.formats.usd.usd_result import read_result

    return partial(read_result, result)


def step_eval(frames: int, evaluations: int, result: Path) -> Callable[[], object]:
    """Judge it against truth."""
    from mmocap_warp.formats.usd.usd_result import read_result
    from mmocap_warp.result.evaluation import evaluate
    from mmocap_warp.result.truth import Truth

    tracked = read_result(result)
    _, _, _, poser = recording(1)
    marker, pose = tracked.subject.body.marker_vertex, tracked.pose[0]
    markers = np.stack([poser.vertices(one)[0, marker] for one in pose]).astype(float)
    joints = poser.joint_transforms(pose)[:, :, :3, 3].astype(float)
    names, of_joints = tracked.subject.body.marker_names, tracked.subject.body.skeleton.joints
    return partial(evaluate, tracked, Truth(60.0, tracked.frame_numbers, names, markers, of_joints, joints))


def step_export(frames: int, evaluations: int, result: Path) -> Callable[[], object]:
    """Write its animation."""
    from mmocap_warp.formats.usd.usd_result import export_animation, read_result

    return partial(export_animation, read_result(result), result.with_name("animation.usdz"))


def step_show(frames: int, evaluations: int, result: Path) -> Callable[[], object]:
    """Draw it over its masks."""
    from mmocap_warp.display.result_video import show
    from mmocap_warp.formats.usd.usd_result import read_result

    tracked = read_result(result)
    _, _, masks, _ = recording(frames)
    video, sheet = result.with_suffix(".webm"), result.with_suffix(".png")
    return partial(show, tracked, None, masks(), video=video, sheet=sheet)


STEPS = {
    "start": step_start,
    "track": step_track,
    "contours": step_contours,
    "read": step_read,
    "eval": step_eval,
    "export": step_export,
    "show": step_show,
}


def measure(step: str, frames: int, evaluations: int, result: Path) -> None:
    """Run one step in this process and print its line of the table."""
    import warp as wp

    wp.config.log_level = wp.LOG_WARNING
    work = STEPS[step](frames, evaluations, result)
    before = memory("VmRSS")
    Path("/proc/self/clear_refs").write_text("5")  # forget the peak so far
    started = time.perf_counter()
    work()
    seconds = time.perf_counter() - started
    print(f"| {step} | {frames:,} | {before:,.0f} | {memory('VmHWM'):,.0f} | {seconds:,.1f} |", flush=True)


def main() -> None:
    """Run the steps, each in a process of its own."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=20000)
    parser.add_argument("--evaluations", type=int, default=12)
    parser.add_argument("--steps", nargs="+", choices=tuple(STEPS), default=tuple(STEPS))
    parser.add_argument("--result", type=Path, help="keep the result here, or read it from here")
    parser.add_argument("--here", action="store_true", help="run the steps in this process")
    options = parser.parse_args()
    if options.here:
        for step in options.steps:
            measure(step, options.frames, options.evaluations, options.result)
        return
    print("| step | frames | before [MB] | peak [MB] | seconds |\n|---|---|---|---|---|", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        result = options.result or Path(folder) / "result.usdc"
        for step in options.steps:
            command = [sys.executable, __file__, "--here", "--steps", step, "--result", str(result)]
            command += ["--frames", str(options.frames), "--evaluations", str(options.evaluations)]
            subprocess.run(command, check=True, stderr=subprocess.DEVNULL, env=os.environ)


if __name__ == "__main__":
    main()
