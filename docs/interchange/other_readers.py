"""Reads exports of one result with OpenSim, ezc3d and bvhio, and says how far their joints are from the ``.npz``.

Run in an environment of its own (``pip install opensim ezc3d bvhio``):

    python other_readers.py FOLDER

FOLDER holds ``walk.npz``, ``walk.trc``, ``walk.mot``, ``walk.c3d`` and ``walk.bvh`` of one result whose world is Z up.
What it printed is in other_readers.txt.
"""

from __future__ import annotations

import sys
from pathlib import Path

import bvhio
import ezc3d
import numpy as np
import opensim


def main(folder: Path) -> None:
    """Print a line a file."""
    with np.load(folder / "walk.npz") as arrays:
        names, joints, time = arrays["joint_names"], arrays["joints"], arrays["time"]
    y_up = np.stack([joints[..., 0], joints[..., 2], -joints[..., 1]], axis=-1)

    table = opensim.TimeSeriesTableVec3(str(folder / "walk.trc"))
    columns = [table.getDependentColumn(str(name)) for name in names]
    found = np.array([[column[row].to_numpy() for column in columns] for row in range(len(time))])
    late = np.abs(np.array(table.getIndependentColumn()) - time).max()
    print(f"walk.trc by OpenSim: {table.getNumRows()} frames of {table.getNumColumns()} points in", end=" ")
    print(f"{table.getTableMetaDataString('Units')}, {off(found, y_up)}, times by {late:.1e} s")

    angles = opensim.TimeSeriesTable(str(folder / "walk.mot"))
    root = np.stack([angles.getDependentColumn(name).to_numpy() for name in ("Tx", "Ty", "Tz")], axis=1)
    degrees = angles.getTableMetaDataString("inDegrees")
    print(f"walk.mot by OpenSim: {angles.getNumRows()} frames, inDegrees {degrees}, root {off(root, y_up[:, 0])}")

    file = ezc3d.c3d(str(folder / "walk.c3d"))
    about = file["parameters"]["POINT"]
    rows = [about["LABELS"]["value"].index(name) for name in names]
    found = file["data"]["points"][:3, rows].transpose(2, 1, 0) / 1000
    print(f"walk.c3d by ezc3d: {about['RATE']['value'][0]:g} Hz, {off(found, joints)}")

    figure = bvhio.readAsHierarchy(str(folder / "walk.bvh"))
    found = np.empty_like(y_up)
    for frame in range(len(time)):
        figure.loadPose(frame)
        place = {joint.Name: list(joint.PositionWorld) for joint, _, _ in figure.layout()}
        found[frame] = [place[name] for name in names]
    print(f"walk.bvh by bvhio: {off(found / 100, y_up)}")


def off(found: np.ndarray, expected: np.ndarray) -> str:
    """How far two arrays of places are apart."""
    return f"off by at most {np.abs(found - expected).max():.1e} m"


if __name__ == "__main__":
    main(Path(sys.argv[1]))
