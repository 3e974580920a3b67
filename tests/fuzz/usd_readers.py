"""Readers of this program's USD files."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import mutations
from motion_readers import read_truth
from reader import Reader


def _write_body(folder: Path, name: str) -> None:
    from mmocap_warp.formats.usd.usd_body import write_body

    write_body(folder / name, _small_body())


def _small_body():
    """Six boxes with a shape target, so that a file is read quickly."""
    from dataclasses import replace

    import numpy as np
    from other_bodies import arm_robot

    body = arm_robot()
    shape, joints = np.zeros((1, len(body.skin.rest), 3)), np.zeros((1, len(body.joint_rest), 3))
    shape[0, 3:9, 1], joints[0, 1, 2] = 0.1, 0.2
    shapes = {"shape_vertex": shape.astype(np.float32), "shape_joint": joints.astype(np.float32)}
    return replace(body, shape_names=("height_incr",), **shapes)


def _small_subject():
    import numpy as np

    from mmocap_warp.body.model import Subject

    body = _small_body()
    return Subject(body, np.eye(3), np.zeros(body.skeleton.coordinates), {"source": "tests", "seed": 3})


def _write_packed_body(folder: Path) -> None:
    from pxr import UsdUtils

    _write_body(folder, "b.usdc")
    UsdUtils.CreateNewUsdzPackage(str(folder / "b.usdc"), str(folder / "b.usdz"))


def _read_body(folder: Path, name: str) -> None:
    from mmocap_warp.rigging.shipped import load_body

    load_body(folder / name)


def _write_subject(folder: Path, name: str) -> None:
    from mmocap_warp.formats.usd.usd_body import write_subject

    write_subject(folder / name, _small_subject())


def _read_subject(folder: Path, name: str) -> None:
    from mmocap_warp.formats.usd.usd_body import read_subject

    read_subject(folder / name)


def _write_result(folder: Path, name: str) -> None:
    import numpy as np
    from synthetic import ring_rig

    from mmocap_warp.formats.usd.usd_result import write_result
    from mmocap_warp.result.result import Result

    random, subject = np.random.default_rng(0), _small_subject()
    runs = {"cost": random.random((2, 3)), "evaluations": np.full((2, 3), 9), "status": np.zeros((2, 3), np.int8)}
    pose, sigma = (random.random((2, 3, subject.body.skeleton.coordinates)) for _ in range(2))
    more = {"iou": random.random((2, 3, 2)), "seconds": 1.5, "config": {"seed": 7}, "versions": {"device": "cpu"}}
    result = Result(subject, ring_rig(2), 60.0, np.arange(3), pose, **runs, **more, angle_sigma=sigma)
    write_result(folder / name, result)


def _read_result(folder: Path, name: str) -> None:
    from mmocap_warp.formats.usd.usd_result import holds_result, read_result

    if holds_result(folder / name):
        read_result(folder / name)


def _write_truth(folder: Path, name: str) -> None:
    import numpy as np

    from mmocap_warp.formats.truth_file import write_truth
    from mmocap_warp.result.truth import Truth

    random = np.random.default_rng(0)
    markers, joints = random.random((3, 2, 3)), random.random((3, 4, 3))
    markers[1, 0] = np.nan
    truth = Truth(60.0, np.arange(3), ("A", "B"), markers, tuple("CDEF"), joints, random.random((3, 5)), np.eye(3))
    write_truth(folder / name, truth)


def _check(folder: Path, name: str) -> None:
    from mmocap_warp.formats.usd.usd_check import faults

    faults(folder / name)


def _usd(kind: str, write: Callable, read: Callable) -> tuple[Reader, ...]:
    """As text and as binary."""
    return tuple(
        Reader(
            f"{kind}.{ending}",
            f"x.{ending}",
            partial(write, name=f"x.{ending}"),
            partial(read, name=f"x.{ending}"),
            damage,
        )
        for ending, damage in (("usda", mutations.text_or_bytes), ("usdc", mutations.any_bytes))
    )


READERS: tuple[Reader, ...] = (
    *_usd("body", _write_body, _read_body),
    Reader("body.usdz", "b.usdz", _write_packed_body, partial(_read_body, name="b.usdz"), mutations.any_bytes),
    *_usd("subject", _write_subject, _read_subject),
    *_usd("result", _write_result, _read_result),
    *_usd("check", _write_result, _check),
    *_usd("truth", _write_truth, read_truth),
)
