"""A long clip in pieces that processes of their own track side by side: ``mmocap track --pieces``."""

from collections import Counter, deque
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import cycle, islice
from pathlib import Path
from typing import Any, Self

import numpy as np

from mmocap_warp.body.model import Subject
from mmocap_warp.body.skeleton import ROOT_ANGLES
from mmocap_warp.commands.caller import Progress, Reporter
from mmocap_warp.contour.frame.rooted import Rooting
from mmocap_warp.device.cores import available_threads
from mmocap_warp.errors import InputError, UsageError
from mmocap_warp.fitting import subject_fit
from mmocap_warp.fitting.fit_config import KNOWN, FitConfig
from mmocap_warp.jobs.engine import Advance, Death, EngineLost
from mmocap_warp.jobs.local_engine import LocalEngine, local_devices
from mmocap_warp.result.result import Result
from mmocap_warp.result.verdict import PARTS_IN_DOUBT, frames_by_name, frames_marked
from mmocap_warp.scene.recording import Scene
from mmocap_warp.tracking import frame_loop
from mmocap_warp.tracking.track_config import TrackConfig

_SHARED = 0.5  # time that neighbours have in common [s]
_SHORTEST = 1.0  # time of a piece [s]
_APART = 0.05  # distance of a joint from which on neighbours disagree [m], in a body like a person
_BETTER = 0.9  # share of the other's cost that the later of two may have that disagree, and is right
_DEATHS = 2  # of processes, after which their piece is tracked by this one


