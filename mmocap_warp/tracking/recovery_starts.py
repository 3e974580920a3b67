"""Where a body that was lost may be: poses that the contour tracker starts from to find it again."""

from collections.abc import Sequence

import numpy as np

from mmocap_warp.body.model import Subject
from mmocap_warp.body.posing import Poser
from mmocap_warp.body.rotations import spread_rotations, transposed, zyx_angles, zyx_rotation
from mmocap_warp.body.shape_space import heading_rotation, upright_base
from mmocap_warp.body.skeleton import ROOT_ANGLES
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.masks.observation import Observation
from mmocap_warp.masks.visual_hull import visual_hull
from mmocap_warp.tracking.from_settings import search_limits
from mmocap_warp.tracking.limb_pairs import limbs
from mmocap_warp.tracking.track_config import TrackConfig

SCATTERED_POSES = 40  # poses of a run that are scattered around one
_SCATTER_ANGLE = 0.35  # standard deviation of the angles of scattered poses [rad]
_HEADINGS = 16  # directions that a standing body is turned to
_ROTATIONS = 20  # rotations of a body that may lie any way up
_DRAWN = 512  # poses of a limb that are drawn to find some that reach to a place
_MOST_PLACES = 24  # places that are reached for
_VOXEL = 0.04  # distance between the points of the visual hull [m]


class RecoveryStarts:
    """Makes starts for every run (run, start, coordinate), each float32 and within its limits."""

    def __init__(self, subject: Subject, rig: CameraRig, config: TrackConfig) -> None:
        self._subject, self._rig, self._seed = subject, rig, config.seed
        self._limits = search_limits(subject, config)
        self._bounds = np.clip(self._limits, -np.pi, np.pi)  # angles are drawn evenly between these
        by_part = subject.body.skeleton.searched_by_part(config.dof).values()
        self._poser, self._limbs = Poser(subject.body, subject.root_base), limbs(subject.body.skeleton)
        self._searched = subject.body.skeleton.searched(config.dof)
        own = [index[index >= ROOT_ANGLES.stop] for index in by_part]
        self._parts = [index for index in own if len(index)] or own  # a body may have no joint but its root

    def within_limits(self, pose: np.ndarray) -> np.ndarray:
        """Poses as float32, within their limits."""
        return np.asarray(np.clip(pose, self._limits[:, 0], self._limits[:, 1]).astype(np.float32))

    def scattered(self, pose: np.ndarray, counter: np.ndarray) -> np.ndarray:
        """Starts around poses (run, coordinate), each of which differs from its pose in one part of the body.

        ``counter`` (run,) has the states of the random numbers.
        """
        starts = np.repeat(pose[:, None], SCATTERED_POSES, axis=1)
        for run, of_run in enumerate(starts):
            rng = self._random(run, counter)
            for number, start in enumerate(of_run):
                index = self._parts[number % len(self._parts)]
                start[index] += rng.normal(0.0, _SCATTER_ANGLE, len(index))
        return self.within_limits(starts)

    def reaching(self, pose: np.ndarray, counter: np.ndarray, places: Sequence[np.ndarray]) -> np.ndarray:
        """Starts around poses (run, coordinate), each with a limb that reaches to places (n, 3) of its run [m].

        They are the nearest of many limbs that are drawn evenly between their limits. A run without a place keeps its
        pose.
        """
        low, high = self._bounds.T
        starts = np.repeat(pose[:, None], SCATTERED_POSES, axis=1)
        for run, wanted in enumerate(places):
            if not len(wanted) or not self._limbs:
                continue
            rng, wanted = self._random(run, counter), wanted[:: -(-len(wanted) // _MOST_PLACES)]
            drawn, away = [], []
            for limb in self._limbs:
                index = np.intersect1d(limb.coordinates, self._searched)
                poses = np.repeat(pose[run : run + 1], _DRAWN, axis=0)
                poses[:, index] = rng.uniform(low[index], high[index], (_DRAWN, len(index)))
                along = self._along_bones(poses, limb.joints)
                square = sum((wanted[:, None, k] - along[:, None, :, k]) ** 2 for k in range(3))  # (pose, place, point)
                apart = np.sqrt(square.min(axis=2)).mean(axis=1)
                near = np.argsort(apart, kind="stable")[: SCATTERED_POSES // 2]
                drawn.append(poses[near])
                away.append(apart[near])
            best = np.argsort(np.concatenate(away), kind="stable")[:SCATTERED_POSES]
            starts[run, : len(best)] = np.concatenate(drawn)[best]
        return self.within_limits(starts)

    def _along_bones(self, poses: np.ndarray, joints: np.ndarray) -> np.ndarray:
        """(pose, point, 3) points on the bones between the joints of a limb, and on its last bone beyond its end."""
        centre = self._poser.joint_transforms(poses)[:, :, :3, 3][:, joints]
        if len(joints) == 1:
            return centre
        bones = np.diff(centre, axis=1)[:, :, None] * np.array([0.25, 0.5, 0.75, 1.0, 1.25])[:, None]
        return np.asarray((centre[:, :-1, None] + bones).reshape(len(poses), -1, 3))

    def anywhere(self, pose: np.ndarray, counter: np.ndarray, observation: Observation) -> np.ndarray:
        """The last poses (run, coordinate) and the first one, moved to the visual hull and turned every way.

        A body that stands is turned about the vertical, another one any way. One whose base is fixed cannot be moved
        or turned: its joints are bent any way instead.
        """
        skeleton = self._subject.body.skeleton
        if skeleton.root_is_fixed:
            bent = np.concatenate(self._parts)
            low, high = self._bounds[bent].T
            drawn = np.repeat(pose[:, None], SCATTERED_POSES, axis=1)
            for run, of_run in enumerate(drawn):
                of_run[:, bent] = self._random(run, counter).uniform(low, high, (SCATTERED_POSES, len(bent)))
            return drawn
        # One view may be wrong: points that all others see belong to the hull.
        hull = visual_hull(self._rig, observation, spacing=_VOXEL * self._subject.body.relative_size, tolerate=1)
        up = upright_base(self._rig.up)
        if skeleton.stands:
            headings = 2 * np.pi * np.arange(_HEADINGS) / _HEADINGS
            turns = [up @ heading_rotation(heading) @ transposed(up) for heading in headings]
        else:
            turns = list(spread_rotations(_ROTATIONS))
        # The root's angles are those of the turned root, seen from the base that all frames share.
        frame, home = skeleton.frame[0].astype(float), self._subject.root_base
        starts = []
        for known in (pose.astype(float), np.repeat(self._subject.pose[None], len(pose), axis=0)):
            for turn in turns:
                turned = turn @ home @ frame @ zyx_rotation(known[:, ROOT_ANGLES])
                start = known.copy()
                start[:, ROOT_ANGLES] = zyx_angles(frame.T @ home.T @ turned)
                if len(hull):
                    start[:, :3] = np.median(hull, axis=0)
                starts.append(start)
        return self.within_limits(np.stack(starts, axis=1))

    def _random(self, run: int, counter: np.ndarray) -> np.random.Generator:
        """A run's random numbers, which depend on nothing but its seed and its counter."""
        return np.random.default_rng([self._seed + run, int(counter[run])])
