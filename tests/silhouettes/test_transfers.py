"""What is sent arrives in its turn, what is fetched is what was there then, and graphs do what their work does."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from mmocap_warp.device.transfers import Download, Replays, Upload


def test_what_is_sent_next_does_not_overtake(device):
    """Large arrays, so that the host is long done when the first one has left."""
    array = wp.zeros((3, 1 << 20), dtype=wp.float32, device=device)
    upload = Upload(array)
    kept = [wp.zeros_like(array) for _ in range(6)]
    for number, copy in enumerate(kept, 1):
        upload.values[:2] = number
        upload.send(2)
        wp.copy(copy, array)
    for number, copy in enumerate(kept, 1):
        np.testing.assert_array_equal(copy.numpy()[:, ::4097], np.array([[number], [number], [0]]).repeat(256, axis=1))


def test_what_a_graph_sends_is_not_overtaken_either(device):
    array, kept = (wp.zeros((3, 1 << 20), dtype=wp.float32, device=device) for _ in range(2))
    upload, replays, copies = Upload(array), Replays(device), []

    def work() -> None:
        upload.send(2)
        wp.copy(kept, array)

    for number in range(1, 7):
        upload.values[:2] = number
        replays.run("work", work)
        upload.sent()
        copies.append(wp.clone(kept))
    for number, copy in enumerate(copies, 1):
        np.testing.assert_array_equal(copy.numpy()[:, ::4097], np.array([[number], [number], [0]]).repeat(256, axis=1))


def test_the_current_device_may_be_another_one(device):
    """A worker of a study on the second GPU does not make that one Warp's default."""
    array = wp.zeros((2, 3), dtype=wp.float32, device=device)
    upload, download = Upload(array), Download([array])
    with wp.ScopedDevice("cpu"):
        for number in (1, 2):
            upload.values[:] = number
            upload.send(2)
        download.fetch(2)
        np.testing.assert_array_equal(download.read(2)[0], np.full((2, 3), 2))


def test_vectors_and_matrices_are_sent_by_rows(device):
    array = wp.zeros(4, dtype=wp.mat33, device=device)
    upload = Upload(array)
    values = np.random.default_rng(0).normal(size=(3, 3, 3))
    upload.values[:3] = values
    upload.send(3)
    np.testing.assert_array_equal(array.numpy(), np.concatenate([values, np.zeros((1, 3, 3))]).astype(np.float32))


def test_arrays_are_fetched_together(device):
    arrays = [
        wp.array(np.arange(12).reshape(4, 3), dtype=wp.float32, device=device),
        wp.array(np.arange(8).reshape(4, 2), dtype=wp.vec2i, device=device),
    ]
    download = Download(arrays)
    download.fetch(2)
    floats, vectors = download.read(2)
    for array in arrays:
        array.zero_()
    np.testing.assert_array_equal(floats, [[0, 1, 2], [3, 4, 5]])
    np.testing.assert_array_equal(vectors, [[0, 1], [2, 3]])


def test_nothing_is_sent_and_fetched(device):
    empty = wp.zeros((0, 3), dtype=wp.float32, device=device)
    Upload(empty).send(0)
    download = Download([empty])
    download.fetch(0)
    assert download.read(0)[0].shape == (0, 3)


def test_work_is_replayed_from_the_third_time_on(device):
    array = wp.zeros(2, dtype=wp.float32, device=device)
    one, ten = (wp.array([value, value], dtype=wp.float32, device=device) for value in (1.0, 10.0))
    replays, done = Replays(device), []

    def work(value: wp.array) -> None:
        done.append(value)
        wp.copy(array, value)

    for value in (one, one, ten, one, ten, one, ten):
        array.zero_()
        replays.run(value.ptr, lambda value=value: work(value))
        np.testing.assert_array_equal(array.numpy(), value.numpy())
    assert len(done) == (7 if device == "cpu" else 4)


def test_work_within_a_capture_is_a_part_of_it(device):
    if device == "cpu":
        pytest.skip("graphs are captured on CUDA devices only")
    array, one = wp.zeros(2, dtype=wp.float32, device=device), wp.ones(2, dtype=wp.float32, device=device)
    inner, outer = Replays(device), Replays(device)
    for _ in range(3):
        array.zero_()
        outer.run("all", lambda: inner.run("part", lambda: wp.copy(array, one)))
        np.testing.assert_array_equal(array.numpy(), [1.0, 1.0])
