"""From an exported ``.trc`` to joint angles by OpenSim: scaling, markers, inverse kinematics, comparison with ours.

docs/measures.md has the commands; what it printed of the built-in walk is in opensim_angles.txt. It runs in an
environment of its own, which has opensim and nothing of mmocap.
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import numpy as np
import opensim

# OpenSim's body, the joints of ours whose distance it is scaled by, and the same joints' frames in OpenSim's model.
_LENGTHS = {
    "pelvis": ("LHip", "RHip", "femur_l", "femur_r"),
    "femur_r": ("RHip", "RKnee", "femur_r", "tibia_r"),
    "femur_l": ("LHip", "LKnee", "femur_l", "tibia_l"),
    "tibia_r": ("RKnee", "RAnkle", "tibia_r", "talus_r"),
    "tibia_l": ("LKnee", "LAnkle", "tibia_l", "talus_l"),
    "torso": ("RHip", "RShoulder", "femur_r", "humerus_r"),
}
# Markers of the .trc by the body of OpenSim's model that they are fixed to.
_MARKERS = {
    "pelvis": ("LHip", "RHip", "Root", "BottomSpine"),
    "femur_r": ("RKnee", "RTHI"),
    "femur_l": ("LKnee", "LTHI"),
    "tibia_r": ("RAnkle", "RTIB"),
    "tibia_l": ("LAnkle", "LTIB"),
    "calcn_r": ("RHEE", "RTOE", "RANK"),
    "calcn_l": ("LHEE", "LTOE", "LANK"),
    "torso": ("UpperSpine", "Neck", "LShoulder", "RShoulder"),
}
# OpenSim's coordinates and the columns of our angles.csv, without the sides' letters.
_ANGLES = {
    "hip_flexion": "Hip.flexion_deg",
    "hip_adduction": "Hip.adduction_deg",
    "hip_rotation": "Hip.internal_rotation_deg",
    "knee_angle": "Knee.flexion_deg",
    "ankle_angle": "Ankle.dorsiflexion_deg",
}


def read_trc(path: Path) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Times (frame,) and markers by name, (frame, 3) each [m]."""
    lines = path.read_text().splitlines()
    names = [name for name in lines[3].split("\t")[2:] if name]
    values = np.array([line.split("\t") for line in lines[5:] if line.strip()], float)
    return values[:, 1], {name: values[:, 2 + 3 * i : 5 + 3 * i] for i, name in enumerate(names)}


def read_angles(path: Path) -> dict[str, np.ndarray]:
    """The columns of angles.csv, by name."""
    with path.open(newline="") as file:
        head, *rows = csv.reader(file)
    return {name: np.array([row[i] or "nan" for row in rows], float) for i, name in enumerate(head)}


def coordinates_of(angles: dict[str, np.ndarray], frame: int) -> dict[str, float]:
    """Values of OpenSim's coordinates in a frame of ours [degrees]."""
    return {
        f"{theirs}_{side.lower()}": float(angles[side + ours][frame])
        for theirs, ours in _ANGLES.items()
        for side in "LR"
    }


def scaled(model: opensim.Model, still: dict[str, np.ndarray]) -> opensim.Model:
    """The model with each body as long as ours is between the same joints; bodies that are not named follow those."""
    state = model.initSystem()

    def place(body: str) -> np.ndarray:
        return model.getBodySet().get(body).getPositionInGround(state).to_numpy()

    factor = {
        body: np.linalg.norm(still[a][0] - still[b][0]) / np.linalg.norm(place(c) - place(d))
        for body, (a, b, c, d) in _LENGTHS.items()
    }
    factor |= {f"{part}_{side}": factor[f"tibia_{side}"] for part in ("talus", "calcn", "toes") for side in "lr"}
    scales = opensim.ScaleSet()
    for body in model.getBodySet():
        of = float(factor.get(body.getName(), factor["torso"]))
        scale = opensim.Scale()
        scale.setSegmentName(body.getName())
        scale.setScaleFactors(opensim.Vec3(of, of, of))
        scale.setApply(True)
        scales.cloneAndAppend(scale)
    model.scale(state, scales, True)
    return model


