"""Frames of a scene for a program that makes masks, and the scene with what it made.

All lies in one folder, which is kept until the masks are finished: a run that was stopped goes on there.
"""

import json
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from mmocap_warp.errors import InputError
from mmocap_warp.formats.image_files import write_png
from mmocap_warp.masks.frames import read_image
from mmocap_warp.masks.mask_files import MaskImages, open_masks
from mmocap_warp.masks.mask_image import Labels, decode_mask
from mmocap_warp.masks.mask_program import MaskProgram
from mmocap_warp.masks.people import UNDECIDED, People
from mmocap_warp.scene.kept_masks import calibration_hash
from mmocap_warp.scene.mask_writing import mask_mark
from mmocap_warp.scene.recording import Person, Scene
from mmocap_warp.version import __version__
from mmocap_warp.whole_file import file_name, write_whole

UNFINISHED = "unfinished"  # the name of the folder, in that of the masks
_MIN_SEEN = 0.1  # of the images that show whoever is seen most; who is in fewer is left out
_JPEG = (cv2.IMWRITE_JPEG_QUALITY, 95)


def masks_by_program(
    scene: Scene, folder: Path, program: MaskProgram, scale: float, progress: Callable[[int, int], None]
) -> Scene:
    """The scene with masks that a program makes of its undistorted images; see ``masks/mask_program.py``.

    Each video is decoded once, while the program works on the camera before. ``progress`` is called with the masks that
    are there, and how many there will be. A folder that holds frames and masks of another scene or program is refused.
    Raises an InputError for videos that cannot be read, a program that fails, or a folder that cannot be written.
    """
    _check_key(folder / "made_from.json", _key(scene, program, scale))
    names = [file_name(name, scene.path) for name in scene.calibrated.names]
    sizes = [(int(width), int(height)) for width, height in scene.rig(scale).size]
    total, every, sources = scene.frame_count, scene.frame_count * len(names), []
    with ThreadPoolExecutor(1) as pool:
        frames = [pool.submit(_write_frames, scene, k, scale, folder / "frames" / name) for k, name in enumerate(names)]
        try:
            for k, (source, name, size) in enumerate(zip(scene.cameras, names, sizes, strict=True)):
                masks = folder / "masks" / name
                masks.mkdir(parents=True, exist_ok=True)
                program.make(frames[k].result(), masks, size, lambda n: progress(len(sources) * total + n, every))
                for frame in range(total):  # what the camera has no image of has an empty mask
                    if not (folder / "frames" / name / f"{frame:06d}.jpg").exists():
                        write_png(masks / f"{frame:06d}.png", np.zeros(size[::-1], bool))
                made = MaskImages(masks, tuple(masks / f"{frame:06d}.png" for frame in range(total)), size)
                sources.append(replace(source, masks=made, mask_mark=mask_mark(scene, k, scale)))
        finally:
            pool.shutdown(cancel_futures=True)
    return replace(scene, cameras=tuple(sources), foreground=replace(scene.foreground, source="masks"))


def with_people(scene: Scene, folder: Path, scale: float, note: Callable[[str], None]) -> Scene:
    """The scene of whom its label images show most, and of everybody else; as it is where no image has two labels.

    The folder is for images in which a person has the same label in all views and frames; ``note`` hears who was found.
    """
    given = [source.masks for source in scene.cameras if source.masks]
    if not any(isinstance(image, Labels) and len(image.identities) > 1 for masks in given for image in masks.read()):
        return scene
    people, folders = People(scene.rig(scale)), [folder / name for name in scene.calibrated.names]
    for each in folders:
        each.mkdir(parents=True, exist_ok=True)
    for f, images in enumerate(zip(*(masks.read() for masks in given), strict=True)):
        labels = [each.image if isinstance(each, Labels) else decode_mask(each).astype(np.uint8) for each in images]
        for each, made in zip(folders, people(labels), strict=True):
            write_png(each / f"{f:06d}.png", made)
    ranked = people.views.most_common()
    seen = [person for person, count in ranked if count > _MIN_SEEN * ranked[0][1]]
    who = ", ".join(f"person{n} in {people.views[person]}" for n, person in enumerate(seen, 1))
    all_masks = scene.frame_count * len(given)
    note(f"people: {who or 'nobody'} of {all_masks} masks; {people.swaps} swapped labels put right")
    if not seen:  # all labels are taken for the subject
        return scene
    known = [replace(each, label=seen[0], in_front=(UNDECIDED,)) for each in scene.cameras]
    cameras = (replace(each, masks=open_masks(of)) for each, of in zip(known, folders, strict=True))
    scene = replace(scene, cameras=tuple(cameras))
    if len(seen) == 1:
        return scene
    note("people: person1 is tracked; change [scene] person in the masks' scene.toml, or remove it for all")
    named = {f"person{n}": Person((person,) * len(given)) for n, person in enumerate(seen, 1)}
    named["person1"] = replace(named["person1"], subject=scene.subject, truth=scene.truth)
    return replace(scene, foreground=replace(scene.foreground, keep="all"), people=named).of_person("person1")


def images_for_program(scene: Scene, folder: Path) -> Iterator[list[np.ndarray | None]]:
    """The undistorted images that :func:`masks_by_program` has written, as :meth:`Scene.images` has them."""
    for frame in range(scene.frame_count):
        files = (folder / "frames" / name / f"{frame:06d}.jpg" for name in scene.calibrated.names)
        yield [read_image(file) if file.exists() else None for file in files]


def _write_frames(scene: Scene, k: int, scale: float, folder: Path) -> Path:
    """Write camera ``k``'s images, unless all are there: a folder that is not whole has another name."""
    if not folder.exists():
        unfinished = folder.parent.with_name("unfinished_frames") / folder.name
        unfinished.mkdir(parents=True, exist_ok=True)
        folder.parent.mkdir(exist_ok=True)
        for frame, image in enumerate(scene.camera_images(k, scale)):
            if image is not None:
                write_whole(unfinished / f"{frame:06d}.jpg", cv2.imencode(".jpg", image, _JPEG)[1].tobytes())
        os.replace(unfinished, folder)
    return folder


def _key(scene: Scene, program: MaskProgram, scale: float) -> str:
    """All that frames and masks are made from, as far as a look at the files tells."""
    files = [file for source in scene.cameras for files in source.files_for("recording") for file in files]
    about = [(str(file.resolve()), status.st_size, status.st_mtime_ns) for file in files if (status := file.stat())]
    timing = [(source.name, source.frame_offset, source.rate, source.fraction) for source in scene.cameras]
    lenses = [
        calibration_hash(scene.calibrated, k, source.recorded_scale, source.recorded_offset, whole_rig=False)
        for k, source in enumerate(scene.cameras)
    ]
    return json.dumps([__version__, program.name, scale, str(scene.frames), about, timing, lenses])


def _check_key(file: Path, key: str) -> None:
    if not file.parent.exists():
        file.parent.mkdir()
        write_whole(file, key.encode())
    elif not file.exists() or file.read_text(encoding="utf-8", errors="replace") != key:
        problem = "holds unfinished masks of other videos or settings, or of another program"
        raise InputError(file.parent, problem, "remove it to start anew, or write to another folder")
