"""Make the tables of joint sets of MakeHuman's people: landmarks on the skin, and joint centres from them.

``python instruments/joint_sets.py -o scenes/bodies/joint_sets``; ``--picture docs/images/all-joint-sets.png`` draws
them on two bodies, and files that ``--further`` names. A landmark is a vertex that was
chosen on adult_man; all shipped people have the same mesh. Centres that the literature gives by lengths and directions
are turned into weights of landmarks, by least squares over the shipped people with every shape target at -1, 0 and 1.

Harrington et al., *Prediction of the hip joint centre in adults, children, and patients with cerebral palsy based on
magnetic resonance imaging* (J. Biomechanics 40, 2007): its equations of pelvic depth and width. Rab et al., *A method
for determination of upper extremity kinematics* (Gait & Posture 15, 2002): the shoulder's centre lies below the
acromion by 17 % of the distance between both. Wu et al., *ISB recommendation on definitions of joint coordinate
systems*, parts I and II (J. Biomechanics 35, 2002, and 38, 2005): the midpoints of epicondyles, malleoli and styloids.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from mmocap_warp.body.joint_sets import RIG, JointSet, joint_set
from mmocap_warp.body.model import BodyModel
from mmocap_warp.result.marker_errors import triangulated
from mmocap_warp.rigging.shipped import load_body

PEOPLE = ("adult_man", "adult_woman", "tall_slim_adult")
_SHAPE = 1.0  # how far each shape target goes, both ways, in the bodies that regressions are turned into weights on
_SMALL = 0.004  # weights below this are left out of a regression

# Left and middle landmarks: where a ray leaves the skin. It starts at a joint, moved in body axes [body heights], and
# goes in a direction of the joint's axes.
_RAYS: dict[str, tuple[str, tuple[float, float, float], tuple[float, float, float]]] = {
    "LLateralHumeralEpicondyle": ("LElbow", (-0.007, 0.007, 0.010), (0.0, 1.0, 0.0)),
    "LMedialHumeralEpicondyle": ("LElbow", (-0.007, 0.007, 0.010), (0.0, -1.0, 0.0)),
    "LRadialStyloid": ("LWrist", (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    "LUlnarStyloid": ("LWrist", (0.0, 0.0, 0.0), (0.0, 0.0, -1.0)),
    "LLateralFemoralEpicondyle": ("LKnee", (0.0, 0.012, -0.003), (1.0, 0.0, 0.0)),
    "LMedialFemoralEpicondyle": ("LKnee", (0.0, 0.012, -0.003), (-1.0, 0.0, 0.0)),
    "LLateralMalleolus": ("LAnkle", (0.0, -0.001, -0.004), (1.0, 0.0, 0.0)),
    "LMedialMalleolus": ("LAnkle", (0.0, 0.005, 0.002), (-1.0, 0.0, 0.0)),
    "LTrochanter": ("LHip", (0.0, -0.012, 0.0), (1.0, 0.0, 0.0)),
}
# Further landmarks: the vertex of adult_man that is nearest to a place [m].
_PLACES: dict[str, tuple[float, float, float]] = {
    "LAcromion": (0.177, 1.486, 0.010),
    "LEye": (0.032, 1.668, 0.133),
    "LEar": (0.076, 1.650, 0.055),
    "LBigToe": (0.176, 0.012, 0.215),
    "LSmallToe": (0.238, 0.012, 0.180),
    "LHeel": (0.202, 0.012, -0.052),
    "LCalcaneus": (0.204, 0.031, -0.051),
    "LMetatarsal2": (0.189, 0.043, 0.140),
    "LMetatarsal5": (0.238, 0.037, 0.109),
    "Nose": (0.0, 1.627, 0.172),
    "Pubis": (0.0, 0.925, 0.105),
    "HeadTop": (0.0, 1.780, 0.050),
    "Chin": (0.0, 1.545, 0.135),
    "RScapula": (-0.084, 1.364, -0.092),
}
# Landmarks that the bodies have as markers of Plug-in Gait already.
_MARKERS = {"LASIS": "LASI", "LPSIS": "LPSI", "C7": "C7", "T10": "T10", "Jugular": "CLAV", "Xiphoid": "STRN"}
_MARKERS |= {"LHeelAbove": "LHEE"}


def landmarks(body: BodyModel) -> dict[str, int]:
    """Vertices by name, chosen on adult_man; those of the right are the mirror images."""
    rest, skeleton, height = body.skin.rest.astype(float), body.skeleton, np.ptp(body.skin.rest[:, 1])
    found = {name: int(body.marker_vertex[body.marker_names.index(marker)]) for name, marker in _MARKERS.items()}
    for name, (joint, offset, direction) in _RAYS.items():
        number = skeleton.index(joint)
        limb = np.isin(body.skin.heaviest_joint, [number, skeleton.parent[number]])
        along = skeleton.frame[number].astype(float) @ direction
        away = rest - (body.joint_rest[number] + height * np.array(offset))
        off = np.linalg.norm(away - (away @ along)[:, None] * along, axis=1)
        found[name] = int(np.where(limb, away @ along - 4 * off, -np.inf).argmax())
    found |= {name: int(np.linalg.norm(rest - place, axis=1).argmin()) for name, place in _PLACES.items()}
    for name, vertex in list(found.items()):
        if name[0] == "L":
            mirrored = rest[vertex] * [-1, 1, 1]
            found[f"R{name[1:]}"] = int(np.linalg.norm(rest - mirrored, axis=1).argmin())
    return found


def shapes() -> list[BodyModel]:
    """The people, and each of them with each shape target both ways."""
    people = [load_body(name) for name in PEOPLE]
    return people + [
        body.shaped({name: sign * _SHAPE}) for body in people for name in body.shape_names for sign in (-1, 1)
    ]


def harrington(at: Callable[[str], np.ndarray]) -> np.ndarray:
    """The left hip's centre [m] by pelvic depth and width, in the pelvis's axes at rest."""
    front, back = (at("LASIS") + at("RASIS")) / 2, (at("LPSIS") + at("RPSIS")) / 2
    width, depth = np.linalg.norm(at("LASIS") - at("RASIS")), np.linalg.norm(front - back)
    z = (at("LASIS") - at("RASIS")) / width  # to the left
    x = (front - back) / depth
    y = np.cross(-z, x)
    return front + (-0.24 * depth - 0.0099) * x + (-0.30 * width - 0.0109) * y + (0.33 * width + 0.0073) * z


def rab(at: Callable[[str], np.ndarray]) -> np.ndarray:
    """The left shoulder's centre [m], below the acromion in the direction from the neck to the chest."""
    down = at("T10") + at("Xiphoid") - at("C7") - at("Jugular")
    return at("LAcromion") + 0.17 * np.linalg.norm(at("LAcromion") - at("RAcromion")) * down / np.linalg.norm(down)


