"""A skeleton's limbs: the parts on which no other that is searched hangs; and poses with left and right exchanged."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from mmocap_warp.body.rotations import zyx_angles, zyx_rotation
from mmocap_warp.body.skeleton import TRANSLATION, Skeleton
from mmocap_warp.contour.clip.motion_points import POINTS_A_JOINT, MotionPoints
from mmocap_warp.contour.frame.rooted import RootedPoses, Rooting

_MIRROR = np.diag([-1.0, 1.0, 1.0])  # a body's left is +X
_STEPS = 12  # Gauss-Newton steps that bring limbs to each other's place
_LARGEST = 0.5  # angle that a step turns a joint by at most [rad]
_DAMPING = 1e-4  # 10 mm at a joint is worth a radian [m^2/rad^2]


@dataclass(frozen=True, eq=False)
class Limb:
    """A part that moves nothing but itself and what is attached to it."""

    name: str  # the part's
    coordinates: np.ndarray  # (coordinate,) all angles of its joints
    reach: np.ndarray  # (coordinate,) searched angles of those joints that decide where it goes: all but its last
    other: str | None  # the name of the limb that mirrors it, if one does

    @property
    def joints(self) -> np.ndarray:
        """(joint,) int, ascending."""
        return np.unique((self.coordinates - TRANSLATION) // 3)


def limbs(skeleton: Skeleton) -> list[Limb]:
    """The limbs in the order of the skeleton's parts; the root's part is none. An arm with held fingers is one."""
    found, searched = [], skeleton.searched_by_part()
    moved = np.isin(skeleton.part, [skeleton.parts.index(name) for name in searched]) & ~skeleton.is_attached
    for name, index in searched.items():
        number = skeleton.parts.index(name)
        joints = np.flatnonzero(np.array(skeleton.part) == number).tolist()
        if (skeleton.below[joints] & moved & (np.array(skeleton.part) != number)).any() or 0 in joints:
            continue
        inner = [joint for joint in joints if any(skeleton.parent[child] == joint for child in joints)] or joints
        reach = index[np.isin((index - TRANSLATION) // 3, inner)]
        coordinates = np.concatenate([np.arange(3) + TRANSLATION + 3 * joint for joint in joints])
        found.append(Limb(name, coordinates, reach, _mirrored_part(skeleton, joints)))
    return found


def limb_pairs(skeleton: Skeleton) -> list[tuple[Limb, Limb]]:
    """Limbs that mirror each other."""
    return [pair for pair in combinations(limbs(skeleton), 2) if pair[0].other == pair[1].name]


def like_limbs(skeleton: Skeleton) -> list[tuple[Limb, Limb]]:
    """Limbs of as many joints that hang on the same one, as a hand's fingers do: masks may take one for another."""
    built = [(limb, (skeleton.parent[int(limb.joints[0])], len(limb.joints))) for limb in limbs(skeleton)]
    return [(one, other) for (one, of_one), (other, of_other) in combinations(built, 2) if of_one == of_other]


def _mirrored_part(skeleton: Skeleton, joints: list[int]) -> str | None:
    names = {skeleton.joints[joint] for joint in joints}
    for _, left, right in skeleton.pairs:
        for one, other in ((left, right), (right, left)):
            if one in names and other not in names:
                return skeleton.parts[skeleton.part[skeleton.index(other)]]
    return None


def mirrored(skeleton: Skeleton, pose: np.ndarray) -> np.ndarray:
    """A pose (coordinate,) whose paired joints have each other's angles or shifts, mirrored; the others keep theirs."""
    exchanged = pose.copy()
    for _, left, right in skeleton.pairs:
        for one, other in ((left, right), (right, left)):
            across = skeleton.frame[skeleton.index(one)].T @ _MIRROR @ skeleton.frame[skeleton.index(other)]
            theirs, slides = pose[skeleton.angles(other)], skeleton.slides[skeleton.index(one)]
            mine = across @ theirs if slides else zyx_angles(across @ zyx_rotation(theirs) @ across.T)
            exchanged[skeleton.angles(one)] = mine
    low, high = skeleton.coordinate_limits.T
    return np.asarray(np.clip(exchanged, low, high))


def places_exchanged(
    rooted: RootedPoses, pair: tuple[np.ndarray, np.ndarray], points: MotionPoints, rooting: Rooting
) -> RootedPoses:
    """Poses whose limbs' joints lie, as near as they can, where those of the other limb lay; all else stays.

    Two arms that each explain the other's mask cannot be told apart by one of them alone, nor by exchanging their
    angles: mirrored, crossed arms are crossed. Where each goes to the other's place, they uncross. The pair has the
    coordinates (coordinate,) of each limb, joint by joint from the trunk on.
    """
    one, other = (np.unique((limb - TRANSLATION) // 3) for limb in pair)
    joints, centres = np.concatenate([one, other]), points.at(rooted)[:, ::POINTS_A_JOINT]
    wanted = centres[:, np.concatenate([other, one])]
    # Start from rest: a crossed arm would have to pass through the trunk.
    moved = np.flatnonzero(np.isin(rooting.searched, np.concatenate(pair)))
    pose = rooted.pose.copy()
    pose[:, rooting.searched[moved]] = 0.0
    exchanged = rooting.stepped(RootedPoses(rooted.base, pose), np.zeros((len(pose), len(rooting.searched))))
    # Gauss-Newton on the distances of the joints' centres from where they should be.
    for _ in range(_STEPS):
        place, derivative = points.linearised(exchanged)
        away = (wanted - place[:, ::POINTS_A_JOINT][:, joints]).reshape(len(pose), -1, 1)
        by_angle = derivative[:, ::POINTS_A_JOINT][:, joints][..., moved].reshape(len(pose), -1, len(moved))
        across = np.swapaxes(by_angle, 1, 2)
        turned = np.linalg.solve(across @ by_angle + _DAMPING * np.eye(len(moved)), across @ away)[..., 0]
        step = np.zeros((len(pose), len(rooting.searched)))
        step[:, moved] = np.clip(turned, -_LARGEST, _LARGEST)
        exchanged = rooting.stepped(exchanged, step)
    return exchanged