def put_markers(model: opensim.Model, still: dict[str, np.ndarray], pose: dict[str, float]) -> None:
    """Fix markers to bodies where they are while somebody stands still: the model stands in the same pose."""
    state = model.initSystem()
    right = still["RHip"][0] - still["LHip"][0]
    pose = pose | {"pelvis_rotation": float(np.degrees(np.arctan2(right[0], right[2])))}
    for name, degrees in pose.items():
        model.getCoordinateSet().get(name).setValue(state, np.radians(degrees), False)
    model.assemble(state)
    model.realizePosition(state)
    hips = [model.getBodySet().get(f"femur_{side}").getPositionInGround(state).to_numpy() for side in "lr"]
    shift = np.mean(hips, axis=0) - (still["LHip"][0] + still["RHip"][0]) / 2
    ground, found = model.getGround(), []
    for body, names in _MARKERS.items():
        frame = model.getBodySet().get(body)
        for name in names:
            there = opensim.Vec3(*(still[name][0] + shift))
            found.append((name, frame, ground.findStationLocationInAnotherFrame(state, there, frame)))
    for marker in found:
        model.addMarker(opensim.Marker(*marker))
    model.finalizeConnections()


def solve(model: opensim.Model, trc: Path, output: Path) -> None:
    """Inverse kinematics: the coordinates of each frame, written as ``.mot``."""
    for coordinate in model.getCoordinateSet():
        if coordinate.getName().startswith(("arm_", "elbow_", "pro_sup", "wrist_", "mtp_", "neck_")):
            coordinate.set_locked(True)  # no marker tells them
    tool = opensim.InverseKinematicsTool()
    tool.setModel(model)
    tool.setMarkerDataFileName(str(trc))
    time, _ = read_trc(trc)
    tool.setStartTime(time[0])
    tool.setEndTime(time[-1])
    for names in _MARKERS.values():
        for name in names:
            task = opensim.IKMarkerTask()
            task.setName(name)
            task.setApply(True)
            task.setWeight(1.0)
            tool.upd_IKTaskSet().cloneAndAppend(task)
    tool.set_report_errors(False)
    tool.setOutputMotionFileName(str(output))
    tool.run()


def main(model_file: str, still_trc: str, still_angles: str, trc: str, angles: str, output: str) -> None:
    """Scale, put markers, solve, and print how far OpenSim's angles are from ours.

    OpenSim's knee only bends. Where ours also turns a little, OpenSim turns the hip instead: the hip's rotation is
    compared with the sum of both, too.
    """
    opensim.Logger.setLevelString("error")
    _, still = read_trc(Path(still_trc))
    model = scaled(opensim.Model(model_file), still)
    put_markers(model, still, coordinates_of(read_angles(Path(still_angles)), 0))
    solve(model, Path(trc), Path(output))
    solved, ours = opensim.TimeSeriesTable(output), read_angles(Path(angles))
    print("OpenSim minus ours [degrees]: root mean square, mean, most")
    for side in "LR":
        for theirs, column in _ANGLES.items():
            found = solved.getDependentColumn(f"{theirs}_{side.lower()}").to_numpy()
            print(_row(f"{theirs}_{side.lower()}", found - ours[side + column]))
            if theirs == "hip_rotation":
                turned = ours[side + column] + ours[f"{side}Knee.internal_rotation_deg"]
                print(_row("  from hip + knee", found - turned))


def _row(name: str, off: np.ndarray) -> str:
    return f"{name:18}{np.sqrt((off**2).mean()):6.2f}{off.mean():7.2f}{np.abs(off).max():6.2f}"


if __name__ == "__main__":
    main(*sys.argv[1:])
