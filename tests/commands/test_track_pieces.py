"""A clip in pieces: together they are its track, whatever happens to one of them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recordings import write_recording

import mmocap_warp as mm
from mmocap_warp.body.skeleton import ROOT_ANGLES
from mmocap_warp.cli import main
from mmocap_warp.commands import track, track_pieces
from mmocap_warp.errors import InputError, UsageError
from mmocap_warp.formats.usd.usd_result import read_result
from mmocap_warp.jobs.engine import Death, EngineLost, Ready
from mmocap_warp.result.result import Result

FRAMES, SETTINGS = 124, {"device": "cpu", "threads": 2, "trust_cameras": True}


@pytest.fixture(scope="module")
def scene(tmp_path_factory) -> mm.Scene:
    folder = tmp_path_factory.mktemp("clip")
    write_recording(folder, FRAMES, speed=0.5)
    return mm.load_scene(folder)


@pytest.fixture(scope="module")
def whole(scene) -> Result:
    return mm.track(scene, **SETTINGS)


PIECES: dict[tuple[str, int], list] = {}  # what was made of one before


class Here:
    """Tracks in this process; of what a script names by the frame that a piece begins with, it makes something else."""

    def __init__(self, script: dict[int, list] | None = None) -> None:
        self.script, self._events, self.given = script or {}, [(0, Ready("here"))], []

    def __call__(self, make, places, threads) -> Here:
        self._worker = make(places[0], threads)
        return self

    def submit(self, worker: int, job: track_pieces.Piece) -> None:
        self.given.append(job.scene.first_frame)
        if fates := self.script.get(job.scene.first_frame):
            fate = fates.pop(0)
            if isinstance(fate, Death):
                self._events += [(worker, fate), (worker, Ready("here"))]
                return
            self._events += [(worker, fate(self._made(job)[-1]) if fate else None)]
        else:
            self._events += [(worker, event) for event in self._made(job)]

    def _made(self, job: track_pieces.Piece) -> list:
        if job.checkpoint:
            return [*self._worker.work(job)]
        if (place := (str(job.scene.path), job.scene.first_frame)) not in PIECES:
            PIECES[place] = [*self._worker.work(job)]
        return PIECES[place]

    def events(self, seconds: float) -> list:
        if not self._events:
            raise EngineLost("nothing comes any more")
        return [self._events.pop(0)]

    def close(self) -> None:
        pass


def in_two(scene: mm.Scene, monkeypatch, script: dict[int, list] | None = None) -> tuple[Result, list[str], list[int]]:
    """The scene tracked in two pieces by this process, what was noted, and the first frames of what was asked for."""
    here, notes = Here(script), []
    monkeypatch.setattr(track_pieces, "LocalEngine", here)

    class Heard(mm.Reporter):
        def note(self, line: str) -> None:
            notes.append(line)

    result = mm.track(scene, pieces=2, reporter=Heard(), **SETTINGS)
    return result, [line for line in notes if line.startswith("pieces")], here.given


def apart(one: Result, other: Result) -> np.ndarray:
    """(frame,) how far apart the joints are that are farthest [m]."""
    return np.linalg.norm(one.joints() - other.joints(), axis=3)[0].max(axis=1)


SECOND = FRAMES // 2 - 15  # where the second piece begins


@pytest.mark.parametrize("stride", [1, 2])
def test_pieces_cover_the_clip_and_share_half_a_second(scene, stride):
    part = scene.of_frames(scene.frames[4::stride])
    spans = track_pieces.spans_of(part, 2) if stride == 1 else track_pieces.spans_of(part, 1)
    assert spans[0][0] == 4
    assert spans[-1][-1] == part.frames[-1]
    assert {step for span in spans for step in (span.step,)} == {stride}
    if stride == 1:
        assert len(range(spans[1].start, spans[0].stop)) == 30
    with pytest.raises(UsageError, match=r"pieces must be in 1 \.\. "):
        track_pieces.spans_of(part, 3)
    with pytest.raises(UsageError, match="got 0"):
        track_pieces.spans_of(part, 0)


def test_processes_track_it_and_leave_nothing(scene, whole, tmp_path):
    output = tmp_path / "r.usdc"
    assert (
        main(["track", str(scene.path), "-o", str(output), "--pieces", "2", "--threads", "2", "--trust-cameras"]) == 0
    )
    result = read_result(output)
    assert result.frame_numbers.tolist() == whole.frame_numbers.tolist()
    assert (apart(result, whole)[: SECOND - 5] < 1e-3).all()  # the first piece has seen the same
    assert apart(result, whole).max() < 0.04
    assert (result.config["pieces"], result.config["threads"]) == (2, 2)
    assert [file.name for file in tmp_path.iterdir()] == ["r.usdc"]


def test_pieces_that_agree_meet_where_they_are_nearest(scene, whole, monkeypatch):
    result, notes, given = in_two(scene, monkeypatch)
    assert (notes, given) == ([], [0, SECOND])
    assert apart(result, whole).max() < 0.04
    steps = np.linalg.norm(np.diff(result.joints()[0], axis=0), axis=2).max(axis=1)
    assert steps[SECOND:].max() < 1.1 * steps[:SECOND].max()


@pytest.mark.parametrize(
    "fate", [None, lambda result: replace(result, pose=result.pose + np.eye(1, result.pose.shape[2]) * 0.3)]
)
def test_a_piece_that_finds_nobody_or_leads_elsewhere_follows_the_one_before(scene, whole, monkeypatch, fate):
    result, notes, _ = in_two(scene, monkeypatch, {SECOND: [fate]})
    assert notes == [f"pieces: from frame {SECOND} on the previous piece is continued"]
    assert apart(result, whole).max() < 0.04


def test_a_piece_that_explains_the_masks_better_is_right(scene, whole, monkeypatch):
    def astray(result: Result) -> Result:
        return replace(result, pose=result.pose + np.eye(1, result.pose.shape[2]) * 0.3, cost=2 * result.cost)

    result, notes, _ = in_two(scene, monkeypatch, {0: [astray]})
    assert notes == []
    assert (apart(result, whole)[-50:] < 0.04).all()
    assert (apart(result, whole)[:40] > 0.29).all()


def test_a_process_that_dies_is_replaced_once(scene, whole, monkeypatch):
    result, notes, given = in_two(scene, monkeypatch, {SECOND: [Death("lightning")]})
    assert (notes, given) == ([], [0, SECOND, SECOND])
    assert apart(result, whole).max() < 0.04
    # What kills two of them is done here, and so is all that is left where no process lives.
    result, notes, given = in_two(scene, monkeypatch, {SECOND: [Death("lightning")] * 2})
    assert (len(notes), given) == (1, [0, SECOND, SECOND])
    assert apart(result, whole).max() < 0.04


def test_where_no_process_can_be_started_it_is_tracked_here(scene, whole, monkeypatch):
    def none(*_) -> None:
        raise EngineLost("no process can be started here")

    monkeypatch.setattr(track_pieces, "LocalEngine", none)
    assert apart(mm.track(scene, pieces=2, **SETTINGS), whole).max() < 0.04


def test_what_is_wrong_with_a_piece_is_said(scene, monkeypatch, tmp_path):
    write_recording(tmp_path, FRAMES, speed=0.5)
    last = sorted((tmp_path / "masks").rglob(f"*{FRAMES - 1:04d}*"))[0]
    last.unlink()
    last.write_bytes(b"no image")
    with pytest.raises(InputError, match=last.name):
        in_two(mm.load_scene(tmp_path), monkeypatch)


def interrupted(*_) -> None:
    raise KeyboardInterrupt


@pytest.mark.nightly
def test_an_interrupted_run_goes_on_with_all_of_its_pieces(scene, monkeypatch, tmp_path):
    at_once, _, _ = in_two(scene, monkeypatch)
    output = tmp_path / "r.usdc"
    with monkeypatch.context() as patch:
        patch.setattr(track, "write_result", interrupted)
        patch.setattr(track_pieces, "LocalEngine", Here({SECOND: [lambda result: None]}))
        with pytest.raises(KeyboardInterrupt):
            mm.track(scene, pieces=2, output=output, **SETTINGS)
    kept = [f"r.usdc.checkpoint{name}" for name in ("", ".1", ".again.1")]
    assert sorted(file.name for file in tmp_path.iterdir()) == kept
    with pytest.raises(InputError, match="--resume"):
        mm.track(scene, pieces=2, output=output, **SETTINGS)
    with pytest.raises(InputError, match="frames"):
        mm.track(scene, output=output, resume=True, **SETTINGS)
    monkeypatch.setattr(track_pieces, "LocalEngine", Here())
    # Another run's checkpoint of a later piece is refused too: it is not tracked in another way instead.
    first, second = (tmp_path / name for name in kept[:2])
    its_own = second.read_bytes()
    second.write_bytes(first.read_bytes())
    with pytest.raises(InputError, match=r"checkpoint\.1: .* differs in its frames"):
        mm.track(scene, pieces=2, output=output, resume=True, **SETTINGS)
    second.write_bytes(its_own)
    monkeypatch.setattr(track_pieces, "LocalEngine", Here())
    result = mm.track(scene, pieces=2, output=output, resume=True, **SETTINGS)
    assert [file.name for file in tmp_path.iterdir()] == ["r.usdc"]
    assert result.pose.tobytes() == at_once.pose.tobytes()


def test_the_roots_angles_go_on_over_a_meeting(scene, whole):
    """Somebody who has turned round has angles of a whole turn more than a piece that begins there."""
    piece = track_pieces.Piece(scene.of_frames(range(40, FRAMES)), whole.subject, True, mm.TrackConfig(), None, {})
    turned = whole.pose.copy()
    turned[:, :, ROOT_ANGLES.start] += 2 * np.pi
    turned[:, :, ROOT_ANGLES.stop - 1] -= 2 * np.pi
    before, after = replace(whole, pose=turned).at(range(60)), whole.at(range(40, FRAMES))
    parts = track_pieces._met(piece, before, after)
    assert [part.frame_numbers[0] for part in parts][1] == parts[0].frame_numbers[-1] + 1
    together = track_pieces._together(parts, mm.TrackConfig())
    np.testing.assert_allclose(together.pose, turned, atol=1e-9)
    assert (np.abs(np.diff(together.pose[0, :, ROOT_ANGLES], axis=0)) < 1).all()


def test_views_that_a_piece_did_without_are_those_of_its_frames(whole):
    name = whole.cameras.names[0]
    first, second = whole.at(range(60)), whole.at(range(60, FRAMES))
    first = replace(first, config=first.config | {"moved_views": {name: [58, 59, 60, 61]}})
    second = replace(second, config=second.config | {"moved_views": {name: [59, 60, 70]}})
    together = track_pieces._together([first, second], mm.TrackConfig())
    assert together.config["moved_views"] == {name: [58, 59, 60, 70]}
    assert "frozen_views" not in together.config


def test_what_is_solved_anew_has_no_pieces(scene, tmp_path):
    with pytest.raises(UsageError, match="again cannot be given with pieces"):
        mm.track(scene, again=tmp_path / "r.usdc", frames="0:5", pieces=2)


def test_a_checkpoint_of_each_piece():
    names = [file.name for file in track_pieces.checkpoints(Path("r.usdc.checkpoint"), 2)]
    assert names == [
        "r.usdc.checkpoint",
        "r.usdc.checkpoint.1",
        "r.usdc.checkpoint.again.0",
        "r.usdc.checkpoint.again.1",
    ]
