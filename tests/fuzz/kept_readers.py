"""Readers of what the program keeps, and of MakeHuman's data."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mutations
from reader import LINES, Reader


def _write_cell(folder: Path) -> None:
    from study_results import made_up_result

    from mmocap_warp.study.cell import Cell, write_cell

    write_cell(folder / "cell.npz", made_up_result(Cell("S1/Box", "h-cmaes", 39, 500), 2, 3))


def _read_cell(folder: Path) -> None:
    from mmocap_warp.study.cell import read_cell

    read_cell(folder / "cell.npz")


def _state(value: float):
    import numpy as np

    from mmocap_warp.tracking.tracker import TrackState

    memory = (np.full((2, 4), value, np.float32),)
    return TrackState(np.zeros((2, 6), np.float32), np.zeros(2, np.int32), memory)


def _checkpoint(folder: Path):
    from mmocap_warp.tracking.checkpoint import Checkpoint

    return Checkpoint(folder / "r.checkpoint", {"seed": 1, "frames": 3}, _state(0), 3)


def _write_checkpoint(folder: Path) -> None:
    import numpy as np

    from mmocap_warp.result.result import FrameAnswer

    answer = FrameAnswer(np.ones((2, 6)), np.ones(2), np.ones((2, 3)), 9, np.array([0, 1]), 0.5)
    with _checkpoint(folder) as checkpoint:
        for _ in range(3):
            checkpoint.add(answer, _state(1))


def _read_checkpoint(folder: Path) -> None:
    _checkpoint(folder).resumed()


def _write_report(folder: Path) -> None:
    import json

    from mmocap_warp.bench.report_file import FORMAT

    lines = [{"name": "pose", "ms": 1.5, "ok": True, "sizes": [1, 2]}]
    report = {"format": FORMAT, "ok": True, "device": "cpu", "measurements": lines}
    (folder / "bench.json").write_text(json.dumps(report))


def _read_report(folder: Path) -> None:
    from mmocap_warp.bench.report_file import read_report

    read_report(folder / "bench.json")


def _write_makehuman(folder: Path) -> None:
    from made_up_makehuman import write_target

    (folder / "3dobjs").mkdir()
    corners = ["v 0 0 0", "v 1 0 0", "v 1 1 0", "v 0 1 0", "v 0 0 1"]
    (folder / "3dobjs/base.obj").write_text(
        "\n".join([*corners, "g body", "f 1/1 2/1 3/1 4/1", "g joint-a", "f 1 2 3 5"])
    )
    write_target(folder, "some", "# made up\n0 0.1 0.2 0.3\n3 -1 0 0\n")
    rigs = folder / "rigs/standard"
    rigs.mkdir(parents=True)
    (rigs / "rig.cmu_mb.json").write_text(
        '{"a": {"parent": "", "head": {"strategy": "CUBE", "cube_name": "joint-a"}},'
        ' "b": {"parent": "a", "head": {"strategy": "MEAN", "vertex_indices": [0, 1]}},'
        ' "c": {"parent": "a", "head": {"strategy": "VERTEX", "vertex_index": 2}}}'
    )
    (rigs / "weights.cmu_mb.json").write_text('{"weights": {"a": [[0, 1.0], [1, 0.5]], "b": [[1, 0.5], [2, 1.0]]}}')


def _read_makehuman(folder: Path) -> None:
    from makehuman import MakeHuman

    data = MakeHuman(folder)
    data.target("some")
    for bone in data.parent_bone:
        data.rest[data.bone_head(bone)].mean(axis=0)
    _ = data.bone_weight


_HUMAN = Reader("makehuman.obj", "3dobjs/base.obj", _write_makehuman, _read_makehuman, LINES)

READERS: tuple[Reader, ...] = (
    Reader("study-cell.npz", "cell.npz", _write_cell, _read_cell, mutations.zipped),
    Reader(
        "checkpoint",
        "r.checkpoint",
        _write_checkpoint,
        _read_checkpoint,
        mutations.headed(b"mmocap checkpoint 5\n"),
    ),
    Reader("bench.json", "bench.json", _write_report, _read_report, mutations.json_text),
    _HUMAN,
    replace(_HUMAN, name="makehuman.target", file="targets/some.target.gz", damage=mutations.gzipped(mutations.text)),
    replace(_HUMAN, name="makehuman-rig.json", file="rigs/standard/rig.cmu_mb.json", damage=mutations.json_text),
    replace(
        _HUMAN, name="makehuman-weights.json", file="rigs/standard/weights.cmu_mb.json", damage=mutations.json_text
    ),
)
