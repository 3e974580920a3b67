"""Images that show nothing new: footage of half the rate in a file of the whole, and cameras that froze for a while.

A subject who stands still has equal masks too. What tells a repeated image is that motion stops and goes on at once:
again and again in a pattern, or with a leap to where the subject has moved meanwhile.
"""

from collections.abc import Iterable

import numpy as np

from mmocap_warp.masks.observation import Observation

_LEVEL = 90  # percentile of the changes from frame to frame that stands for the motion of a clip
_MIN_LEVEL = 0.3  # pixels by which outlines must move in such a frame for anything to be decided
_MOST_ABOVE = 4.0  # multiple of other views' level that a view's is taken to be: more is not motion, its masks flicker
_SAME = 0.1  # share of the level below which a mask counts as repeated: compressed video is never quite the same
_MOVING = 0.25  # share of the level above which masks move
_LEAP = 2.0  # multiple of the level that the first new image after a long repetition changes by at least
_LEAP_OF_ONE = 1.0  # the same of one view while the others move
_SHORT = 3  # frames: longer repetitions need a leap
_APART = 5  # frames between the starts of short repetitions that make a pattern
_MIN_PATTERN = 4  # short repetitions in a row that make one
_MIN_FROZEN = 10  # frames: a camera that is frozen to the clip's end leaps nowhere


def repeated_views(observations: Iterable[Observation]) -> np.ndarray:
    """(frame, camera) bool: views that show the image of the frame before once more."""
    change = _changes(observations)
    repeated = np.zeros(change.shape, bool)
    if len(change) < _MIN_PATTERN:
        return repeated
    level = np.percentile(np.nan_to_num(change), _LEVEL, axis=0)
    known = level > _MIN_LEVEL
    usual = np.sort(level[known])[known.sum() // 2 :][:1]  # none where nothing moves
    share = change[:, known] / np.minimum(level[known], _MOST_ABOVE * usual)
    # All views at once: those that see anybody.
    at_once = (np.nan_to_num(share) < _SAME).all(axis=1) & np.isfinite(share).any(axis=1)
    repeated[_credible(_mean(share), at_once)] = True
    # A view by itself, while the others move.
    for number, k in enumerate(np.flatnonzero(known)):
        others = _mean(np.delete(share, number, axis=1))
        repeated[:, k] |= _credible(share[:, number], share[:, number] < _SAME, others)
    return repeated


def frozen_views(repeated: np.ndarray) -> np.ndarray:
    """(frame, camera) bool: of views that show an image once more, those of cameras that froze while others went on."""
    return repeated & ~repeated.all(axis=1, keepdims=True)


def _changes(observations: Iterable[Observation]) -> np.ndarray:
    """(frame, camera) by how much outlines move from the frame before, about [px]; 0 in the first frame.

    NaN where nobody is seen, and where an image is known to be of another time than its frame.
    """
    changes, before = [], None
    for seen in observations:
        last = before or seen
        largest = np.maximum(seen.foreground, last.foreground)
        pixels = np.bitwise_count(seen.words ^ last.words).sum(axis=(1, 2), dtype=np.int64)
        late, late_before = (0.0 if each.late is None else each.late for each in (seen, last))
        known = (seen.foreground > 0) & (late == late_before)  # by what differs, cameras of another rate do
        changes.append(np.where(known, pixels / (4 * np.sqrt(np.maximum(largest, 1))), np.nan))
        before = seen
    return np.array(changes)


def _mean(share: np.ndarray) -> np.ndarray:
    """(frame,) mean over the views that see anybody, 0 where none does."""
    return np.asarray(np.nan_to_num(share).sum(axis=1) / np.maximum(1, np.isfinite(share).sum(axis=1)))


def _credible(share: np.ndarray, same: np.ndarray, others: np.ndarray | None = None) -> np.ndarray:
    """(frame,) bool: those frames that are the ``same`` (likewise) as before because an image was repeated.

    ``share`` (frame,) is the change as a share of the level, ``others`` that of the other views, which must move
    meanwhile; None for all views at once. One view may be frozen to the clip's end.
    """
    same[0] = False
    edges = np.flatnonzero(np.diff(same.astype(int), prepend=0, append=0))
    leap, credible, short = _LEAP if others is None else _LEAP_OF_ONE, np.zeros(len(same), bool), []
    for first, end in edges.reshape(-1, 2).tolist():
        last, stops_at_once = end == len(same), first == 1 or share[first - 1] > _MOVING
        if not stops_at_once or (others is not None and others[first:end].mean() < _MOVING):
            continue
        if end - first > _SHORT:
            lasts = others is not None and end - first >= _MIN_FROZEN
            credible[first:end] = first > 1 and (lasts if last else share[end] > leap)
        elif last or share[end] > _MOVING:
            short.append((first, end))
    # Short repetitions count where many follow each other.
    starts = np.array([first for first, _ in short])
    for pattern in np.split(np.array(short), np.flatnonzero(np.diff(starts) > _APART) + 1):
        for first, end in pattern if len(pattern) >= _MIN_PATTERN else ():
            credible[first:end] = True
    return credible
