"""Tracking while a recording is made: ``mmocap live``."""

from __future__ import annotations

import gc
import time
from collections import deque
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mmocap_warp.body.model import Subject
from mmocap_warp.commands.caller import Reporter, arguments_checked, describe, effective, start_warp
from mmocap_warp.commands.inputs import Frames, scene_from
from mmocap_warp.commands.outputs import new_file, releases_locks
from mmocap_warp.commands.track import fit
from mmocap_warp.errors import InputError, UsageError
from mmocap_warp.formats.usd.usd_body import read_subject
from mmocap_warp.formats.usd.usd_file import USD_SUFFIXES
from mmocap_warp.rigging.attaching import subject_carrying
from mmocap_warp.scene.recording import Scene
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.streaming.arrivals import arrivals, newest
from mmocap_warp.streaming.growing_result import GrowingResult, finish, frames_beside
from mmocap_warp.streaming.packets import Packet
from mmocap_warp.streaming.senders import open_sender
from mmocap_warp.tracking.live import LiveFrame
from mmocap_warp.tracking.live_tracker import LiveTracker
from mmocap_warp.tracking.track_config import TrackConfig

_DELAYS = 10_000  # frames whose delays are reported: the last ones


@dataclass(frozen=True)
class LiveReport:
    """What came of a live session.

    Attributes:
        frames: that were tracked.
        dropped: that were left out, because a frame before took too long or they never came.
        lost: of those tracked, how many were lost at once.
        delay_ms: median, 99th percentile and most of the time from a frame's being seen to its packet being sent [ms],
            of the last 10,000 frames; NaN where there was none.
    """

    frames: int
    dropped: int
    lost: int
    delay_ms: tuple[float, float, float]


