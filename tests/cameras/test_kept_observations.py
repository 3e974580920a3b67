"""Observations that were put aside come back with their bits, in their order, from memory and from disk."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mmocap_warp.masks import observation
from mmocap_warp.masks.observation import KeptObservations, Observation


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
