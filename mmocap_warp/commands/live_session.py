"""Tracking while a recording is made: ``mmocap live``."""

import gc
import math
import time
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, closing
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from mmocap_warp.body.model import Subject
from mmocap_warp.commands.caller import Reporter, arguments_checked, describe, start_warp
from mmocap_warp.commands.inputs import Frames, scene_from, scene_reference, track_settings
from mmocap_warp.commands.outputs import new_file, releases_locks
from mmocap_warp.commands.track import fit
from mmocap_warp.commands.track_people import everybody, file_of
from mmocap_warp.device.cores import waits_awake
from mmocap_warp.device.resolve import resolve_device
from mmocap_warp.errors import InputError, UsageError
from mmocap_warp.formats.usd.usd_body import read_subject
from mmocap_warp.formats.usd.usd_file import USD_SUFFIXES
from mmocap_warp.formats.usd.usd_people import write_people
from mmocap_warp.formats.usd.usd_result import read_result
from mmocap_warp.rigging.attaching import subject_carrying
from mmocap_warp.scene.recording import Scene
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.streaming.arrivals import Arrival, arrivals, newest
from mmocap_warp.streaming.growing_result import GrowingResult, finish
from mmocap_warp.streaming.senders import Packet, open_sender
from mmocap_warp.tracking.frame_loop import check_start
from mmocap_warp.tracking.live_process import Answers, Trackers, make_live
from mmocap_warp.tracking.live_smoothing import LiveFrame
from mmocap_warp.tracking.track_config import TrackConfig

_DELAYS = 10_000  # frames whose delays are reported: the last ones


