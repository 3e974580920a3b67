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
from mmocap_warp.commands.outputs import releases_locks
from mmocap_warp.commands.track import fit
from mmocap_warp.errors import InputError, UsageError
from mmocap_warp.formats.usd.usd_body import read_subject
from mmocap_warp.rigging.attaching import subject_carrying
from mmocap_warp.scene.recording import Scene
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.streaming.arrivals import Arrival, Newest, arrivals
from mmocap_warp.streaming.packets import packet_maker
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
        delay_ms: (3,) median, 99th percentile and most of the time from a frame's masks to its packet being sent [ms],
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
    frames: Frames = None,
    reporter: Reporter | None = None,
    **settings: Any,
) -> LiveReport:
    """Track while frames come, and tell other programs of each frame twice: at once, and smoothed up to 9 frames later.

    It goes on until the source ends or it is interrupted.

    Args:
        scene: the recording, or its file or folder: cameras, and how masks are made.
        subject: the fitted subject to track, or its file. [default: the scene's, or else one is fitted to its files]
        config: settings. [default: those of the scene's [track] table]
        source: where frames come from: a folder with a growing folder of numbered images for each camera, a ZMQ address
            such as tcp://127.0.0.1:5555, or for each camera what OpenCV opens, a number or an address such as
            rtsp://... [default: the scene's own files, at their pace]
        to: who is told: tcp://127.0.0.1:5556 (ZMQ).
        frames: which of the recording's frames. [default: those that the scene names]
        reporter: who is told of notes.
        settings: fields of :class:`TrackConfig` that replace those of ``config``.

    Raises:
        UsageError: a setting or an address that cannot be. TypeError: a setting that does not exist.
        InputError: anything wrong with the scene, the subject, the source or who is told; or a package is missing.
    """
    reporter = reporter or Reporter()
    if source and isinstance(scene, str | Path):
        loaded = load_scene(scene, live=True)
    else:
        loaded = scene_from(scene, frames, None, reporter)
    chosen = effective(TrackConfig, loaded.settings("track"), settings, config)
    if chosen.runs != 1:
        raise UsageError(f"--runs must be 1 to track live, got {chosen.runs}")
    start_warp(chosen.device)
    subject = _subject(loaded, subject, source, chosen, reporter)
    reporter.note(f"live: {describe(chosen, loaded.track, settings)}")
    with ExitStack() as stack, arguments_checked():
        senders = [stack.enter_context(closing(open_sender(address))) for address in to]
        rig, rate = loaded.rig(chosen.scale), loaded.fps if source else loaded.rate
        tracker = stack.enter_context(LiveTracker(subject, rig, rate, chosen))
        newest = stack.enter_context(closing(Newest(arrivals(loaded, chosen.scale, source))))
        session = _Session(subject, rate, [np.zeros((height, width), bool) for width, height in rig.size])
        gc.collect()
        gc.freeze()  # looking through all that is there by now takes 80 ms, and finds nothing
        try:
            for arrival in newest:
                session.note_cameras(arrival, loaded.calibrated.names, reporter)
                frame = tracker.step(arrival.number, session.taken(arrival))
                session.tell(frame, False, senders)
                session.delays.append(time.time() - arrival.time)
                for each in tracker.smoothed():
                    session.tell(each, True, senders)
        except KeyboardInterrupt:  # as most sessions end
            reporter.note("live: stopped")
        for each in tracker.rest():
            session.tell(each, True, senders)
    return session.report()


def _subject(
    scene: Scene, given: Subject | str | Path | None, source: tuple[str, ...], config: TrackConfig, reporter: Reporter
) -> Subject:
    """Who is tracked, with what the scene says is attached."""
    known = given or scene.subject
    if known is None and source:
        remedy = "fit one to a recording with mmocap fit, and give it as --subject"
        raise InputError(scene.path, "names no subject, and what comes is not there yet to fit one to", remedy)
    if known is None:
        known = fit(scene, device=config.device, threads=config.threads, reporter=reporter)
    subject, notes = subject_carrying(known if isinstance(known, Subject) else read_subject(known), scene.attached)
    for note in notes:
        reporter.note(f"attach: {note}")
    return subject


class _Session:
    """What is remembered of a session from frame to frame.

    Args:
        subject: who is tracked.
        rate: frames a second.
        nothing: an empty mask for each camera.
    """

    def __init__(self, subject: Subject, rate: float, nothing: list[np.ndarray]) -> None:
        self._packet, self._period, self._nothing = packet_maker(subject), 1.0 / rate, nothing
        self._times: dict[int, float] = {}  # of frames that are not smoothed yet
        self._smoothed_time, self._last = 0.0, -1
        self._silent: set[str] = set()
        self._frames = self._dropped = self._lost = 0
        self.delays: deque[float] = deque(maxlen=_DELAYS)

    def taken(self, arrival: Arrival) -> list[np.ndarray]:
        """A frame's masks."""
        self._dropped += arrival.number - self._last - 1 if self._frames else 0
        self._frames, self._last = self._frames + 1, arrival.number
        self._times[arrival.number] = arrival.time
        pairs = zip(arrival.masks, self._nothing, strict=True)
        return [nothing if mask is None else mask for mask, nothing in pairs]

    def note_cameras(self, arrival: Arrival, names: list[str], reporter: Reporter) -> None:
        """Say which cameras stopped, and which are back."""
        silent = {name for name, mask in zip(names, arrival.masks, strict=True) if mask is None}
        for name in sorted(silent ^ self._silent):
            what = "sends nothing, and is lost" if name in silent else "is back"
            reporter.note(f"live: frame {arrival.number}: camera {name} {what}")
        self._silent = silent

    def tell(self, frame: LiveFrame, smooth: bool, senders: list[Any]) -> None:
        """Send a frame's packet."""
        if smooth:  # a frame that was dropped has its time from the one before
            self._smoothed_time = self._times.pop(frame.number, self._smoothed_time + self._period)
        else:
            self._lost += frame.status[0] == "lost"
        moment = self._smoothed_time if smooth else self._times[frame.number]
        packet = self._packet(frame, moment, smooth, self._dropped)
        for sender in senders:
            sender.send(packet)

    def report(self) -> LiveReport:
        """What came of it."""
        delays = 1000.0 * np.array(self.delays or [np.nan])
        median, late, worst = (float(each) for each in np.percentile(delays, [50, 99, 100]))
        return LiveReport(self._frames, self._dropped, self._lost, (median, late, worst))