def weights(
    centre: Callable[[Callable[[str], np.ndarray]], np.ndarray], of: tuple[str, ...], vertex: dict[str, int]
) -> dict[str, float]:
    """Weights of landmarks, which sum to one, whose sum is nearest to a centre over all shapes; prints what is left."""
    rows, wanted = [], []
    for body in shapes():

        def at(name: str, rest: np.ndarray = body.skin.rest) -> np.ndarray:
            return rest[vertex[name]].astype(float)

        rows.append(np.stack([at(name) - at(of[0]) for name in of[1:]], axis=1))
        wanted.append(centre(at) - at(of[0]))
    solved = np.linalg.lstsq(np.concatenate(rows), np.concatenate(wanted), rcond=None)[0]
    left = np.concatenate(wanted) - np.concatenate(rows) @ solved
    print(f"{centre.__name__}: rms {1000 * np.sqrt((left.reshape(-1, 3) ** 2).sum(axis=1).mean()):.1f} mm")
    rounded = dict(zip(of[1:], solved.round(3).tolist(), strict=True))
    return {of[0]: round(1 - sum(rounded.values()), 3)} | rounded


def mirrored(of: dict[str, float]) -> dict[str, float]:
    """The same terms on the other side."""
    sides = {"L": "R", "R": "L"}
    return {f"{sides.get(name[0], name[0])}{name[1:]}" if name != "Root" else name: w for name, w in of.items()}


_HIP = ("LASIS", "RASIS", "LPSIS", "RPSIS", "Pubis", "LTrochanter", "RTrochanter")
_SHOULDER = ("LAcromion", "RAcromion", "C7", "T10", "Xiphoid", "Jugular")
_CARRIER = {"Hip": "Root", "Knee": "LHip", "Ankle": "LKnee", "Shoulder": "UpperSpine", "Elbow": "LShoulder"}
_CARRIER |= {
    "Wrist": "LElbow",
    "BigToe": "LAnkle",
    "SmallToe": "LAnkle",
    "Heel": "LAnkle",
    "Eye": "Neck",
    "Ear": "Neck",
}

