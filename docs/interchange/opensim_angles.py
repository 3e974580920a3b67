"""From exported ``.trc`` files to joint angles by OpenSim, and how far they are from ours.

    python opensim_angles.py MODEL FOLDER

MODEL is Rajagopal2016.osim or RajagopalLaiUhlrich2023.osim. FOLDER holds ``still.trc`` and ``walk.trc``, both with the
joint set rajagopal, and ``still/angles.csv`` and ``walk/angles.csv`` by the set isb. ``FOLDER/opensim`` gets the scaled
model ``person.osim`` and its angles ``walk.mot``. docs/measures.md has the commands; what it printed of four walks
is in opensim_angles.txt. It runs in an environment of its own, which has opensim and nothing of mmocap.
"""

from __future__ import annotations

import csv
import os
import shutil
import sys
from pathlib import Path

import numpy as np
import opensim

SETUPS = Path(__file__).with_name("opensim")
# OpenSim's coordinates and the columns of our angles.csv, without the sides' letters.
ANGLES = {
    "hip_flexion": "Hip.flexion_deg",
    "hip_adduction": "Hip.adduction_deg",
    "hip_rotation": "Hip.internal_rotation_deg",
    "knee_angle": "Knee.flexion_deg",
    "ankle_angle": "Ankle.dorsiflexion_deg",
}


def read_angles(path: Path) -> dict[str, np.ndarray]:
    """The angles of angles.csv, by column [degrees]."""
    with path.open(newline="") as file:
        head, *rows = csv.reader(file)
    columns = [(i, name) for i, name in enumerate(head) if name.endswith("_deg")]
    return {name: np.array([row[i] or "nan" for row in rows], float) for i, name in columns}


def face_along_x(source: Path, target: Path) -> None:
    """Copy a ``.trc`` whose world is turned about y so that the person faces along x at first, as OpenSim's models do.

    From the opposite heading OpenSim's solver finds no way.
    """
    lines = source.read_text().splitlines()
    names, values = lines[3].split("\t"), np.array([line.split("\t") for line in lines[6:]], float)
    left, right = (values[0, names.index(name) : names.index(name) + 3] for name in ("LHJC", "RHJC"))
    x, _, z = (right - left) / np.linalg.norm((right - left)[[0, 2]])  # to the right, which is to be z
    turn = np.array([[z, 0, -x], [0, 1, 0], [x, 0, z]])
    points = (values[:, 2:].reshape(len(values), -1, 3) @ turn.T).reshape(len(values), -1)
    rows = (
        "\t".join([f"{n:g}", f"{t:.6f}", *(f"{v:.6f}" for v in row)])
        for (n, t, *_), row in zip(values, points, strict=True)
    )
    target.write_text("\n".join([*lines[:6], *rows, ""]))


def write_still(angles: dict[str, np.ndarray], target: Path) -> None:
    """Write the legs' angles while the person stands still as a ``.mot``; the pelvis stands upright."""
    still = {f"{theirs}_{side.lower()}": angles[side + ours][0] for theirs, ours in ANGLES.items() for side in "LR"}
    still = {"pelvis_tilt": 0.0, "pelvis_list": 0.0, **still}
    head = ["still", "version=1", "nRows=8", f"nColumns={1 + len(still)}", "inDegrees=yes", "endheader"]
    rows = ("\t".join(f"{value:.6f}" for value in (i / 7, *still.values())) for i in range(8))  # OpenSim asks for six
    target.write_text("\n".join([*head, "\t".join(["time", *still]), *rows, ""]))


def main(model_file: str, folder: str) -> None:
    """Scale, solve, and print the differences."""
    opensim.Logger.setLevelString("error")
    work = Path(folder) / "opensim"
    work.mkdir(exist_ok=True)
    for setup in SETUPS.glob("*.xml"):
        shutil.copy(setup, work)
    for name in ("still.trc", "walk.trc"):
        face_along_x(Path(folder) / name, work / name)
    write_still(read_angles(Path(folder) / "still" / "angles.csv"), work / "still.mot")
    model = opensim.Model(model_file)
    coordinates = model.updCoordinateSet()
    for end in (0, 1):  # the model lets nobody turn by more than 90 degrees
        coordinates.get("pelvis_rotation").set_range(end, (2 * end - 1) * 4 * np.pi)
    for side in "lr":  # our feet turn inward and outward
        coordinates.get(f"subtalar_angle_{side}").set_locked(False)
    model.printToXML(str(work / "Rajagopal2016.osim"))  # the name in scale.xml
    os.chdir(work)
    opensim.ScaleTool("scale.xml").run()
    opensim.InverseKinematicsTool("inverse_kinematics.xml").run()
    solved, ours = opensim.TimeSeriesTable("walk.mot"), read_angles(Path("../walk/angles.csv"))
    print(f"{Path(model_file).stem} minus ours [degrees]: root mean square, mean, most, without the mean")
    for side in "LR":
        for theirs, column in ANGLES.items():
            off = solved.getDependentColumn(f"{theirs}_{side.lower()}").to_numpy() - ours[side + column]
            values = np.sqrt((off**2).mean()), off.mean(), np.abs(off).max(), off.std()
            print(f"{theirs}_{side.lower():8}", *(f"{value:6.2f}" for value in values))


if __name__ == "__main__":
    main(*sys.argv[1:])
