"""How a view's lag changes in the course of a recording: a dropped frame is a jump, another frame rate a slope."""

from dataclasses import dataclass, field

import numpy as np

_MIN_JUMP, _MIN_DRIFT = 1.5, 2.5  # frames: smaller changes happen by chance
_MIN_RATIO = 2.5  # scatter about a steady lag over the scatter about the change, at least
MIN_STRETCHES = 3
"""Stretches from which a standard deviation is estimated, at least."""
_MIN_SIDE = 2  # stretches before and after a jump, at least


@dataclass(frozen=True)
class LagCourse:
    """The course of a view's lag; a steady one has neither jump nor slope."""

    jump: int = 0  # frames by which it changes at once: 1 less for each frame that the camera dropped
    at: int = 0  # the frame before which it changes
    slope: float = 0.0  # frames that the camera has beyond its stated rate, for each of the scene's frames
    start: float = 0.0  # its lag at the scene's frame 0 beyond its offset, where it has a slope [frames]
    scatter: float = field(default=0.0, compare=False)  # root mean square of the lags about this course [frames]

    @property
    def changes(self) -> bool:
        """Whether the lag is not the same all along."""
        return self.jump != 0 or self.slope != 0.0

    def fault(self, name: str, fps: float) -> str:
        """What the change says of the camera ``name``, whose frame rate it makes ``fps``, and what to do."""
        if self.jump:
            what = f"dropped {-self.jump}" if self.jump < 0 else f"has {self.jump} too many"
            return f"{name} {what} of its frames near frame {self.at}: its offset changes there; cut or mend the video"
        runs = f"{100 * abs(self.slope):.1f} % {'faster' if self.slope > 0 else 'slower'}"
        return (
            f"{name} runs {runs} than it says, or dropped frames here and there: set fps = {fps:g} under "
            f"[cameras.{name}] and run sync again; if it still changes, mend the video"
        )


def lag_course(frame: np.ndarray, lag: np.ndarray) -> LagCourse:
    """The course of a view's lag, from its lags beyond the view's offset in stretches of a recording [frames].

    ``frame`` (stretch,) are the scene's frames in their middle, ascending.
    """
    # Three models: steady, a line, and a step at the best place.
    steady = _rms(lag - lag.mean())
    if len(lag) < 2 * _MIN_SIDE:
        return LagCourse(scatter=steady)
    slope, start = np.polyfit(frame, lag, 1)
    line = _rms(lag - start - slope * frame)
    splits = range(_MIN_SIDE, len(lag) - _MIN_SIDE + 1)
    sides = [(lag[:split], lag[split:]) for split in splits]
    steps = [_rms(np.concatenate([side - side.mean() for side in both])) for both in sides]
    best = int(np.argmin(steps))
    # The better of line and step counts where it is large, and clearly better than a steady lag.
    if line <= steps[best]:
        changes = abs(slope) * (frame[-1] - frame[0]) > _MIN_DRIFT and steady > _MIN_RATIO * line
        drift = LagCourse(slope=float(slope), start=float(start), scatter=line)
        return drift if changes else LagCourse(scatter=steady)
    before, after = sides[best]
    jump = float(after.mean() - before.mean())
    if abs(jump) < _MIN_JUMP or steady < _MIN_RATIO * steps[best]:
        return LagCourse(scatter=steady)
    split = splits[best]
    return LagCourse(jump=round(jump), at=int(frame[split - 1] + frame[split]) // 2, scatter=steps[best])


def peak(score: np.ndarray) -> float:
    """The place of the highest score, with fractions by the parabola through it and its neighbours."""
    best = int(np.clip(np.argmax(score), 1, len(score) - 2))
    before, at, after = score[best - 1 : best + 2]
    bend = before - 2 * at + after
    return best + float(np.clip(0.5 * (before - after) / bend if bend < 0 else 0.0, -1, 1))


def margin(sigma: np.ndarray, stretches: int) -> float:
    """Half the width of a confidence interval that holds each of some offsets in 99 of 100 recordings [frames].

    ``sigma`` (view,) are their standard deviations, each from so many ``stretches`` of a recording. The largest counts,
    because one camera may run at another rate.
    """
    from scipy.stats import t

    return float(np.max(sigma) * t.ppf(0.995, (stretches - 1) * len(sigma)))


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