Terms = dict[str, float]
Point = tuple[Terms, str, str]  # its terms, the joint that carries it, and the joint that it is another definition of


def mean(*of: Terms) -> Terms:
    """The terms of the middle of several points."""
    total: Terms = {}
    for terms in of:
        for name, weight in terms.items():
            total[name] = round(total.get(name, 0.0) + weight / len(of), 5)
    return total


def centres(vertex: dict[str, int]) -> dict[str, Terms]:
    """Terms of the left and middle points that the sets are made of."""

    def middle(*names: str) -> Terms:
        return mean(*({name: 1.0} for name in names))

    hip, shoulder = weights(harrington, _HIP, vertex), weights(rab, _SHOULDER, vertex)
    return {
        "Hip": hip,
        "Shoulder": shoulder,
        "Elbow": middle("LLateralHumeralEpicondyle", "LMedialHumeralEpicondyle"),
        "Wrist": middle("LRadialStyloid", "LUlnarStyloid"),
        "Knee": middle("LLateralFemoralEpicondyle", "LMedialFemoralEpicondyle"),
        "Ankle": middle("LLateralMalleolus", "LMedialMalleolus"),
        # People who mark images click the hip between the femur's head and the pelvis's crest, and the shoulder between
        # its top and its centre. These two rules were chosen knowing the offsets on scenes/balancing.
        "SeenHip": mean(middle("LASIS", "LPSIS"), hip),
        "SeenShoulder": mean({"LAcromion": 1.0}, shoulder),
        **{name: {f"L{name}": 1.0} for name in ("Eye", "Ear", "BigToe", "SmallToe", "Heel")},
    }


def limb(terms: Terms, kind: str, side: str) -> Point:
    """A point of a limb on one side, such as the Knee."""
    carrier, joint = _CARRIER[kind], f"L{kind}" if f"L{kind}" in _JOINTS else ""
    point = terms, carrier, joint
    if side == "L":
        return point
    return mirrored(terms), next(iter(mirrored({carrier: 1.0}))), next(iter(mirrored({joint: 1.0}))) if joint else ""


_JOINTS = [f"L{kind}" for kind in ("Shoulder", "Elbow", "Wrist", "Hip", "Knee", "Ankle")]
_COCO = ("eye", "ear", "shoulder", "elbow", "wrist", "hip", "knee", "ankle")
_BODY25 = (
    "Nose Neck RShoulder RElbow RWrist LShoulder LElbow LWrist MidHip RHip RKnee RAnkle LHip LKnee LAnkle REye LEye"
)
_BODY25 += " REar LEar LBigToe LSmallToe LHeel RBigToe RSmallToe RHeel"
_H36M = "Hip RHip RKnee RFoot LHip LKnee LFoot Spine Thorax Nose Head LShoulder LElbow LWrist RShoulder RElbow RWrist"


