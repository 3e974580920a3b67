"""The numbers that a study keeps of a tracked sequence: per run and frame, and per run. Metres and seconds."""

import numpy as np

from mmocap_warp.body.posing import skin_positions
from mmocap_warp.result import pose_errors
from mmocap_warp.result.marker_errors import marker_errors
from mmocap_warp.result.result import STATUS, Result
from mmocap_warp.result.truth import Truth, at_rate

TRUNK = ("Root", "Neck", pose_errors.HEAD_TOP)
"""With the limbs' twelve they make HumanEva's fifteen joints: pelvis, thorax and top of the head, by our names."""

_ERRORS = ("eq20_as_printed", "marker_error", "joint_error", "mpjpe", "pa_mpjpe")
_OF_TRUTH = ("eq20_as_printed_floor", "marker_error_floor", "eq20_as_printed_left_out")
_FEET = ("LAnkle", "RAnkle")
_SOLE_THICKNESS = 0.02  # [m] of the foot that counts as its sole, from the lowest vertex up
_FRAMES_AT_ONCE = 1024  # a sole has some hundred vertices

Metrics = dict[str, np.ndarray]


def measure(result: Result, truth: Truth | None) -> tuple[Metrics, Metrics]:
    """Judge every run of a result.

    Returns:
        Per frame, (run, frame) float32 each; errors are NaN where the truth says nothing, and everywhere without
        truth:

        - ``eq20_as_printed``, ``marker_error``: Eq. 20 from the given first pose, and from the run's own first answer
          [m], see :mod:`mmocap_warp.result.marker_errors`;
        - ``joint_error``: mean distance over ``TRUNK`` and the judged joints [m], as far as the truth names them;
        - ``mpjpe``: the same over the twelve joints of the limbs [m]; ``pa_mpjpe``: that after the best similarity
          transform of each frame [m];
        - ``iou``: mean over the views that were judged, NaN in a lost frame; ``cost``: what the search minimised,
          Eq. 4-5 unless set otherwise, likewise.

        Per run, (run,) float64 each:

        - ``shake``: median second difference of the joints over consecutive frames, as at 60 Hz [m];
        - ``growth``: mean MPJPE of the last third of the frames with truth over that of the first, NaN without joints;
        - ``jerk``: mean length of the third derivative of the joints' paths [m/s³];
        - ``foot_slide``: see :func:`foot_slide` [m/s];
        - ``frames_lost``: frames in which no view could be judged;
        - ``limb_lost``: frames in which a wrist or ankle is over 200 mm off, NaN without truth of any;
        - the same in each run: ``eq20_as_printed_floor``, ``marker_error_floor``, what the tracked body scores at the
          true angles [m], NaN where these are unknown; ``eq20_as_printed_left_out``, markers that do not count;
        - ``seconds``: of the search, all runs together; ``evaluations``: of the run, all frames together.

    Raises:
        InputError: truth that shares no frame, or neither markers nor joints, with the result, or has fewer frames a
            second.
    """
    joints, shape = result.joints(), result.pose.shape[:2]
    per_frame = {name: np.full(shape, np.nan) for name in _ERRORS}
    of_truth: dict[str, float] = dict.fromkeys(_OF_TRUTH, np.nan)
    limb_lost = grown = unknown = np.full(shape[0], np.nan)
    if truth is not None:
        truth = at_rate(truth, result.fps)
        mine, theirs = pose_errors.common_frames(result, truth)
        markers = marker_errors(result, truth, mine, theirs)
        per_frame["eq20_as_printed"] = pose_errors.on_all_frames(markers.as_printed, mine, result)
        per_frame["marker_error"] = pose_errors.on_all_frames(markers.from_own_answer, mine, result)
        both = markers.as_printed_floor, markers.from_own_answer_floor
        floors = (float(pose_errors.nanmean(each, axis=0)) for each in both)
        of_truth = dict(zip(_OF_TRUTH, (*floors, markers.left_out), strict=True))
        limb_lost = _judge_joints(result, joints[:, mine], truth, mine, theirs, per_frame)
        grown = pose_errors.growth(per_frame["mpjpe"][:, mine])
    per_frame |= {"iou": pose_errors.nanmean(result.iou, axis=2), "cost": result.cost}
    shake = pose_errors.second_differences(joints, result.frame_numbers, result.fps)
    per_run = {
        "shake": np.median(shake, axis=(1, 2)) if shake.size else unknown,
        "growth": grown,
        "jerk": jerk(joints, result.frame_numbers, result.fps),
        "foot_slide": foot_slide(result),
        "frames_lost": (result.status == STATUS.index("lost")).sum(axis=1),
        "limb_lost": limb_lost,
        **{name: np.full(shape[0], value) for name, value in of_truth.items()},
        "seconds": np.full(shape[0], result.seconds),
        "evaluations": result.evaluations.sum(axis=1),
    }
    single = {name: np.asarray(each, np.float32) for name, each in per_frame.items()}
    return single, {name: np.asarray(each, np.float64) for name, each in per_run.items()}


