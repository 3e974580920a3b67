"""Observations that were put aside come back with their bits, in their order, from memory and from disk."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from mmocap_warp.errors import InputError
from mmocap_warp.masks import observation
from mmocap_warp.masks.observation import KeptObservations, Observation
from mmocap_warp.scene.frame_choice import read_ahead


@pytest.mark.parametrize("in_memory", [2**28, 100])
def test_observations_come_back_as_they_were(monkeypatch, in_memory):
    monkeypatch.setattr(observation, "_IN_MEMORY", in_memory)
    rng = np.random.default_rng(0)
    frames = [
        Observation.from_masks([rng.random((9, 40)) < 0.5, rng.random((7, 33)) < share], late)
        for share, late in ((0.0, None), (0.3, np.array([0.0, 0.01])), (1.0, None))
    ]
    with KeptObservations() as kept:
        for frame in frames:
            kept.add(frame)
        assert len(kept) == 3
        for _ in range(2):
            for was, found in zip(frames, kept, strict=True):
                assert found.words.dtype == was.words.dtype
                np.testing.assert_array_equal(found.words, was.words)
                np.testing.assert_array_equal(found.foreground, was.foreground)
                np.testing.assert_array_equal(found.late, was.late)


def test_where_there_is_no_room_none_are_kept(monkeypatch):
    frame = Observation.from_masks([np.eye(8, dtype=bool)])

    class FullDisk:
        def __init__(self, _size: int) -> None:
            self.writes = 0

        def write(self, data: bytes) -> int:
            self.writes += 1
            if self.writes == 2:
                raise OSError(28, "No space left on device")
            return len(data)

        def seek(self, place: int, whence: int = 0) -> None: ...

        def flush(self) -> None: ...

        def close(self) -> None: ...

    monkeypatch.setattr(observation.tempfile, "SpooledTemporaryFile", FullDisk)
    with KeptObservations() as kept:
        for _ in range(3):
            kept.add(frame)
        assert len(kept) == 0


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="only Linux has a file that is always full")
def test_a_full_disk_is_noticed_at_once(monkeypatch):
    """Not when the masks are read, or the file is closed."""
    frame = Observation.from_masks([np.eye(8, dtype=bool)])
    with open("/dev/full", "r+b") as full:
        monkeypatch.setattr(observation.tempfile, "SpooledTemporaryFile", lambda _size: full)
        with KeptObservations() as kept:
            kept.add(frame)
            assert len(kept) == 0


def test_reading_ahead_gives_the_same_frames_and_then_the_error_of_the_one_that_failed() -> None:
    """What follows the failure is not read, and an end in the middle leaves no thread behind."""
    read: list[int] = []

    def observations(failing: int) -> Iterator[Observation]:
        for number in range(20):
            if number == failing:
                raise InputError("cam1/0007.png", "is no image", "export it again")
            read.append(number)
            yield Observation.from_masks([np.full((2, 40), number % 2 == 0)])

    ahead = read_ahead(observations(failing=7))
    seen = [bool(next(ahead).foreground[0]) for _ in range(7)]
    assert seen == [True, False, True, False, True, False, True]
    with pytest.raises(InputError, match="0007"):
        next(ahead)
    assert read == list(range(7))
    threads = threading.active_count()
    stopped = read_ahead(observations(failing=20))
    next(stopped)
    stopped.close()
    assert threading.active_count() == threads
    assert len(read) < 7 + 20
