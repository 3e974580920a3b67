"""``python -m mmocap_warp.synthesis.characters FOLDER``: give imported characters the motions that this project wrote.

FOLDER holds ``hand.usdc``, ``anymal.usdc`` and ``panda.usdc``, as ``mmocap body import`` makes them; motions that they
have are replaced.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

from mmocap_warp.body.body_motion import BodyMotion
from mmocap_warp.body.model import BodyModel
from mmocap_warp.errors import InputError
from mmocap_warp.formats.usd.usd_body import read_body, write_body
from mmocap_warp.synthesis.motion.hand_signs import hand_motions
from mmocap_warp.synthesis.motion.robot_tasks import anymal_motions, panda_motions

MOTIONS: dict[str, Callable[[BodyModel], dict[str, BodyMotion]]] = {
    "hand": hand_motions,
    "anymal": anymal_motions,
    "panda": panda_motions,
}
"""What each character does, by its name."""


def write_motions(folder: Path) -> list[Path]:
    """Write the characters of a folder again with their motions; the files.

    Raises:
        InputError: one is missing or is no body, or the folder cannot be written to.
    """
    files = [folder / f"{name}.usdc" for name in MOTIONS]
    for file in files:
        body = read_body(file)
        write_body(file, body, MOTIONS[file.stem](body))
    return files


if __name__ == "__main__":
    if len(sys.argv) != 2:
        raise SystemExit("usage: python -m mmocap_warp.synthesis.characters FOLDER")
    try:
        print("\n".join(f"wrote {file}" for file in write_motions(Path(sys.argv[1]))))
    except InputError as error:
        print(error, file=sys.stderr)
        raise SystemExit(3) from None
