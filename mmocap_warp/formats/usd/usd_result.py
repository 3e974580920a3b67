"""Results as USD: the fitted body, animated, and a camera per view; all runs and what they cost as attributes.

Layout, with the recording's frame number as time code::

    /World                   turned upright where the cameras' up axis is neither +Y nor +Z
    /World/<body>            the subject as ``usd_body`` writes it
    /World/<body>/Animation  the best run as a SkelAnimation
    /World/Cameras/<view>    see ``usd_camera``
    /World/Tracking          mmocap:resultVersion, frames, runs, bestRun, seconds, config and versions (JSON);
                             per frame pose (run x coordinate), cost (run), iou (run x camera), evaluations (run),
                             status (run); where known rawPose and angleSigma (run x coordinate) and jointSigma
                             (run x joint x 3)
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from pxr import Usd, UsdGeom

from mmocap_warp.errors import InputError
from mmocap_warp.formats.usd.usd_animation import animate, new_world
from mmocap_warp.formats.usd.usd_body import body_prim, define_subject, subject_from_prim
from mmocap_warp.formats.usd.usd_camera import cameras_from_prim, define_cameras
from mmocap_warp.formats.usd.usd_file import PrimReader, author_value, read_stage, reads_usd, write_stage
from mmocap_warp.result.result import STATUS, Result

VERSION = 2
"""Of the layout above; raised when a file of the older layout can no longer be read."""

_REMEDY = "give a result that `mmocap track` wrote"


def write_result(path: str | Path, result: Result) -> None:
    """Write a result to a ``.usd``, ``.usda`` or ``.usdc`` file, whole or not at all; reading it gives it back exactly."""
    stage = new_world(result.cameras.up)
    body = define_subject(stage, f"/World/{result.subject.body.name}", result.subject)
    animate(stage, body, result.subject, result.pose[result.best_run], result.frame_numbers, result.fps)
    define_cameras(stage, "/World/Cameras", result.cameras)
    _define_tracking(stage, result)
    write_stage(path, stage)


@reads_usd
def holds_result(path: str | Path) -> bool:
    """Whether a file is a result, and not, say, a subject."""
    stage = read_stage(path)  # a prim lives only as long as its stage
    return _tracking(stage) is not None


def _tracking(stage: Usd.Stage) -> Usd.Prim | None:
    prim = stage.GetPrimAtPath("/World/Tracking")
    return prim if prim and prim.HasAttribute("mmocap:resultVersion") else None


@reads_usd
def read_result(path: str | Path) -> Result:
    """Read a result that :func:`write_result` wrote.

    Raises:
        InputError: no such file, not USD, not a result, one of another version, or an inconsistent one.
    """
    stage = read_stage(path)
    prim = _tracking(stage)
    if prim is None:
        raise InputError(path, "holds no tracking result (no /World/Tracking)", _REMEDY)
    read = PrimReader(prim, path, _REMEDY)
    version = read.value("mmocap:resultVersion")
    read.require(version == VERSION, f"this result has version {version}, this program reads {VERSION}")
    cameras = cameras_from_prim(stage.GetPrimAtPath("/World/Cameras"), path)
    frames = read.array("mmocap:frames", (None,), np.int64)
    times, runs = frames.astype(float).tolist(), read.typed("mmocap:runs", int)
    subject = subject_from_prim(body_prim(stage, path), path)
    skeleton = subject.body.skeleton

    def of_runs(name: str, *shape: int) -> np.ndarray:
        return np.moveaxis(read.sampled_array(f"mmocap:{name}", times, (runs, *shape)), 1, 0)

    def where_known(name: str, *shape: int) -> np.ndarray | None:
        return of_runs(name, *shape) if prim.HasAttribute(f"mmocap:{name}") else None

    pose = of_runs("pose", skeleton.coordinates)
    read.require(np.isfinite(pose).all(), "mmocap:pose is not finite")
    try:
        return Result(
            subject=subject,
            cameras=cameras,
            fps=stage.GetTimeCodesPerSecond(),
            frame_numbers=frames,
            pose=pose,
            cost=of_runs("cost"),
            iou=of_runs("iou", len(cameras)),
            evaluations=of_runs("evaluations"),
            status=_status(read, times, runs),
            seconds=read.typed("mmocap:seconds", float),
            config=read.json_object("mmocap:config"),
            versions=read.json_object("mmocap:versions"),
            raw_pose=where_known("rawPose", skeleton.coordinates),
            angle_sigma=where_known("angleSigma", skeleton.coordinates),
            joint_sigma=where_known("jointSigma", len(skeleton.joints), 3),
        )
    except InputError:
        raise
    except ValueError as error:
        raise InputError(path, str(error), _REMEDY) from error


def _define_tracking(stage: Usd.Stage, result: Result) -> None:
    prim = UsdGeom.Scope.Define(stage, "/World/Tracking").GetPrim()
    author_value(prim, "mmocap:resultVersion", VERSION)
    author_value(prim, "mmocap:frames", result.frame_numbers)
    author_value(prim, "mmocap:runs", len(result.pose))
    author_value(prim, "mmocap:bestRun", result.best_run)
    author_value(prim, "mmocap:seconds", float(result.seconds))
    author_value(prim, "mmocap:config", json.dumps(result.config))
    author_value(prim, "mmocap:versions", json.dumps(result.versions))
    sampled = {
        "pose": result.pose,
        "cost": result.cost,
        "iou": result.iou,
        "evaluations": result.evaluations,
        "rawPose": result.raw_pose,
        "angleSigma": result.angle_sigma,
        "jointSigma": result.joint_sigma,
    }
    for i, time in enumerate(result.frame_numbers.astype(float).tolist()):
        for name, values in sampled.items():
            if values is not None:
                author_value(prim, f"mmocap:{name}", values[:, i], time)
        author_value(prim, "mmocap:status", [STATUS[status] for status in result.status[:, i]], time)


def _status(read: PrimReader, times: list[float], runs: int) -> np.ndarray:
    """(run, frame) int8; a frame may name one status for all runs, as results of one status a frame do."""
    names = [
        [value] * runs if isinstance(value, str) else list(value) for value in read.samples("mmocap:status", times)
    ]
    unknown = {name for frame in names for name in frame} - set(STATUS)
    read.require(not unknown, f"mmocap:status knows {STATUS}, not {sorted(unknown)}")
    wrong = [len(frame) for frame in names if len(frame) != runs]
    read.require(not wrong, f"mmocap:status names {wrong[:1]} runs in a frame, not {runs}")
    return np.array([[STATUS.index(name) for name in frame] for frame in names], np.int8).T
