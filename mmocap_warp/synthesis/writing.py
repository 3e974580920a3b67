"""Writing what was made up as a scene: masks, calibration, truth, and the scene file that names them."""

from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import numpy as np

from mmocap_warp.body.model import Subject
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.formats.calibration.toml_rig import write_toml_rig
from mmocap_warp.formats.image_files import make_image_folders, write_png
from mmocap_warp.formats.toml_table import quoted, visible
from mmocap_warp.formats.truth_file import write_truth
from mmocap_warp.formats.usd.usd_body import write_subject
from mmocap_warp.result.truth import Truth
from mmocap_warp.whole_file import file_name, write_whole

_SCENE = """\
# {about}
[scene]
name = {name}
fps = {fps:g}
up = "{up}"
{starts}{truth}
[cameras]
calibration = "calibration.toml"
{cameras}
{foreground}"""

FAULTY_MASKS = """\
[foreground]
source = "masks"
median = 3.0
fill_holes = 150.0
min_area = 200.0
keep = "largest"
join = 6.0
"""
"""Settings for masks with made-up faults: what is cleaned of them, as of any."""


class Footage(Protocol):
    """What a scene is written from: a ``made_recording.Recording``, or one that was made worse."""

    @property
    def fps(self) -> float:
        """Frames per second."""

    @property
    def rig(self) -> CameraRig:
        """The cameras, as the scene shall say they are."""

    def __len__(self) -> int:
        """How many frames."""

    def masks(self, frame: int) -> list[np.ndarray]:
        """Per camera (height, width) bool, or uint8 labels; each frame is asked for once, in order."""


Progress = Callable[[int, int], None]
"""Called after each frame with the numbers of frames done and in all."""


def write_made_scene(
    folder: Path,
    footage: Footage,
    truth: Truth | None,
    *,
    name: str,
    about: str,
    foreground: str,
    subject: Subject | None = None,
    body: Path | None = None,
    progress: Progress | None = None,
) -> Path:
    """Write ``masks/<camera>/<frame>.png``, ``calibration.toml``, ``truth.usdc`` and last ``scene.toml``: its path.

    The folder is made if it does not exist, with those above it; files of the same names are replaced. There is no
    ``truth`` where the scene file's end names those of several people. ``about`` says what it is, for the scene file's
    first line, and ``foreground`` is the scene file's table of that name with what else ends it. ``subject`` is written
    as ``subject.usdc`` if given, and the file of the ``body`` that a fit starts from copied. Raises an InputError for a
    folder that cannot be written to.
    """
    folders = [folder / "masks" / file_name(name, folder) for name in footage.rig.names]
    make_image_folders(folder, folders, digits=4)
    for frame in range(len(footage)):
        for each, mask in zip(folders, footage.masks(frame), strict=True):
            write_png(each / f"{frame:04d}.png", mask)
        if progress is not None:
            progress(frame + 1, len(footage))
    write_toml_rig(folder / "calibration.toml", footage.rig)
    if truth is not None:
        write_truth(folder / "truth.usdc", truth, footage.rig.up)
    if subject is not None:
        write_subject(folder / "subject.usdc", subject)
    named = {} if subject is None else {"subject": "subject.usdc"}
    if body is not None:
        named["body"] = f"body{body.suffix}"
        write_whole(folder / named["body"], body.read_bytes())
    text = _SCENE.format(
        about=visible(about),
        name=quoted(name),
        fps=footage.fps,
        up=footage.rig.up,
        truth="" if truth is None else '\n[truth]\nfile = "truth.usdc"\n',
        starts="".join(f'{key} = "{file}"\n' for key, file in named.items()),
        cameras="".join(f'\n[cameras.{name}]\nmasks = "masks/{name}"\n' for name in footage.rig.names),
        foreground=foreground,
    )
    write_whole(folder / "scene.toml", text.encode())
    return folder / "scene.toml"