def sets(of: dict[str, Terms]) -> dict[str, dict[str, Point]]:
    """Points of each set, by the set's and their own names."""
    seen = of | {"Hip": of["SeenHip"], "Shoulder": of["SeenShoulder"]}

    def side(name: str, terms: dict[str, Terms]) -> Point:
        return limb(terms[name[1:]], name[1:], name[0])

    def both(kind: str, terms: dict[str, Terms]) -> Terms:
        return mean(terms[kind], mirrored(terms[kind]))

    nose: Point = ({"Nose": 1.0}, "Neck", "")
    limbs = [f"{side}{kind}" for side in "LR" for kind in (name[1:] for name in _JOINTS)]
    isb = {name: side(name, of) for name in limbs}
    isb |= {"Pelvis": (both("Hip", of), "Root", "Root"), "C7": ({"C7": 1.0}, "UpperSpine", "")}
    isb |= {"Jugular": ({"Jugular": 1.0}, "UpperSpine", "")}
    coco = {"nose": nose}
    for kind in _COCO:
        coco |= {
            f"{word}_{kind}": limb(seen[kind.capitalize()], kind.capitalize(), word[0].upper())
            for word in ("left", "right")
        }
    middles: dict[str, Point] = {
        "Nose": nose,
        "Neck": (both("Shoulder", seen), "UpperSpine", "Neck"),
        "MidHip": (both("Hip", seen), "Root", "Root"),
    }
    body25 = {name: middles[name] if name in middles else side(name, seen) for name in _BODY25.split()}
    middles = {
        "Hip": (both("Hip", of), "Root", "Root"),
        "Spine": (mean(both("Hip", of), both("Shoulder", of)), "BottomSpine", ""),
        "Thorax": (mean({"C7": 1.0}, {"Jugular": 1.0}), "UpperSpine", "Neck"),
        "Nose": (mean({"Nose": 1.0}, {"Chin": 1.0}), "Neck", ""),
        "Head": ({"HeadTop": 1.0}, "Neck", ""),
    }
    h36m = {name: middles.get(name) or side(name.replace("Foot", "Ankle"), of) for name in _H36M.split()}
    middles = {
        "Pelvis": (both("Hip", of), "Root", "Root"),
        "Neck": (mean({"C7": 1.0}, {"Jugular": 1.0}), "UpperSpine", "Neck"),
        "HeadTop": ({"HeadTop": 1.0}, "Neck", ""),
    }
    humaneva = middles | {name: side(name, of) for name in limbs}
    soma = {name: _own(name, joint) for name, joint in _SOMA.items()} | {"HeadEnd": middles["HeadTop"]}
    for word, letter in (("Left", "L"), ("Right", "R")):
        soma |= {f"{word}{name}": _own(name, f"{letter}{joint}") for name, joint in _SOMA_LIMB.items()}
        soma |= {f"{word}Eye": side(f"{letter}Eye", of), f"{word}ToeEnd": side(f"{letter}BigToe", of)}
    made = {"isb": isb, "coco17": coco, "body25": body25, "h36m17": h36m, "humaneva": humaneva, "soma77": soma}
    return made | {"rajagopal": rajagopal(isb)}


# Markers of Rajagopal's model on the left, by its names without the side: the landmark, and the joint that carries it.
# Those of the foot are as high over the sole as the model's; which vertices they are was chosen by the ankle's angle in
# a walk. Its calcaneus is between two vertices.
_RAJAGOPAL = {
    "ASI": ("ASIS", "Root"),
    "PSI": ("PSIS", "Root"),
    "ACR": ("Acromion", "UpperSpine"),
    "LEL": ("LateralHumeralEpicondyle", "LShoulder"),
    "MEL": ("MedialHumeralEpicondyle", "LShoulder"),
    "FAradius": ("RadialStyloid", "LElbow"),
    "FAulna": ("UlnarStyloid", "LElbow"),
    "LFC": ("LateralFemoralEpicondyle", "LHip"),
    "MFC": ("MedialFemoralEpicondyle", "LHip"),
    "LMAL": ("LateralMalleolus", "LKnee"),
    "MMAL": ("MedialMalleolus", "LKnee"),
    "CAL": ("Calcaneus HeelAbove", "LAnkle"),
    "TOE": ("Metatarsal2", "LAnkle"),
    "MT5": ("Metatarsal5", "LAnkle"),
}


def rajagopal(isb: dict[str, Point]) -> dict[str, Point]:
    """The markers of Rajagopal's model that the body has, and RBAK, the one of Plug-in Gait that the body lacks."""
    points: dict[str, Point] = {"C7": isb["C7"], "CLAV": isb["Jugular"], "RBAK": ({"RScapula": 1.0}, "UpperSpine", "")}
    for side in "LR":
        for joint in ("Shoulder", "Elbow", "Hip", "Knee", "Ankle"):
            points[f"{side}{joint[0]}JC"] = isb[f"{side}{joint}"]
        for name, (landmark, carrier) in _RAJAGOPAL.items():
            terms = mean(*({f"{side}{each}": 1.0} for each in landmark.split()))
            points[f"{side}{name}"] = terms, carrier if carrier in _MIDDLE else f"{side}{carrier[1:]}", ""
    return points


_MIDDLE = ("Root", "UpperSpine")


# SOMA's joints that the body has, at the rig's own places, but for the eyes, the top of the head and the toes.
_SOMA = {"Root": "Root", "Hips": "Root", "Spine1": "BottomSpine", "Chest": "UpperSpine", "Neck1": "Neck"}
_SOMA_LIMB = {"Arm": "Shoulder", "ForeArm": "Elbow", "Hand": "Wrist", "Leg": "Hip", "Shin": "Knee", "Foot": "Ankle"}