@dataclass(frozen=True)
class LiveReport:
    """What came of a live session."""

    frames: int = 0  #: that were tracked
    dropped: int = 0  #: that were left out, because a frame before took too long or they never came
    lost: int = 0  #: of those tracked, in how many somebody was lost at once
    #: median, 99th percentile and most of the time from a frame's being seen to its packet being sent [ms], of the last
    #: 10,000 frames; NaN where there was none
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
    person: str | None = None,
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
            with the same file makes a result of its frames first. Of several people each has an own file beside it.
        frames: which of the recording's frames. [default: those that the scene names]
        person: who is meant of the scene's people, by name, or all. [default: the scene's, or all]
        force: replace a result that exists.
        reporter: receives notes.
        settings: fields of :class:`TrackConfig` that replace those of ``config``.

    Raises:
        UsageError: a setting or an address that cannot be. TypeError: a setting that does not exist.
        InputError: anything wrong with the scene, the subject, the source or an address; or a package is missing.
    """
    if source and frames is not None:
        raise UsageError("--frames are of the scene's own files: leave it or --source out")
    reporter = reporter or Reporter()
    loaded = load_scene(scene, live=True) if source and not isinstance(scene, Scene) else scene_from(scene, frames)
    scenes = _scenes(loaded, person, subject)
    chosen = track_settings(loaded, settings, config, seen=not source)
    if chosen.runs != 1:
        raise UsageError(f"--runs must be 1 to track live, got {chosen.runs}")
    is_given = config is not None or "device" in settings
    start_warp(chosen.device, None if is_given else f"{loaded.path}: [track]")
    files = _files(None if record is None else Path(record), [*scenes], force, reporter)
    rig, rate = loaded.rig(chosen.scale), loaded.fps if source else loaded.rate
    subjects = {name: _subject(each, subject, bool(source), chosen, reporter) for name, each in scenes.items()}
    reporter.note(f"live: {describe(chosen, loaded.track, settings)}")

    with ExitStack() as stack:
        if record is not None:
            stack.callback(_write_all, Path(record), files)  # however it ends, once each person's file is whole
        listeners = [stack.enter_context(closing(open_sender(address, subjects, rig, rate))) for address in to]
        people, about = [], []
        for name, known in subjects.items():
            own, hears = (known, rig, rate, chosen), list(listeners)
            if files:
                whose = {"person": name} if source else scene_reference(scenes[name], files[name])
                of = range(1) if source else loaded.frames
                kept = GrowingResult(files[name], known, rig, loaded.fps, chosen, of, whose)
                hears.append(stack.enter_context(closing(kept)))
            people.append(Tracked(name, known, 1 / rate, hears))
            about.append((*own, scenes[name].has_others))
        with arguments_checked():
            trackers = [stack.enter_context(closing(each)) for each in make_live(chosen.device, about)]
            for tracker in trackers:
                tracker.wait()
        awake = len(scenes) == 1 and waits_awake(resolve_device(chosen.device))
        coming = newest(arrivals([*scenes.values()], chosen.scale, source), awake=awake)
        stack.enter_context(closing(coming))
        gc.collect()
        stack.callback(gc.unfreeze)
        gc.freeze()  # looking through all that is there by now takes 80 ms, and finds nothing
        report = follow(people, trackers, coming, rig.names, reporter)
    if record is not None and not report.frames:
        reporter.note(f"live: no frame came, so {record} is not written")
    return report


def _scenes(scene: Scene, person: str | None, subject: object) -> dict[str, Scene]:
    """The scene as each who is tracked in it sees it, by name; of no name where the scene names nobody."""
    if scene.of_several:
        remedy = "let masks give each person a label, or track the recording with mmocap track"
        raise InputError(scene.path, "[labels] several: who is one blob with others cannot be told apart live", remedy)
    if names := everybody(scene, person, subject=subject):
        return {name: scene.of_person(name) for name in names}
    one = scene_from(scene, person=person)
    return {one.person: one}


def _files(record: Path | None, names: list[str], force: bool, reporter: Reporter) -> dict[str, Path]:
    """The file that is written of each person; a file that a killed session left is made whole before."""
    if record is None:
        return {}
    files = {name: record if len(names) == 1 else file_of(record, name) for name in names}
    written = list(dict.fromkeys([record, *files.values()]))
    for file in written:
        new_file(file, *USD_SUFFIXES, force=True)
    if killed := [file for file in files.values() if finish(file)]:
        _write_all(record, files)
    for file in killed:
        reporter.note(f"{file}: holds the frames of a session that was killed")
    for file in written:
        new_file(file, *USD_SUFFIXES, force=force and not killed)
    return files


def _write_all(record: Path, files: dict[str, Path]) -> None:
    """Write the file that refers to several people's own; one person's file is the record itself."""
    results = {name: (file, read_result(file)) for name, file in files.items() if file.exists()}
    if len(files) > 1 and results:
        write_people(record, results)


@dataclass
class Tracked:
    """One who is tracked, and who hears of it."""

    name: str
    subject: Subject
    period: float  # of the frames [s]
    listeners: list[Any]
    times: dict[int, float] = field(default_factory=dict)  # of the frames that are not smoothed yet
    last_time: float = 0.0  # of the frame that was smoothed last

    def tell(self, frame: LiveFrame, time: float, dropped: int) -> None:
        """Say what was found at once of a frame that was seen at a time."""
        self.times[frame.number] = time
        self._send(Packet(frame, self.subject, time, False, dropped, self.name))

    def smoothed(self, frames: Iterable[LiveFrame], dropped: int) -> None:
        """Say what was found of frames once those after them were known."""
        for frame in frames:  # one that was dropped came after the one before it
            self.last_time = self.times.pop(frame.number, self.last_time + self.period)
            self._send(Packet(frame, self.subject, self.last_time, True, dropped, self.name))

    def _send(self, packet: Packet) -> None:
        for each in self.listeners:
            each.send(packet)


def follow(
    people: list[Tracked], trackers: Trackers, coming: Iterator[Arrival], cameras: Sequence[str], reporter: Reporter
) -> LiveReport:
    """Track people in what is coming from cameras of these names, until it ends or Ctrl-C is pressed."""
    report, last, dropped, silent = LiveReport(), None, 0, set[str]()
    failure: InputError | None = None
    delays = deque[float](maxlen=_DELAYS)

    def tell(arrival: Arrival, dropped: int, answers: Sequence[Future[Answers]]) -> None:
        nonlocal report
        found = [each.result() for each in answers]
        frames = [frame for at_once, _ in found for frame in at_once]
        for person, frame in zip(people, frames, strict=True):
            person.tell(frame, arrival.time, dropped)
        report = LiveReport(report.frames + 1, dropped, report.lost + any(f.status[0] == "lost" for f in frames))
        delays.append(1000 * (time.time() - arrival.time))
        for person, smoothed in zip(people, [each for _, later in found for each in later], strict=True):
            person.smoothed(smoothed, dropped)

    with ThreadPoolExecutor(1) as beside:
        told = deque[Future[None]]()
        try:
            for arrival in coming:
                now_silent = {cameras[k] for k in arrival.silent}
                for name in sorted(now_silent ^ silent):
                    what = "sends nothing, and is lost" if name in now_silent else "is back"
                    reporter.note(f"live: frame {arrival.number}: camera {name} {what}")
                dropped += 0 if last is None else arrival.number - last - 1
                seen = iter(arrival.seen)
                answers = [each.step(arrival.number, [*islice(seen, each.count)]) for each in trackers]
                if len(people) == 1:
                    tell(arrival, dropped, answers)
                else:
                    # Where people share a GPU, the next frame is on its way while this one is tracked and sent.
                    told.append(beside.submit(tell, arrival, dropped, answers))
                    if last is None or len(told) > (len(trackers) < len(people)):
                        told.popleft().result()
                last, silent = arrival.number, now_silent
        except KeyboardInterrupt:  # as most sessions end
            reporter.note("live: stopped")
        except InputError as error:  # what was tracked is told before it ends
            failure = error
        for each in told:
            each.result()
    for person, smoothed in zip(people, [each for tracker in trackers for each in tracker.rest()], strict=True):
        person.smoothed(smoothed, dropped)
    if failure is not None:
        raise failure
    median, late, most = np.percentile(delays or [np.nan], [50, 99, 100]).tolist()
    return replace(report, delay_ms=(median, late, most))


def _subject(
    scene: Scene, given: Subject | str | Path | None, is_to_come: bool, config: TrackConfig, reporter: Reporter
) -> Subject:
    """Who is tracked, with what the scene says is attached."""
    known = given or scene.subject
    if known is None and is_to_come:
        remedy = "fit one to a recording with mmocap fit, and give it as --subject"
        raise InputError(scene.path, "names no subject, and live frames cannot be fitted", remedy)
    if known is None:
        known = fit(scene, device=config.device, threads=config.threads, reporter=reporter)
    known = known if isinstance(known, Subject) else read_subject(known)
    if not is_to_come and config.algorithm != "search-contour":  # which alone searches from anywhere
        check_start(scene, known)
    subject, notes = subject_carrying(known, scene.attached)
    for note in notes:
        reporter.note(f"attach: {note}")
    return subject
