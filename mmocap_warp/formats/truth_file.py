"""Reading what is known of a recording's truth, whatever its format."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mmocap_warp.errors import InputError
from mmocap_warp.formats.motion.read_trc import read_trc
from mmocap_warp.formats.usd.usd_file import USD_SUFFIXES
from mmocap_warp.formats.usd.usd_truth import read_truth
from mmocap_warp.result.truth import Truth


def load_truth(path: str | Path, axes: str = "xyz", first_frame: int = 0) -> Truth:
    """Read the truth of a recording: the project's own USD, or joints from a ``.trc`` file.

    Args:
        path: the file.
        axes: of a ``.trc``: which of the file's axes are the world's x, y and z.
        first_frame: of a ``.trc``: the recording's frame number of the first row.

    Raises:
        InputError: a missing or wrong file, or axes for one that is in the world's own.
    """
    path = Path(path)
    if path.suffix == ".trc":
        tracks = read_trc(path, axes)
        frames = tracks.frame_numbers - tracks.frame_numbers[0] + first_frame
        try:
            return Truth(tracks.rate, frames, (), np.zeros((len(frames), 0, 3)), tracks.names, tracks.positions)
        except ValueError as error:
            raise InputError(path, str(error), "export it again") from error
    if path.suffix in USD_SUFFIXES:
        if axes != "xyz":
            raise InputError(path, f"is in the world's own axes, not {axes!r}", "leave the axes out: a .trc needs them")
        return read_truth(path)
    raise InputError(path, f"{path.suffix or 'no suffix'!r} is no format of truth", "give a .usda, .usdc or .trc file")
