"""The clip's problem while it is still being recorded: poses are final a few frames after they were seen."""

from __future__ import annotations

import numpy as np

from mmocap_warp.contour import ACCELERATION
from mmocap_warp.contour.clip.clip_problem import ClipProblem, ClipSolution, Pass, SolvedWindow
from mmocap_warp.contour.clip.motion_penalty import HELD
from mmocap_warp.contour.frame.rooted import RootedPoses

LAG = 10
"""Frames that are solved together."""
COMMIT = 4
"""How many of them are final each time."""
STEPS = 2


class FixedLag:
    """Solves the newest frames whenever enough have come.

    Args:
        problem: whose equations are asked for the frames that are not final yet.
        acceleration: standard deviation of a joint's acceleration, by coordinate [m/s^2].
    """

    def __init__(self, problem: ClipProblem, acceleration: float = ACCELERATION) -> None:
        self._problem = problem
        self._passes = (Pass(acceleration, STEPS),)
        self._held = self._waiting = problem.rooting.none
        self._final = 0  # frames so far

    def add(self, rooted: RootedPoses) -> ClipSolution | None:
        """Takes the next frame's pose, as it was tracked, and returns the frames that are final now, if any are."""
        self._waiting = self._waiting.followed_by(rooted)
        return self._solved(COMMIT) if len(self._waiting) >= LAG else None

    def rest(self) -> ClipSolution | None:
        """The last frames, when no more will come."""
        return self._solved(len(self._waiting)) if len(self._waiting) else None

    def _solved(self, commit: int) -> ClipSolution:
        """The first ``commit`` of the waiting frames."""
        frames = np.arange(self._final, self._final + len(self._waiting))
        rooted, contour = self._problem.solved_together(frames, self._waiting, self._held, self._passes)
        self._final += commit
        self._waiting = rooted[commit:]
        self._held = self._held.followed_by(rooted[:commit])[-HELD:]
        return SolvedWindow(rooted, contour, commit).solution
