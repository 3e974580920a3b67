"""Results of a study's cells as files: they read back, equal results are equal bytes, damage is noticed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from study_workers import PER_FRAME, PER_RUN
from tiny_study import answer_members

from mmocap_warp.errors import InputError
from mmocap_warp.study.cell import Cell, CellResult, read_cell, write_cell

RUNS, FRAMES = 3, 5


def some_result() -> CellResult:
    rng = np.random.default_rng(0)
    per_frame = {name: rng.random((RUNS, FRAMES)).astype(np.float32) for name in PER_FRAME}
    per_frame["marker_error"][:, 2] = np.nan
    return CellResult(
        cell=Cell("S1/Walking", "h-cmaes", 39, 500),
        seeds=np.arange(RUNS, dtype=np.int64),
        frames=np.arange(10, 10 + FRAMES, dtype=np.int64),
        per_frame=per_frame,
        per_run={name: rng.random(RUNS) for name in PER_RUN},
        pose=rng.normal(0, 1, (RUNS, FRAMES, 51)).astype(np.float32),
        meta={"fps": 60.0, "cameras": ["a", "b"], "config": {"seed": 0}, "host": "here", "wall_seconds": 1.5},
    )


def test_a_result_reads_back(tmp_path):
    result = some_result()
    write_cell(tmp_path / "r.npz", result)
    again = read_cell(tmp_path / "r.npz")
    assert (again.cell, again.meta) == (result.cell, result.meta)
    for name in ("seeds", "frames", "pose"):
        np.testing.assert_array_equal(getattr(again, name), getattr(result, name))
    for name in ("per_frame", "per_run"):
        assert getattr(again, name).keys() == getattr(result, name).keys()
        for key, array in getattr(result, name).items():
            np.testing.assert_array_equal(getattr(again, name)[key], array)
    assert [path.name for path in tmp_path.iterdir()] == ["r.npz"]


def test_only_time_and_place_tell_repetitions_apart(tmp_path):
    result = some_result()
    later = replace(result, per_run=result.per_run | {"seconds": np.full(RUNS, 9.0)}, meta=result.meta | {"host": "x"})
    for name, one in (("a", result), ("b", result), ("c", later)):
        write_cell(tmp_path / name, one)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    assert (tmp_path / "a").read_bytes() != (tmp_path / "c").read_bytes()
    assert answer_members(tmp_path / "a") == answer_members(tmp_path / "c")


def test_numpy_reads_the_arrays(tmp_path):
    write_cell(tmp_path / "r.npz", some_result())
    with np.load(tmp_path / "r.npz", allow_pickle=False) as file:
        np.testing.assert_array_equal(file["pose"], some_result().pose)


@pytest.mark.parametrize(
    "damage",
    [
        lambda content: b"",
        lambda content: b"not a result",
        lambda content: content[: len(content) // 2],
        lambda content: content[:-1],
        lambda content: content[:300] + bytes(100) + content[400:],
    ],
    ids=["empty", "other content", "cut short", "a byte short", "overwritten"],
)
def test_damage_is_noticed(damage, tmp_path):
    path = tmp_path / "r.npz"
    write_cell(path, some_result())
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(InputError, match=r"r\.npz: is damaged, or no result of a cell .*run the study again") as caught:
        read_cell(path)
    assert "\n" not in str(caught.value)


def test_every_byte_of_the_data_is_checked(tmp_path):
    path = tmp_path / "r.npz"
    write_cell(path, some_result())
    content, rng = path.read_bytes(), np.random.default_rng(0)
    pose = content.index(b"pose.npy") + len(b"pose.npy")
    for at in pose + rng.integers(0, 2000, 20):
        path.write_bytes(content[:at] + bytes([content[at] ^ 1]) + content[at + 1 :])
        with pytest.raises(InputError, match="is damaged"):
            read_cell(path)


def test_an_array_of_objects_is_never_unpickled(tmp_path):
    np.savez(tmp_path / "r.npz", seeds=np.array([{}], object))
    with pytest.raises(InputError, match="is damaged"):
        read_cell(tmp_path / "r.npz")


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_cell(tmp_path / "r.npz")


def test_shapes_must_agree():
    with pytest.raises(ValueError, match=r"iou must be \(3, 5\)"):
        replace(some_result(), per_frame={"iou": np.zeros((RUNS, FRAMES - 1), np.float32)})
