"""Streams that are read at once give their items together and are read to their ends."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import pytest

from mmocap_warp.errors import InputError
from mmocap_warp.scene.frame_choice import read_together


@pytest.mark.parametrize("at_once", [True, False])
def test_streams_are_read_abreast_to_their_ends(at_once):
    ended = []

    def stream(k: int):
        yield from (10 * k + i if i != 1 else None for i in range(3))
        ended.append(k)

    with ThreadPoolExecutor(2) as pool:
        each = pool.map if at_once else map
        assert list(read_together([stream(k) for k in range(3)], each)) == [[0, 10, 20], [None] * 3, [2, 12, 22]]
    assert sorted(ended) == [0, 1, 2]


def test_the_first_streams_error_is_told():
    def broken(k: int):
        yield k
        raise InputError(f"camera{k}.png", "is damaged", "replace it")

    with ThreadPoolExecutor(2) as pool:
        together = read_together([broken(0), broken(1)], pool.map)
        assert next(together) == [0, 1]
        with pytest.raises(InputError, match="camera0"):
            next(together)
