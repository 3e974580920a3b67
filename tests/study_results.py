"""Made-up results of a whole study, in which the paper's findings hold: for tests of what is done with results."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import numpy as np
from synthetic import COORDINATES

from mmocap_warp.result.pose_errors import growth
from mmocap_warp.study.cell import Cell, CellResult
from mmocap_warp.study.paper import ALGORITHM_ORDER
from mmocap_warp.tracking.algorithms import PRESETS

SEQUENCES = tuple(f"{subject}/{action}" for action in ("Walking", "Gestures", "Box") for subject in ("S1", "S2", "S3"))
_ERROR = dict(zip(ALGORITHM_ORDER, (0.022, 0.026, 0.027, 0.032, 0.038, 0.046, 0.060, 0.066), strict=True))  # [m]
_HARDER = {"Walking": 1.0, "Gestures": 0.75, "Box": 1.5, "S1": 1.0, "S2": 1.05, "S3": 1.2}


def made_up_study(
    sequences: tuple[str, ...] = SEQUENCES,
    algorithms: tuple[str, ...] = ALGORITHM_ORDER,
    models: tuple[int, ...] = (39, 28),
    budgets: tuple[int, ...] = (500, 1500, 3000),
    presets: tuple[str, ...] = ("recording",),
    seeds: int = 5,
    frames: int = 60,
    truth: bool = True,
) -> Iterator[CellResult]:
    """One result per cell, seeded by the cell itself."""
    for sequence, preset, dof, budget, algorithm in product(sequences, presets, models, budgets, algorithms):
        yield made_up_result(Cell(sequence, algorithm, dof, budget, preset), seeds, frames, truth)


def _radii(cell: Cell) -> dict[str, float]:
    rotation, translation = PRESETS[cell.preset].at(cell.algorithm, 60.0)
    return {"rotation_radius": rotation, "translation_radius": translation}


def made_up_result(cell: Cell, seeds: int, frames: int, truth: bool = True) -> CellResult:
    """Errors that drift, jump and recover about a level that depends on the cell; frame 0 is nearly right."""
    rng = np.random.default_rng([*f"{cell}".encode()])
    subject, action = cell.sequence.split("/")
    filters = cell.algorithm in ("apf", "psapf")
    level = _ERROR[cell.algorithm] * _HARDER[action] * _HARDER[subject] * (500 / cell.evaluations) ** 0.15
    level *= (0.93 if filters else 1.12) if cell.dof == 28 else 1.0
    level *= 4.0 if cell.preset == "paper" and cell.evaluations < 3000 else 1.0
    level *= 1 + 0.12 * np.random.default_rng([*f"{cell.sequence} {cell.algorithm}".encode()]).standard_normal()
    run_level = level * (1 + 0.06 * rng.standard_normal((seeds, 1)))
    drift = np.cumsum(rng.standard_normal((seeds, frames)), axis=1) * 0.03
    jumps = np.maximum(np.sin(np.arange(frames) / 9.0 + rng.uniform(0, 6, (seeds, 1))) - 0.8, 0) * (6 if filters else 2)
    error = run_level * np.exp(drift - drift.mean(axis=1, keepdims=True)) * (1 + jumps)
    error *= 1 - 0.85 * np.exp(-np.arange(frames) / 4.0)
    if frames > 30:
        error[:, 24:27] = np.nan  # no truth
    iou = np.clip(0.95 - 2.0 * np.nan_to_num(error, nan=level), 0.2, 0.95)
    errors = {
        "marker_error": error,
        "eq20_as_printed": error + 0.011,
        "joint_error": error * 1.25,
        "mpjpe": error * 1.2 + 0.004,
        "pa_mpjpe": error * 0.7,
    }
    if not truth:
        errors = {name: np.full_like(error, np.nan) for name in errors}
    per_frame = errors | {"iou": iou, "cost": 0.5 * (1 - iou)}
    jitter = 3.0 if cell.algorithm in ("de", "h-de", "pso", "h-pso") else 1.0
    pose = np.zeros((seeds, frames, COORDINATES))
    pose[:, :, 0] = np.nan_to_num(error)
    spent = cell.evaluations * seeds * frames
    return CellResult(
        cell=cell,
        seeds=np.arange(seeds, dtype=np.int64),
        frames=np.arange(frames, dtype=np.int64),
        per_frame={name: values.astype(np.float32) for name, values in per_frame.items()},
        per_run={
            "shake": jitter * 0.002 * (1 + 0.01 * np.arange(seeds)),
            "growth": growth(errors["mpjpe"]),
            "jerk": jitter * 200 * (1 + 0.05 * rng.random(seeds)),
            "foot_slide": level * 4 * (1 + 0.05 * rng.random(seeds)),
            "frames_lost": np.zeros(seeds),
            "limb_lost": rng.integers(0, 6 if filters else 2, seeds) * (1.0 if truth else np.nan),
            "seconds": np.full(seeds, spent / (240_000 * (0.8 if filters else 1.0))),
            "evaluations": np.full(seeds, float(cell.evaluations * frames)),
            "eq20_as_printed_floor": np.full(seeds, 0.010 * _HARDER[subject] if truth else np.nan),
            "marker_error_floor": np.full(seeds, 0.005 * _HARDER[subject] if truth else np.nan),
        },
        pose=pose.astype(np.float32),
        meta={
            "fps": 60.0,
            "cameras": ["C1", "C2", "C3", "BW1", "BW2", "BW3", "BW4"],
            "size": [[640, 480]] * 7,
            "config": {"cost": "paper", "preset": cell.preset, **_radii(cell)},
            "device": "cuda",
            "versions": {"mmocap-warp": "0.1.0", "warp-lang": "1.19.0", "numpy": "2.4.6", "device": "Made-up GPU"},
            "host": "made-up",
            "started": "2026-01-02T03:04:05+00:00",
            "wall_seconds": spent / 200_000,
            "study": "made-up",
        },
    )


def like(
    cell: Cell, other: Cell, factor: float = 1.0, seeds: int = 3, frames: int = 20, lost: int | None = None
) -> CellResult:
    """A result of a cell with the errors of another one's, all times ``factor``."""
    result = made_up_result(other, seeds, frames)
    errors = {
        name: values if name in ("iou", "cost") else (values * factor).astype(np.float32)
        for name, values in result.per_frame.items()
    }
    limbs = {} if lost is None else {"limb_lost": np.full(seeds, float(lost))}
    return replace(result, cell=cell, per_frame=errors, per_run=result.per_run | limbs)


def with_lost_limbs(lost: dict[str, int]) -> Iterator[CellResult]:
    """Two algorithms on the first sequence with other presets, in each of which so many frames lose a limb."""
    for name, (preset, count) in product(("h-cmaes", "de"), lost.items()):
        yield like(Cell(SEQUENCES[0], name, 39, 500, preset), Cell(SEQUENCES[0], name, 39, 500), 3.0, lost=count)
