"""Memory of ``track`` over a long recording, smoothing included, as the command runs it. See docs/testing.md.

Run from the repository's root, on Linux, whose kernel says what a process has::

    python tests/long_run.py --frames 20000
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np
from recordings import write_recording

from mmocap_warp.device.resolve import start_quietly
from mmocap_warp.formats.toml_table import config_from_table
from mmocap_warp.formats.usd.usd_body import read_subject
from mmocap_warp.formats.usd.usd_result import write_result
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.tracking.frame_loop import track
from mmocap_warp.tracking.track_config import TrackConfig

SAMPLES = 8  # of each stage


def resident(field: str = "VmRSS") -> float:
    """Of this process, ``VmRSS`` (now) or ``VmHWM`` (at its peak) [MB]."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith(field)).split()[1]) / 1024


class Table:
    """Prints a line when a stage has come further by a share of all frames."""

    def __init__(self, frames: int) -> None:
        self._due = np.linspace(frames / SAMPLES, frames, SAMPLES)
        self._stage, self._done = "", 0
        print("| stage | frame | resident [MB] | processor time [s] |\n|---|---|---|---|")

    def __call__(self, stage: str, frame: int) -> None:
        """A stage has come so far."""
        before = self._done if stage == self._stage else 0
        if not frame or ((self._due > before) & (self._due <= frame)).any():
            print(f"| {stage} | {frame:,} | {resident():,.1f} | {time.process_time():,.0f} |", flush=True)
        self._stage, self._done = stage, frame


def main() -> None:
    """Track, smooth and write a long recording."""
    parser = argparse.ArgumentParser(prog="python tests/long_run.py", description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=20000)
    frames = parser.parse_args().frames
    start_quietly()
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        write_recording(folder, frames, speed=0.5)
        scene, subject = load_scene(folder), read_subject(folder / "subject.usdc")
        told = Table(frames)
        told("start", 0)
        result = track(
            scene,
            subject,
            config_from_table(TrackConfig, scene.settings("track")),
            checkpoint=folder / "checkpoint",
            progress=lambda frame, _: told("track", frame + 1),
            smooth_progress=lambda done: told("smooth", done),
        )
        write_result(folder / "result.usdc", result)
        told("written", frames)
    found = f"{(result.status == 2).sum()} frames lost, {result.evaluations.mean():.1f} evaluations a frame"
    print(f"peak {resident('VmHWM'):,.1f} MB; {found}, mean IoU {np.nanmean(result.iou):.3f}")


if __name__ == "__main__":
    main()
