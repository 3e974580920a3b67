"""Tracking while a recording is made: ``mmocap live``."""

import gc
import math
import time
from collections import deque
from collections.abc import Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mmocap_warp.body.model import Subject
from mmocap_warp.cameras.rig import CameraRig
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
from mmocap_warp.streaming.arrivals import Arrival, arrivals, newest
from mmocap_warp.streaming.growing_result import GrowingResult, finish
from mmocap_warp.streaming.senders import Packet, open_sender
from mmocap_warp.tracking.live import LiveFrame, LiveTracker
from mmocap_warp.tracking.track_config import TrackConfig

_DELAYS = 10_000  # frames whose delays are reported: the last ones
_About = tuple[Subject, CameraRig, float]  # who is tracked, the cameras, and frames a second


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

    frames: int = 0
    dropped: int = 0
    lost: int = 0
    delay_ms: tuple[float, float, float] = (math.nan,) * 3


@releases_locks
def live(
    scene: Scene | str | Path,
    subject: Subject | str | Path | None = None,
    config: TrackConfig | None = None,
    *,
    source: tuple[str, ...] = (),
    to: tuple[str, ...] = (),
    record: str | Path | None = None,
    frames: Frames = None,
    force: bool = False,
    reporter: Reporter | None = None,
    **settings: Any,
) -> LiveReport:
    """Track while frames come, and send each pose to other programs twice: at once, and smoothed up to 9 frames later.

    Args:
        scene: the recording, or its file or folder: cameras, and how masks are made.
        subject: the fitted subject to track, or its file. [default: the scene's, or else one is fitted to its files]
        config: settings. [default: those of the scene's [track] table]
        source: where frames come from: a folder in which one of numbered images grows for each camera, a ZMQ address
            such as tcp://127.0.0.1:5555, or for each camera what OpenCV opens, a number or an address such as
            rtsp://... [default: the scene's own files, at their pace]
        to: who listens: tcp://HOST:PORT (ZMQ), ws://HOST:PORT (WebSocket, and a page to look at), vmc://HOST:PORT or
            vmc://HOST:PORT?smooth (VMC by OSC), lsl://NAME (LSL).
        record: a result's file that is written as it goes: .usdc, .usda or .usd. If a session is killed, the next one
            with the same file makes a result of its frames first.
        frames: which of the recording's frames. [default: those that the scene names]
        force: replace a result that exists.
        reporter: receives notes.
        settings: fields of :class:`TrackConfig` that replace those of ``config``.

    Raises:
        UsageError: a setting or an address that cannot be. TypeError: a setting that does not exist.
        InputError: anything wrong with the scene, the subject, the source or an address; or a package is missing.
    """
    reporter = reporter or Reporter()
    file = None if record is None else new_file(record, *USD_SUFFIXES, force=True)
    if file is not None:
        if finish(file):
            reporter.note(f"{file}: holds the frames of a session that was killed")
        new_file(file, file.suffix, force=force)
    loaded = load_scene(scene, live=True) if source and not isinstance(scene, Scene) else scene_from(scene, frames)
    chosen = effective(TrackConfig, loaded.settings("track"), settings, config)
    if chosen.runs != 1:
        raise UsageError(f"--runs must be 1 to track live, got {chosen.runs}")
    start_warp(chosen.device)
    known = _subject(loaded, subject, bool(source), chosen, reporter)
    reporter.note(f"live: {describe(chosen, loaded.track, settings)}")

    about = known, loaded.rig(chosen.scale), loaded.fps if source else loaded.rate
    with ExitStack() as stack:
        listeners = [stack.enter_context(closing(open_sender(address, *about))) for address in to]
        if file is not None:
            listeners.append(stack.enter_context(closing(GrowingResult(file, *about, chosen))))
        with arguments_checked():
            tracker = stack.enter_context(closing(LiveTracker(*about, chosen)))
        coming = stack.enter_context(closing(newest(arrivals(loaded, chosen.scale, source))))
        gc.collect()
        stack.callback(gc.unfreeze)
        gc.freeze()  # looking through all that is there by now takes 80 ms, and finds nothing
        return _track(tracker, coming, listeners, about, reporter)


def _track(
    tracker: LiveTracker, coming: Iterator[Arrival], listeners: list[Any], about: _About, reporter: Reporter
) -> LiveReport:
    """Track what is coming, and send it to listeners."""
    (subject, rig, rate), report, seen, last, silent = about, LiveReport(), 0.0, None, set[str]()
    times: dict[int, float] = {}  # of the frames that are not smoothed yet
    delays = deque[float](maxlen=_DELAYS)
    nothing = [np.zeros((height, width), bool) for width, height in rig.size]

    def tell(frame: LiveFrame, smooth: bool) -> None:
        nonlocal seen
        if smooth:  # a frame that was dropped came after the one before it
            seen = times.pop(frame.number, seen + 1 / rate)
        packet = Packet(frame, subject, seen if smooth else times[frame.number], smooth, report.dropped)
        for each in listeners:
            each.send(packet)

    try:
        for arrival in coming:
            now_silent = {rig.names[k] for k, mask in enumerate(arrival.masks) if mask is None}
            for name in sorted(now_silent ^ silent):
                what = "sends nothing, and is lost" if name in now_silent else "is back"
                reporter.note(f"live: frame {arrival.number}: camera {name} {what}")
            masks = [empty if mask is None else mask for mask, empty in zip(arrival.masks, nothing, strict=True)]
            gap = 0 if last is None else arrival.number - last - 1
            times[arrival.number], last, silent = arrival.time, arrival.number, now_silent
            frame = tracker.step(arrival.number, masks)
            lost = report.lost + (frame.status[0] == "lost")
            report = LiveReport(report.frames + 1, report.dropped + gap, lost)
            tell(frame, False)
            delays.append(1000 * (time.time() - arrival.time))
            for each in tracker.smoothed():
                tell(each, True)
    except KeyboardInterrupt:  # as most sessions end
        reporter.note("live: stopped")
    for each in tracker.rest():
        tell(each, True)
    median, late, most = np.percentile(delays or [np.nan], [50, 99, 100]).tolist()
    return replace(report, delay_ms=(median, late, most))


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