@dataclass(frozen=True)
class Piece:
    """Consecutive frames of a clip, a worker's job."""

    scene: Scene
    subject: Subject  # who is tracked
    begun: bool  # whether the subject's pose is that of the first frame
    config: TrackConfig
    checkpoint: Path | None
    resumption: dict[str, Any]

    def begin(self) -> Self:
        """The piece from where its body is found; an InputError if its first frame shows nobody."""
        if self.begun:
            return self
        where: dict[str, Any] = {"seed": self.config.seed, "device": self.config.device, "threads": self.config.threads}
        found = subject_fit.fit(self.scene, self.subject.body, FitConfig(**KNOWN | where))
        # Its root counts from a base of its own.
        pose = self.rooting(found.root_base).enter(found.pose[None])
        return self.starting_at(self.rooting().leave(pose, self.subject.pose[ROOT_ANGLES])[0])

    def tracked(self, progress: Progress) -> Result:
        """The piece that has begun, tracked; ``progress`` hears of frames that are done: smoothing is half of them."""
        frames = [0, 0]

        def report(stage: int, done: int) -> None:
            frames[stage] = done
            progress(sum(frames) // 2 if self.config.acceleration else done, self.scene.frame_count)

        reports: dict[str, Any] = {"progress": lambda at, _: report(0, at + 1), "smooth_progress": partial(report, 1)}
        files = {"checkpoint": self.checkpoint, **self.resumption}
        return frame_loop.track(self.scene, self.subject, self.config, **files, **reports)

    def starting_at(self, pose: np.ndarray) -> Self:
        """The piece that begins with a pose (coordinate,)."""
        provenance = self.subject.provenance | {"fit.first_frame": self.scene.first_frame}
        return replace(self, subject=replace(self.subject, pose=pose, provenance=provenance), begun=True)

    def rooting(self, base: np.ndarray | None = None) -> Rooting:
        """What turns poses whose root counts from a base (3, 3), or the subject's, into rooted ones and back."""
        skeleton = self.subject.body.skeleton
        return Rooting(skeleton, self.subject.root_base if base is None else base, skeleton.searched(self.config.dof))


class PieceWorker:
    """Tracks a piece; see :class:`~mmocap_warp.jobs.engine.Worker`."""

    def __init__(self, device: str, threads: int | None = None) -> None:
        self.device, self._threads = device, threads

    def work(self, job: Piece) -> Iterator[Advance | Result | InputError | None]:
        """Track it: yields now and then how far that is, and last the result or an error; None if it cannot begin."""
        here, done = replace(job.config, device=self.device, threads=self._threads), [0]
        try:
            piece = replace(job, config=here).begin()
        except InputError:
            yield None
            return
        with ThreadPoolExecutor(1) as pool:
            tracked = pool.submit(piece.tracked, lambda frames, _: done.append(frames))
            while not wait([tracked], timeout=0.5).done:
                yield Advance("track", done[-1], job.scene.frame_count, 0)
        try:
            yield tracked.result()
        except InputError as error:
            yield error


def track_in_pieces(
    scene: Scene,
    subject: Subject,
    config: TrackConfig,
    spans: list[range],
    reporter: Reporter,
    checkpoint: Path | None,
    **resumption: Any,
) -> Result:
    """Track a scene in the pieces of :func:`spans_of`, each by a process of its own, on the CPU or in turn on the GPUs.

    The first begins with the subject. Others begin where the known body is found, while the one before still goes on,
    and take over in the frame in which both are nearest. Where they stay apart, and the later one does not explain the
    masks better, that one is tracked again from where the one before leads, as is one that could not be begun.

    Raises:
        InputError: see :func:`~mmocap_warp.tracking.frame_loop.track`.
    """
    count, total = len(spans), scene.frame_count
    files = checkpoints(checkpoint, count) if checkpoint else [None] * (2 * count)
    pieces = [
        Piece(replace(scene.of_frames(span), attached=()), subject, k == 0, config, files[k], resumption)
        for k, span in enumerate(spans)
    ]
    with reporter.stage("track") as progress:
        results = _side_by_side(pieces, lambda done: progress(min(done, total), total))
    parts: list[Result] = []
    for k, piece in enumerate(pieces):
        result = results.get(k)
        if result is None or (parts and _leads_elsewhere(parts[-1], result)):
            if parts:
                first, before = piece.scene.first_frame, parts[-1]
                reporter.note(f"pieces: from frame {first} on the previous piece is continued")
                pose = before.pose[before.best_run, before.frame_numbers.tolist().index(first)]
                piece = replace(piece.starting_at(pose), checkpoint=files[count + k])
            with reporter.stage("track again") as progress:
                result = piece.tracked(progress)
        parts[-1:] = _met(piece, parts[-1], result) if parts else [result]
    return _together(parts, config)


def spans_of(scene: Scene, count: int) -> list[range]:
    """The frames of so many pieces by the recording's numbers; a UsageError if the clip is too short for them."""
    total, half = scene.frame_count, max(1, round(_SHARED * scene.rate / 2))
    most = max(1, int(total / max(_SHORTEST * scene.rate, 4 * half)))
    if not 0 < count <= most:
        raise UsageError(f"--pieces must be in 1 .. {most} for {total} frames, got {count}")
    ends = np.linspace(0, total, count + 1).round().astype(int).tolist()
    return [scene.frames[max(0, ends[k] - half) : ends[k + 1] + half] for k in range(count)]


def checkpoints(first: Path, count: int) -> list[Path]:
    """The checkpoints of so many pieces, of which the ``first`` is given, then those of pieces tracked again."""
    later = (first.with_name(f"{first.name}.{name}{k}") for name in ("", "again.") for k in range(count))
    return [first, *islice(later, 1, None)]


def _side_by_side(pieces: list[Piece], progress: Callable[[int], None]) -> dict[int, Result | None]:
    """What processes make of pieces, by number, but of those on which two of them have died; an InputError of one."""
    threads = pieces[0].config.threads or available_threads()
    count = min(len(pieces), threads)
    places = [*islice(cycle(local_devices(pieces[0].config.device)), count)]
    waiting, doing, deaths = deque(range(len(pieces))), dict[int, int](), Counter[int | None]()
    done, results = Counter[int](), dict[int, Result | None]()
    with suppress(EngineLost), closing(LocalEngine(PieceWorker, places, threads // count)) as engine:
        while waiting or doing:
            for worker, event in engine.events(1.0):
                if isinstance(event, Advance):
                    done[doing[worker]] = event.done
                    continue
                if isinstance(event, InputError):
                    raise event
                number = doing.pop(worker, None)  # none of a worker that has started, or waited
                if isinstance(event, Death):
                    deaths[number] += 1
                    if number is not None and deaths[number] < _DEATHS:
                        waiting.appendleft(number)
                    continue
                if number is not None:
                    results[number], done[number] = event, pieces[number].scene.frame_count
                if waiting:
                    doing[worker] = waiting.popleft()
                    engine.submit(worker, pieces[doing[worker]])
            progress(done.total())
    return results


def _meeting(before: Result, after: Result) -> tuple[int, float]:
    """The number of the frame in which two neighbours are nearest, and how far apart joints are there at most [m].

    Ends of what they share do not count: there one of them has seen little of what comes before or after.
    """
    numbers, ours, theirs = np.intersect1d(before.frame_numbers, after.frame_numbers, return_indices=True)
    ends = len(numbers) // 4
    inner = slice(ends, len(numbers) - ends)
    one, other = before.at(ours[inner].tolist()).joints(), after.at(theirs[inner].tolist()).joints()
    apart = np.linalg.norm(one - other, axis=3).max(axis=(0, 2))
    return int(numbers[inner][apart.argmin()]), float(apart.min())


def _leads_elsewhere(before: Result, after: Result) -> bool:
    """Whether two neighbours stay apart, and the later one does not explain the masks better."""
    pairs = (before, after), (after, before)
    costs = [np.nansum(one.cost[:, np.isin(one.frame_numbers, other.frame_numbers)]) for one, other in pairs]
    apart = _meeting(before, after)[1] > _APART * after.subject.body.relative_size
    return bool(apart and costs[1] >= _BETTER * costs[0])


def _met(piece: Piece, before: Result, after: Result) -> list[Result]:
    """Two neighbours up to the frame, and from it on, in which they are nearest; the ``piece`` is the later one."""
    number, apart = _meeting(before, after)
    last, first = (int(np.searchsorted(each.frame_numbers, number)) for each in (before, after))
    # Somebody turns on and on: the root's angles go on from those of before.
    rooting, near = piece.rooting(), before.pose[:, last, ROOT_ANGLES]
    poses: dict[str, Any] = {}
    for name in ("pose", "raw_pose"):
        if (pose := getattr(after, name)) is not None:
            runs = zip(pose[:, first:], near, strict=True)
            new = [rooting.leave(rooting.enter(run), angles) for run, angles in runs]
            poses[name] = np.concatenate([pose[:, :first], new], axis=1)
    # What is left of a distance fades, so that nothing jumps.
    if apart <= _APART * after.subject.body.relative_size:
        fading = poses["pose"][:, first : len(before.frame_numbers) - last + first]
        fading += (before.pose[:, last] - fading[:, 0])[:, None] * np.linspace(1, 0, fading.shape[1])[:, None]
    rest = replace(after, **poses)
    return [before.at(range(last)), rest.at(range(first, len(after.frame_numbers)))]


def _together(parts: list[Result], config: TrackConfig) -> Result:
    """One result of consecutive ones."""
    columns = {name: [part.arrays[name] for part in parts] for name in parts[0].arrays}
    arrays: dict[str, Any] = {name: np.concatenate(each, axis=1) for name, each in columns.items()}
    numbers = np.concatenate([part.frame_numbers for part in parts])
    seconds = sum(part.seconds for part in parts)
    whole = replace(parts[0], frame_numbers=numbers, seconds=seconds, **arrays)
    own = whole.config | {"pieces": len(parts), "threads": config.threads}
    # Views that a part did without, and parts of the body that are in doubt there.
    body_parts = whole.subject.body.skeleton.parts
    for why, names in (("frozen_views", None), ("moved_views", None), (PARTS_IN_DOUBT, body_parts)):
        if any(why in part.config for part in parts):
            own[why] = frames_by_name(whole, np.concatenate([frames_marked(part, why, names) for part in parts]), names)
    return replace(whole, config=own)