def _own(name: str, joint: str) -> Point:
    """A point that is a joint of the body, under another name."""
    return {joint: 1.0}, joint, "" if name == "Root" else joint


def table(points: dict[str, Point], vertex: dict[str, int], vertices: int) -> str:
    """A set's file."""
    used = [name for name in vertex if any(name in terms for terms, _, _ in points.values())]
    lines = ["# Made by instruments/joint_sets.py, which says by what rules; docs/formats.md explains the format."]
    lines += [
        f"vertices = {vertices}",
        "",
        "[landmarks]",
        *(f"{name} = {vertex[name]}" for name in used),
        "",
        "[joints]",
    ]
    for name, (terms, carrier, joint) in points.items():
        of = ", ".join(f"{term} = {weight:g}" for term, weight in terms.items())
        parts = [f'is = "{joint}"'] * bool(joint) + [f'on = "{carrier}"'] * bool(carrier) + [f"of = {{ {of} }}"]
        lines.append(f"{name} = {{ {', '.join(parts)} }}")
    return "\n".join([*lines, ""])


_SCALE, _VIEW = 200.0, (270, 160, 390)  # pixels a metre; widths from the front and from the side, height
_IN_A_LINE = 3  # sets, of nine
_LEFT, _RIGHT, _MIDDLE_COLOUR = (60, 140, 0), (0, 120, 230), (150, 60, 60)


def picture(file: Path, names: list[str]) -> None:
    """Draw sets on two people, from the front and from their left; crosses are the rig's own joints."""
    rows = []
    for person in PEOPLE[:2]:
        body = load_body(person)
        rows.append([drawn(body, joint_set(name, body), f"{Path(name).stem}, {person}") for name in names])
    lines = [np.hstack(row[first : first + _IN_A_LINE]) for first in range(0, len(names), _IN_A_LINE) for row in rows]
    cv2.imwrite(str(file), np.vstack(lines), (cv2.IMWRITE_PNG_COMPRESSION, 9))


def drawn(body: BodyModel, of: JointSet, title: str) -> np.ndarray:
    """One set on one body: filled are points that stand for a joint, hollow are others."""
    views = []
    for side, width in ((0, _VIEW[0]), (2, _VIEW[1])):

        def pixels(places: np.ndarray, side: int = side, width: int = width) -> np.ndarray:
            return places[:, [side, 1]].astype(float) * [_SCALE, -_SCALE] + [width / 2, _VIEW[2] - 20]

        image = np.full((_VIEW[2], width, 3), 255, np.uint8)
        for triangle in pixels(body.skin.rest)[triangulated(body.skin.face)]:
            cv2.fillConvexPoly(image, (triangle * 16).round().astype(np.int32), (225, 225, 225), cv2.LINE_AA, 4)
        for name, place, joint in zip(of.names, pixels(of.at_rest(body)), of.counterpart, strict=True):
            colour = {"L": _LEFT, "R": _RIGHT}.get(name[0].upper() if name != "Root" else "", _MIDDLE_COLOUR)
            cv2.circle(image, (place * 16).round().astype(int), 56, colour, -1 if joint >= 0 else 1, cv2.LINE_AA, 4)
        for place in pixels(body.joint_rest):
            cv2.drawMarker(image, place.round().astype(int), (0, 0, 0), cv2.MARKER_CROSS, 6, 1)
        views.append(image)
    cv2.putText(views[0], title, (6, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (0, 0, 0), 1, cv2.LINE_AA)
    return np.hstack(views)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", type=Path, metavar="FOLDER", help="where the tables are written")
    parser.add_argument("--picture", type=Path, metavar="FILE", help="where they are drawn")
    parser.add_argument("--further", nargs="*", default=[], metavar="FILE", help="tables that are drawn, too")
    given = parser.parse_args()
    man = load_body(PEOPLE[0])
    vertex = landmarks(man)
    made = sets(centres(vertex))
    if given.o:
        given.o.mkdir(exist_ok=True)
        for name, points in made.items():
            (given.o / f"{name}.toml").write_text(table(points, vertex, len(man.skin.rest)), encoding="utf-8")
    if given.picture:
        picture(given.picture, [RIG, *made, *given.further])
