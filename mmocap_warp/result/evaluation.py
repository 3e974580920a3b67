"""How good a result is: overlap with what was seen, and distance to what is known."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from mmocap_warp.body.joint_sets import RIG, JointSet
from mmocap_warp.body.joint_sets import joint_set as set_named
from mmocap_warp.result import pose_errors
from mmocap_warp.result.json_values import json_values
from mmocap_warp.result.marker_errors import marker_errors
from mmocap_warp.result.other_world import other_world
from mmocap_warp.result.result import STATUS, Result
from mmocap_warp.result.truth import Truth, at_rate

_METRES_TO_MM = 1000.0
_Report = dict[str, Any]  # numbers by name
_Series = dict[str, np.ndarray]  # a number for each frame, or each run, by name
_COUNTED = ("lost", "partial", "rescued", "interpolated", "repeated")


def evaluate(result: Result, truth: Truth | None = None, joint_set: JointSet | None = None) -> dict[str, Any]:
    """Evaluate a result; numbers over several runs are means of the runs' numbers, except the worst and the medians.

    Without truth: ``frames``, ``runs``, the frames in which some run is ``lost``, ``partial``, ``rescued``,
    ``interpolated`` or ``repeated``, ``evaluations`` (all runs), ``evaluations_per_second``, ``mean_cost``,
    ``mean_iou``, ``worst_iou`` (the lowest mean over views of a frame, over runs) and its ``worst_iou_frame``,
    ``iou_by_camera``, ``shake_mm`` (median second difference of the joints over consecutive frames, as at 60 Hz),
    ``per_run`` and ``series`` (per run and frame). Of standard deviations, the medians over frames and runs:
    ``sigma_mm_by_joint`` (of the lengths), ``sigma_deg_by_angle`` and, of joints that slide, ``sigma_mm_by_shift``.

    With truth also, over the frames that have it at their time: ``truth_frames``; over the joints of the skeleton's
    ``evaluation_groups``, of a person the limbs' twelve, at the places that ``joint_set`` gives them: ``mpjpe_mm``
    the mean distance, ``pa_mpjpe_mm`` the same after the best similarity transform of each frame,
    ``median_joint_mm`` (all), ``median_mm_by_joint`` and ``median_mm_by_group`` over frames and runs,
    ``median_joint_offsets_removed_mm`` the median once each joint's constant offset in its parent's axes is taken
    out, ``growth`` the mean distance of the last third of these frames over that of the first, and
    ``limb_lost_frames``: frames in which a limb's end, wrist or ankle, of some run is over 200 mm off.
    ``wrongly_tracked``: frames in which this holds, or the root is that far off, for a run that calls them tracked.
    ``by_joint``: of each joint of the set that the truth names, or whose counterpart it names, the ``median_mm``,
    the length of its constant offset ``offset_mm`` and what is ``left_mm``. ``median_mm_by_attached``: of things
    that are attached and that the truth names, where there are any. ``near_tracked``: of the frames in which all of
    these joints are within 50 mm, the share that is called tracked or partial.

    Where the truth has poses of a body with the same joints: ``median_angle_deg``, of the joints' angles that were
    searched, the root's left out, and ``median_deg_by_angle``; of a body's own joints that slide
    ``median_mm_by_shift``.

    ``other_world`` says how the truth must be changed where it is far off but in another world, see
    :func:`mmocap_warp.result.other_world.other_world`; else it is ``None``.

    And Eq. 20, the mean over markers, then frames, in the two readings of :mod:`mmocap_warp.result.marker_errors`:
    ``eq20_as_printed_mm`` from the given first pose, where ``eq20_as_printed_left_out`` markers do not count, and
    ``marker_error_mm`` from each run's own first answer. ``eq20_as_printed_floor_mm`` and ``marker_error_floor_mm`` are
    what the tracked body scores at the true angles.

    Values that nothing defines (no marker, no joint, no view) are ``None``.

    Raises:
        InputError: truth that shares no frame, or neither markers nor joints, with the result, or has fewer frames a
            second.
    """
    joints, points = result.joints(), set_named(RIG, result.subject.body) if joint_set is None else joint_set
    places = joints if joint_set is None else points.of_runs(result.subject, result.pose)
    # The set's points stand for the body's joints, as far as they are other definitions of these.
    stand = points.counterpart >= 0
    joints[:, :, points.counterpart[stand]] = places[:, :, stand]
    series = {"cost": result.cost, "iou": pose_errors.nanmean(result.iou, axis=2)}
    report = _overlap(result, series["iou"])
    shake = pose_errors.second_differences(joints, result.frame_numbers, result.fps) * _METRES_TO_MM
    report["shake_mm"] = _median(shake)
    of_runs = {"shake_mm": np.array([_median(run) for run in shake])}
    report |= _sigmas(result)
    if truth is not None:
        truth = at_rate(truth, result.fps)
        mine, theirs = pose_errors.common_frames(result, truth)
        report["truth_frames"] = len(mine)
        report |= _marker_errors(truth, mine, theirs, result, series)
        report |= _joint_errors(joints, truth, mine, theirs, result, series)
        report["by_joint"] = _point_errors(points, places, truth, mine, theirs, result)
        report |= _attached_errors(joints, truth, mine, theirs, result)
        report |= _angle_errors(result, truth, mine, theirs)
        of_runs["growth"] = pose_errors.growth(series["mpjpe_mm"][:, mine])
        report["growth"] = _mean(of_runs["growth"])
        off = pose_errors.farthest(result, truth, mine, theirs, joints)
        report |= _evaluate_statuses(result.status[:, mine], off, of_runs)
    report["per_run"] = _per_run(result, series, of_runs)
    report["series"] = {"frame": result.frame_numbers} | series
    return json_values(report)


def _point_errors(
    points: JointSet, places: np.ndarray, truth: Truth, mine: np.ndarray, theirs: np.ndarray, result: Result
) -> dict[str, _Report]:
    """By points that the truth names, itself or as the body's joint: the median, the offset, and what is left.

    The points are at ``places`` (run, frame, point, 3) [m].
    """
    body = result.subject.body
    counterpart = [body.skeleton.joints[joint] if joint >= 0 else "" for joint in points.counterpart]
    pairs = zip(points.names, counterpart, strict=True)
    named = [next((name for name in pair if name in truth.joint_names), "") for pair in pairs]
    point = [number for number, name in enumerate(named) if name]
    known = truth.joints[theirs][:, [truth.joint_names.index(named[number]) for number in point]]
    tracked, axes = places[:, mine][:, :, point], points.axes(body)[point]
    left, offset = pose_errors.offset_free_distance(result, mine, tracked, axes, known)
    values = {"median_mm": np.linalg.norm(tracked - known, axis=-1), "offset_mm": offset, "left_mm": left}
    return {
        points.names[number]: {key: _median(of[..., i]) * _METRES_TO_MM for key, of in values.items()}
        for i, number in enumerate(point)
    }


def _overlap(result: Result, iou: np.ndarray) -> _Report:
    """The numbers that need no truth; ``iou`` is (run, frame)."""
    worst = np.where(np.isfinite(iou), iou, np.inf).min(axis=0)
    total = int(result.evaluations.sum())
    return {
        "frames": len(result.frame_numbers),
        "runs": len(result.pose),
        **{name: int((result.status == STATUS.index(name)).any(axis=0).sum()) for name in _COUNTED},
        "evaluations": total,
        "evaluations_per_second": total / result.seconds if result.seconds > 0 else None,
        "seconds": result.seconds,
        "mean_cost": _mean(pose_errors.nanmean(result.cost, axis=1)),
        "mean_iou": _mean(pose_errors.nanmean(iou, axis=1)),
        "worst_iou": worst.min(),
        "worst_iou_frame": int(result.frame_numbers[worst.argmin()]) if np.isfinite(worst).any() else None,
        "iou_by_camera": iou_by_camera(result),
    }


def iou_by_camera(result: Result) -> dict[str, float | None]:
    """Mean overlap of each camera over all frames and runs; None where it sees nobody."""
    return dict(json_values(dict(zip(result.cameras.names, pose_errors.nanmean(result.iou, axis=(0, 1)), strict=True))))


def _sigmas(result: Result) -> _Report:
    """How sure the tracker was, as far as the result says."""
    skeleton = result.subject.body.skeleton
    report: _Report = {}
    if result.joint_sigma is not None:
        length = np.linalg.norm(result.joint_sigma, axis=-1) * _METRES_TO_MM
        report["sigma_mm_by_joint"] = {name: _median(length[..., i]) for i, name in enumerate(skeleton.joints)}
    if result.angle_sigma is not None:
        names, angles = skeleton.coordinate_names, np.flatnonzero(~skeleton.is_length)
        shifts = skeleton.searched_shifts(result.config.get("dof"))
        median = {i: _median(result.angle_sigma[..., i]) for i in (*angles, *shifts)}
        report["sigma_deg_by_angle"] = {names[i]: np.degrees(median[i]) for i in angles}
        report |= {"sigma_mm_by_shift": {names[i]: median[i] * _METRES_TO_MM for i in shifts}} if len(shifts) else {}
    return report


def _marker_errors(truth: Truth, mine: np.ndarray, theirs: np.ndarray, result: Result, series: _Series) -> _Report:
    """Both readings of Eq. 20; adds the per-frame errors to ``series``."""
    errors = marker_errors(result, truth, mine, theirs)
    report: _Report = {}
    for name, error, floor in (
        ("eq20_as_printed", errors.as_printed, errors.as_printed_floor),
        ("marker_error", errors.from_own_answer, errors.from_own_answer_floor),
    ):
        series[f"{name}_mm"] = pose_errors.on_all_frames(error * _METRES_TO_MM, mine, result)
        report[f"{name}_mm"] = _mean(pose_errors.nanmean(series[f"{name}_mm"], axis=1))
        report[f"{name}_floor_mm"] = _mean(floor) * _METRES_TO_MM
    return report | {"eq20_as_printed_left_out": errors.left_out}


def _joint_errors(
    joints: np.ndarray, truth: Truth, mine: np.ndarray, theirs: np.ndarray, result: Result, series: _Series
) -> _Report:
    """Errors of the evaluated joints that the truth names; adds the per-frame errors to ``series``."""
    skeleton = result.subject.body.skeleton
    names = [name for group in skeleton.evaluation_groups.values() for name in group if name in truth.joint_names]
    tracked = joints[:, mine][:, :, [skeleton.index(name) for name in names]]
    known = truth.joints[theirs][:, [truth.joint_names.index(name) for name in names]]
    distance = np.linalg.norm(tracked - known, axis=-1) * _METRES_TO_MM  # (run, common frame, joint)
    aligned = pose_errors.aligned_error(tracked, known) * _METRES_TO_MM
    series["mpjpe_mm"] = pose_errors.on_all_frames(pose_errors.nanmean(distance, axis=2), mine, result)
    series["pa_mpjpe_mm"] = pose_errors.on_all_frames(aligned, mine, result)
    ends = [i for i, name in enumerate(names) if name in skeleton.ends]
    lost = (distance[..., ends] > pose_errors.LOST_LIMB * _METRES_TO_MM).any(axis=(0, 2))
    # A joint's offset is constant in the axes of its parent, the root's in its own.
    axes = [max(skeleton.parent[skeleton.index(name)], 0) for name in names]
    left, _ = pose_errors.offset_free_distance(result, mine, tracked, axes, known)

    def median_of(*wanted: str) -> float:
        return _median(distance[..., [i for i, name in enumerate(names) if name in wanted]])

    return {
        "mpjpe_mm": _mean(pose_errors.nanmean(series["mpjpe_mm"], axis=1)),
        "pa_mpjpe_mm": _mean(pose_errors.nanmean(series["pa_mpjpe_mm"], axis=1)),
        "median_joint_mm": median_of(*names),
        "median_joint_offsets_removed_mm": _median(left) * _METRES_TO_MM,
        "median_mm_by_joint": {name: median_of(name) for name in names},
        "median_mm_by_group": {group: median_of(*joints) for group, joints in skeleton.evaluation_groups.items()},
        "limb_lost_frames": result.frame_numbers[mine[lost]],
        "other_world": other_world(tracked[result.best_run], known),
    }


def _attached_errors(joints: np.ndarray, truth: Truth, mine: np.ndarray, theirs: np.ndarray, result: Result) -> _Report:
    """How far attached things that the truth names are off, over frames and runs; nothing where there are none."""
    skeleton = result.subject.body.skeleton
    names = [name for name in skeleton.attached if name in truth.joint_names and name not in skeleton.sliding]
    median = {}
    for name in names:
        off = joints[:, mine, skeleton.index(name)] - truth.joints[theirs, truth.joint_names.index(name)]
        median[name] = _median(np.linalg.norm(off, axis=-1)) * _METRES_TO_MM
    return {"median_mm_by_attached": median} if median else {}


def _angle_errors(result: Result, truth: Truth, mine: np.ndarray, theirs: np.ndarray) -> _Report:
    """Errors of the angles and shifts that were searched, where the truth is of a body with the same joints."""
    skeleton = result.subject.body.skeleton
    if truth.pose is None or not truth.has_poses_of(skeleton):
        return {}
    off = result.pose[:, mine] - truth.pose[theirs]  # (run, common frame, coordinate)
    searched, shifts = (pick(result.config.get("dof")) for pick in (skeleton.searched_angles, skeleton.searched_shifts))
    degrees = np.degrees(np.abs((off[..., searched] + np.pi) % (2 * np.pi) - np.pi))
    names = [skeleton.coordinate_names[number] for number in searched]
    by_shift = {skeleton.coordinate_names[i]: _median(np.abs(off[..., i])) * _METRES_TO_MM for i in shifts}
    return {
        "median_angle_deg": _median(degrees),
        "median_deg_by_angle": {name: _median(degrees[..., i]) for i, name in enumerate(names)},
        **({"median_mm_by_shift": by_shift} if by_shift else {}),
    }


def _evaluate_statuses(status: np.ndarray, off: np.ndarray, of_runs: _Series) -> _Report:
    """How far statuses (run, common frame) agree with the truth; adds the same of each run to ``of_runs``, by name.

    ``off`` (run, common frame) is how far the root or a limb's end is off [m], NaN where that is unknown.
    """
    tracked = status == STATUS.index("tracked")
    wrong, near = tracked & (off > pose_errors.LOST_LIMB), off <= pose_errors.NEAR
    reported = near & (tracked | (status == STATUS.index("partial")))
    known = np.isfinite(off).any()
    of_runs["wrongly_tracked"] = np.where(known, wrong.sum(axis=1), np.nan)
    of_runs["near_tracked"] = pose_errors.nanmean(np.where(near, reported, np.nan), axis=1)
    return {
        "wrongly_tracked": int(wrong.any(axis=0).sum()) if known else None,
        "near_tracked": _mean(of_runs["near_tracked"]),
    }


def _per_run(result: Result, series: _Series, of_runs: _Series) -> list[_Report]:
    """The numbers of each run by itself, which show the spread of the seeds."""
    seed = result.config.get("seed")
    return [
        {"run": run, "seed": None if seed is None else seed + run, "worst_iou": _min(series["iou"][run])}
        | {name: int((result.status[run] == STATUS.index(name)).sum()) for name in _COUNTED}
        | {f"mean_{name}" if name in ("cost", "iou") else name: _mean(of[run]) for name, of in series.items()}
        | {name: of[run] for name, of in of_runs.items()}
        for run in range(len(result.pose))
    ]


def _statistic(reduce: Callable[[np.ndarray], np.floating], values: np.ndarray) -> float:
    """What ``reduce`` makes of the values that are defined; NaN where none is."""
    return float(reduce(values)) if np.isfinite(values).any() else np.nan


_mean, _median, _min = (partial(_statistic, reduce) for reduce in (np.nanmean, np.nanmedian, np.nanmin))