@releases_locks
def live(
    scene: Scene | str | Path,
    subject: Subject | str | Path | None = None,
    config: TrackConfig | None = None,
    *,
    source: tuple[str, ...] = (),
    to: tuple[str, ...] = (),
    record: str | Path | None = None,
    recover: bool = False,
    frames: Frames = None,
    force: bool = False,
    reporter: Reporter | None = None,
    **settings: Any,
) -> LiveReport:
    """Track while frames come, and tell other programs of each frame twice: at once, and smoothed up to 9 frames later.

    It goes on until the source ends or it is interrupted.

    Args:
        scene: the recording, or its file or folder: cameras, and how masks are made.
        subject: the fitted subject to track, or its file. [default: the scene's, or else one is fitted to its files]
        config: settings. [default: those of the scene's [track] table]
        source: where frames come from: a folder in which one of numbered images grows for each camera, a ZMQ address
            such as tcp://127.0.0.1:5555, or for each camera what OpenCV opens, a number or an address such as
            rtsp://... [default: the scene's own files, at their pace]
        to: who is told: tcp://HOST:PORT (ZMQ), ws://HOST:PORT (WebSocket, and a page to look at), vmc://HOST:PORT or
            vmc://HOST:PORT?smooth (VMC by OSC), lsl://NAME (LSL).
        record: a result's file that is written as it goes: .usdc, .usda or .usd.
        recover: only make a result of what a recording holds that was killed.
        frames: which of the recording's frames. [default: those that the scene names]
        force: replace a result that exists.
        reporter: who is told of notes.
        settings: fields of :class:`TrackConfig` that replace those of ``config``.

    Raises:
        UsageError: a setting or an address that cannot be. TypeError: a setting that does not exist.
        InputError: anything wrong with the scene, the subject, the source or who is told; or a package is missing.
    """
    reporter, counts = reporter or Reporter(), dict.fromkeys(("frames", "dropped", "lost"), 0)
    file = None if record is None else new_file(record, *USD_SUFFIXES, force=force or recover)
    if recover:
        if file is None:
            raise UsageError("--recover needs --record, the file of the recording that was killed")
        finish(file)
        return LiveReport(**counts, delay_ms=(np.nan, np.nan, np.nan))
    if file is not None and frames_beside(file).exists() and not force:
        raise InputError(file, "a recording that was killed lies here", "give --recover to keep it, or --force")
    loaded = load_scene(scene, live=True) if source and not isinstance(scene, Scene) else scene_from(scene, frames)
    chosen = effective(TrackConfig, loaded.settings("track"), settings, config)
    if chosen.runs != 1:
        raise UsageError(f"--runs must be 1 to track live, got {chosen.runs}")
    start_warp(chosen.device)
    subject = _subject(loaded, subject, bool(source), chosen, reporter)
    reporter.note(f"live: {describe(chosen, loaded.track, settings)}")

    rig, rate = loaded.rig(chosen.scale), loaded.fps if source else loaded.rate
    times: dict[int, float] = {}  # of the frames that are not smoothed yet
    silent: set[str] = set()
    delays = deque[float](maxlen=_DELAYS)
    nothing = [np.zeros((height, width), bool) for width, height in rig.size]
    with ExitStack() as stack, arguments_checked():
        senders = [stack.enter_context(closing(open_sender(address, subject, rig, rate))) for address in to]
        grown = None if file is None else stack.enter_context(GrowingResult(file, subject, rig, rate, chosen))
        tracker = stack.enter_context(LiveTracker(subject, rig, rate, chosen))
        coming = stack.enter_context(closing(newest(arrivals(loaded, chosen.scale, source))))
        seen = 0.0

        def tell(frame: LiveFrame, moment: float, smooth: bool) -> None:
            packet = Packet(frame, subject, moment, smooth, counts["dropped"])
            for sender in senders:
                sender.send(packet)

        def tell_smoothed(frame: LiveFrame) -> None:
            nonlocal seen
            seen = times.pop(frame.number, seen + 1 / rate)  # one that was dropped comes after the one before it
            tell(frame, seen, True)
            if grown is not None:
                grown.add(frame)

        gc.collect()
        gc.freeze()  # looking through all that is there by now takes 80 ms, and finds nothing
        try:
            last = None
            for arrival in coming:
                now_silent = {rig.names[k] for k, mask in enumerate(arrival.masks) if mask is None}
                for name in sorted(now_silent ^ silent):
                    what = "sends nothing, and is lost" if name in now_silent else "is back"
                    reporter.note(f"live: frame {arrival.number}: camera {name} {what}")
                silent = now_silent
                counts["dropped"] += 0 if last is None else arrival.number - last - 1
                last, times[arrival.number] = arrival.number, arrival.time
                masks = [empty if mask is None else mask for mask, empty in zip(arrival.masks, nothing, strict=True)]
                frame = tracker.step(arrival.number, masks)
                counts["frames"] += 1
                counts["lost"] += frame.status[0] == "lost"
                tell(frame, arrival.time, False)
                delays.append(1000 * (time.time() - arrival.time))
                for each in tracker.smoothed():
                    tell_smoothed(each)
        except KeyboardInterrupt:  # as most sessions end
            reporter.note("live: stopped")
        for each in tracker.rest():
            tell_smoothed(each)
    median, late, most = np.percentile(delays or [np.nan], [50, 99, 100]).tolist()
    return LiveReport(**counts, delay_ms=(median, late, most))


def _subject(
    scene: Scene, given: Subject | str | Path | None, is_to_come: bool, config: TrackConfig, reporter: Reporter
) -> Subject:
    """Who is tracked, with what the scene says is attached."""
    known = given or scene.subject
    if known is None and is_to_come:
        remedy = "fit one to a recording with mmocap fit, and give it as --subject"
        raise InputError(scene.path, "names no subject, and what is to come cannot be fitted to", remedy)
    if known is None:
        known = fit(scene, device=config.device, threads=config.threads, reporter=reporter)
    subject, notes = subject_carrying(known if isinstance(known, Subject) else read_subject(known), scene.attached)
    for note in notes:
        reporter.note(f"attach: {note}")
    return subject
