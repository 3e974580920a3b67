"""Who is who in label images of several views: labels that have a common hull are one person, frame by frame.

So labels may be swapped between views and frames, and a view may show two people as one.
"""

from collections import Counter
from itertools import count

import numpy as np

from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.masks.visual_hull import hull_thickness, meeting_point, seen_at

UNDECIDED = 255  # the label of pixels that may be of either of two people
_RAYS = 80  # of each label's pixels, which are followed through the other views
_DEPTHS = np.arange(0.5, 12.0, 0.06)  # along them [m]
_MIN_SHARE = 0.6  # of a label's rays, on which the person's labels of all views meet. Of a sound one it is 0.7 to 1
_MIN_SURE = 0.2  # of them, on which no view shows another label, which may hide the person
_MIN_VIEWS = 3  # that show a person, or both of two: what two views have in common may be nobody
_MIN_OVERLAP = 0.2  # share of a person's pixels that were this person's when they were last labelled


class People:
    """Gives each person a number, from 1 on, in all views and frames; the cameras are undistorted pinholes."""

    def __init__(self, rig: CameraRig) -> None:
        self._rig = rig
        self._last: list[np.ndarray] = []  # per camera whose each pixel was, when it was anybody's
        self._labels: dict[int, np.ndarray] = {}  # what each person had in the images before (camera,)
        self.views: Counter[int] = Counter()  # how many images show each person
        self.swaps = 0  # how often an image has another label for a person than the one before

    def __call__(self, images: list[np.ndarray]) -> list[np.ndarray]:
        """A frame's labels, per camera (height, width) uint8, with people's numbers in place of each view's own."""
        self._last = self._last or [np.zeros_like(image) for image in images]
        people, made = self._people(images), [np.zeros_like(image) for image in images]
        for person, labels in people.items():
            before, self._labels[person] = self._labels.get(person, labels), labels
            self.swaps += int(((labels != before) & (labels * before > 0)).sum())
            self.views[person] += int((labels > 0).sum())
            for image, mask in zip(made, _masks(images, labels), strict=True):
                image[mask] = person
        self._last = [np.where(new > 0, new, old) for new, old in zip(made, self._last, strict=True)]
        # Whom a view does not show may be part of another's label there: somebody stands before them.
        for labels in people.values():
            for k in np.flatnonzero(labels == 0):
                made[k][self._hull(int(k), made[k] > 0, _masks(images, labels))] = UNDECIDED
        return made

    def _people(self, images: list[np.ndarray]) -> dict[int, np.ndarray]:
        """Each person's labels (camera,). Those who have no hull have the labels where they were last seen."""
        groups, known, people = dict(enumerate(self._groups(images))), len(self._labels), dict[int, np.ndarray]()
        overlap = np.zeros((len(groups), 1 + known))
        for g, labels in groups.items():
            were = np.concatenate([a[b] for a, b in zip(self._last, _masks(images, labels), strict=True)])
            overlap[g, 1:] = np.bincount(were, minlength=1 + known)[1:] / len(were)
        while overlap.max(initial=0) > _MIN_OVERLAP:
            g, person = map(int, np.unravel_index(overlap.argmax(), overlap.shape))
            overlap[g], overlap[:, person], people[person] = 0, 0, groups.pop(g)
        people |= zip(count(1 + known), groups.values(), strict=False)
        for person in range(1, 1 + known):
            if person not in people:
                labels = people[person] = np.zeros(len(images), int)
                for k, (image, last) in enumerate(zip(images, self._last, strict=True)):
                    pixels = np.bincount(image[last == person], minlength=1 + UNDECIDED)
                    pixels[[0, *(taken[k] for taken in people.values())]] = 0
                    labels[k] = pixels.argmax()
        return people

    def _groups(self, images: list[np.ndarray]) -> list[np.ndarray]:
        """Labels (camera,) that have a common hull, 0 for a view without; the surest first."""
        seen = np.array([(k, label) for k, image in enumerate(images) for label in np.unique(image) if label])
        least, rated, groups = min(_MIN_VIEWS, len(images)), [], list[np.ndarray]()
        if not len(seen):
            return groups
        rays = [self._rays(k, images[k] == label) for k, label in seen]  # (ray, depth, 3) each
        owner, points = np.repeat(np.arange(len(seen)), [len(each) for each in rays]), np.concatenate(rays)
        # What the views show at points that may be a person's: kinds (kind, camera). Beyond an image it may be any, -1.
        views = [seen_at(self._rig, k, points.reshape(-1, 3), image, -1)[1] for k, image in enumerate(images)]
        at = np.stack(views, axis=-1).reshape(*points.shape[:2], -1)
        at[np.arange(len(at)), :, seen[owner, 0]] = seen[owner, 1:]
        ray, depth = np.nonzero((at > 0).sum(axis=-1) >= least)
        kinds, kind = np.unique(at[ray, depth], axis=0, return_inverse=True)
        met = np.zeros((len(at), len(kinds)), bool)
        met[ray, kind] = True
        without = [np.where(np.arange(len(images)) == k, 0, kinds) for k in range(len(images))]
        for labels in np.unique(np.maximum(np.concatenate([kinds, *without]), 0), axis=0):
            alike = (kinds == labels) & (labels > 0)
            agree = alike | (labels == 0) | (kinds < 0)
            most = alike.sum(axis=1) > max(least - 1, (labels > 0).sum() / 2)
            own = labels[seen[:, 0]] == seen[:, 1]
            # Of each of its labels the share of rays on which all views agree, and where another's label may hide it.
            sure, possible = (
                (np.bincount(owner, met[:, most & like.all(axis=1)].any(axis=1)) / np.bincount(owner))[own]
                for like in (agree, agree | (kinds > 0))
            )
            if own.sum() >= least and possible.min() > _MIN_SHARE and sure.min() > _MIN_SURE:
                rated.append((possible.sum(), labels))
        for _, labels in sorted(rated, key=lambda each: -each[0]):
            if not any(((labels == other) & (labels > 0)).any() for other in groups):
                groups.append(labels)
        return groups

    def _rays(self, k: int, mask: np.ndarray) -> np.ndarray:
        """(ray, depth, 3): points behind some pixels of camera ``k`` [m]."""
        pixels = np.argwhere(mask)[:, ::-1]
        pixels = np.insert(pixels[:: -(-len(pixels) // _RAYS)], 2, 1, axis=1) @ np.linalg.inv(self._rig.K[k]).T
        return np.asarray((pixels[:, None] * _DEPTHS[:, None] - self._rig.t[k]) @ self._rig.R[k])

    def _hull(self, k: int, where: np.ndarray, masks: list[np.ndarray]) -> np.ndarray:
        """(height, width) bool: the pixels of camera ``k`` in ``where`` behind which the other views' masks meet."""
        others, inside = [j for j, mask in enumerate(masks) if mask.any()], np.zeros_like(where)
        if len(others) > 1:
            depth = float((self._rig.R[k] @ meeting_point(self._rig, masks) + self._rig.t[k])[2])
            inside[where] = hull_thickness(self._rig, masks, k, others, np.argwhere(where)[:, ::-1], depth) > 0
        return inside


def _masks(images: list[np.ndarray], labels: np.ndarray) -> list[np.ndarray]:
    return [(image == label) & (image > 0) for image, label in zip(images, labels, strict=True)]