def jerk(joints: np.ndarray, frame_numbers: np.ndarray, fps: float) -> np.ndarray:
    """Mean length of the joints' third derivative: (run,) [m/s³], NaN with fewer than four frames in a row.

    Where frames are missing between two of the ``frame_numbers``, no derivative reaches across.
    """
    step = np.diff(frame_numbers)
    if len(step) < 3:
        return np.full(len(joints), np.nan)
    even = step == step.min()
    third = np.diff(joints, n=3, axis=1)[:, even[:-2] & even[1:-1] & even[2:]] * (fps / step.min()) ** 3
    return pose_errors.nanmean(np.linalg.norm(third, axis=-1), axis=(1, 2))


def foot_slide(result: Result) -> np.ndarray:
    """Mean speed over the floor of the foot that stands: (run,) [m/s], NaN with fewer than two frames in a row.

    A foot that stands or rolls has a place at rest where it touches the floor: the lowest vertex of its sole. Between
    two frames, the foot whose lowest vertex moves less is the one that stands. There always is one in walking,
    gestures and boxing; in running and jumping there is not, and the number means nothing. No height of the floor and
    no threshold is needed.
    """
    step = np.diff(result.frame_numbers)
    soles = [_sole(result, joint) for joint in _FEET if joint in result.subject.body.skeleton.joints]
    if not len(step) or not soles:
        return np.full(len(result.pose), np.nan)
    slower = [np.min([_contact_speed(result, pose, sole) for sole in soles], axis=0) for pose in result.pose]
    return np.array(slower)[:, step == step.min()].mean(axis=1) * (result.fps / step.min())


def _contact_speed(result: Result, pose: np.ndarray, sole: np.ndarray) -> np.ndarray:
    """How far the lowest vertex of a sole moves over the floor to the next frame: (frame - 1,) [m]."""
    up = result.cameras.up_vector
    moved = np.empty((len(pose) - 1, 3))
    for start in range(0, len(moved), _FRAMES_AT_ONCE):
        place = skin_positions(result.subject, pose[start : start + _FRAMES_AT_ONCE + 1], sole)
        lowest = (place[:-1] @ up).argmin(axis=1)
        frame = np.arange(len(lowest))
        moved[start : start + _FRAMES_AT_ONCE] = place[frame + 1, lowest] - place[frame, lowest]
    return np.linalg.norm(moved - np.outer(moved @ up, up), axis=1)


def _sole(result: Result, joint: str) -> np.ndarray:
    """The vertices at the bottom of a foot in the bind pose."""
    skin = result.subject.body.skin
    foot = np.flatnonzero(skin.heaviest_joint == result.subject.body.skeleton.index(joint))
    height = skin.rest[foot, 1]
    return foot[height <= height.min() + _SOLE_THICKNESS]


def _judge_joints(
    result: Result, joints: np.ndarray, truth: Truth, mine: np.ndarray, theirs: np.ndarray, per_frame: Metrics
) -> np.ndarray:
    """Fill in the joint errors of the frames ``mine``; returns how many of them have lost a limb, (run,)."""
    skeleton = result.subject.body.skeleton
    judged = [name for group in skeleton.evaluation_groups.values() for name in group]
    names = [name for name in (*TRUNK, *judged) if name in truth.joint_names]
    ends = [i for i, name in enumerate(names) if name in skeleton.ends]
    limbs = [i for i, name in enumerate(names) if name in judged]
    if not names:
        return np.full(len(joints), np.nan)
    known = truth.joints[theirs][:, [truth.joint_names.index(name) for name in names]]
    tracked = np.stack([_tracked(result, joints, mine, name) for name in names], axis=2)
    distance = np.linalg.norm(tracked - known, axis=-1)  # (run, common frame, joint)
    means = {"joint_error": distance, "mpjpe": distance[..., limbs]}
    errors = {name: pose_errors.nanmean(each, axis=2) for name, each in means.items()}
    errors["pa_mpjpe"] = pose_errors.aligned_error(tracked[:, :, limbs], known[:, limbs])
    per_frame |= {name: pose_errors.on_all_frames(error, mine, result) for name, error in errors.items()}
    lost = (distance[..., ends] > pose_errors.LOST_LIMB).any(axis=2).sum(axis=1)
    return lost.astype(float) if ends else np.full(len(joints), np.nan)


def _tracked(result: Result, joints: np.ndarray, mine: np.ndarray, name: str) -> np.ndarray:
    """(run, common frame, 3): where the body has the joint; ``joints`` are (run, common frame, joint, 3)."""
    if name != pose_errors.HEAD_TOP:
        return joints[:, :, result.subject.body.skeleton.index(name)]
    pose = result.pose[:, mine].reshape(-1, result.pose.shape[2])
    top = skin_positions(result.subject, pose, np.array([pose_errors.head_top(result.subject.body)]))
    return top.reshape(*joints.shape[:2], 3).astype(np.float64)
