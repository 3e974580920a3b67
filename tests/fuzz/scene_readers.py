"""Readers of scenes, studies, masks, images and videos."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import mutations
from reader import LINES, Reader


def _write_scene(folder: Path) -> None:
    import cv2
    import numpy as np
    from synthetic import ring_rig

    from mmocap_warp.formats.calibration.toml_rig import write_toml_rig

    write_toml_rig(folder / "calibration.toml", ring_rig(3, (32, 24)))
    mask = np.zeros((24, 32), np.uint8)
    mask[5:20, 12:20] = 255
    for camera in ("cam01", "cam02", "cam03"):
        (folder / camera).mkdir()
        for frame in range(2):
            cv2.imwrite(str(folder / camera / f"{frame}.png"), mask)
    cameras = "".join(f'[cameras.{name}]\nmasks = "{name}"\nframe_offset = 0\n' for name in ("cam01", "cam02", "cam03"))
    (folder / "scene.toml").write_text(
        '[scene]\nname = "a scene"\nfps = 60.0\nup = "+y"\nframes = 2\nbody = "adult_man"\n'
        '[foreground]\nsource = "masks"\nkeep = "largest"\nmedian = 3.0\nfill_holes = 60.0\nrepair = false\n'
        '[track]\nalgorithm = "h-cmaes"\nevaluations = 30\nsmooth = 10.8\n[fit]\nseed = 3\n'
        '[cameras]\ncalibration = "calibration.toml"\nunits = "m"\n'
        + cameras
        + "video_from_calibrated = { scale = 1.0, offset = [0.0, 0.0] }\ncentre_shift = [0.0, 0.0]\n"
    )


def _read_scene(folder: Path) -> None:
    from mmocap_warp.fitting.subject_fit import FitConfig
    from mmocap_warp.formats.toml_table import config_from_table
    from mmocap_warp.scene.scene_toml import load_scene
    from mmocap_warp.tracking.track_config import TrackConfig

    scene = load_scene(folder / "scene.toml")
    config = config_from_table(TrackConfig, scene.settings("track"))
    config_from_table(FitConfig, scene.settings("fit"))
    scene.rig(config.scale)


def _read_masks(folder: Path) -> None:
    from mmocap_warp.scene.scene_toml import load_scene

    for _ in load_scene(folder / "scene.toml").masks():
        pass


def _write_painted_mask(image: Callable) -> Callable[[Path], None]:
    def write(folder: Path) -> None:
        import cv2

        _write_scene(folder)
        mask = cv2.imread(str(folder / "cam01/1.png"), cv2.IMREAD_GRAYSCALE)
        cv2.imwrite(str(folder / "cam01/1.png"), image(mask))

    return write


def _with_alpha(mask):
    import numpy as np

    return np.dstack([mask, mask, mask, mask])


def _deep(mask):
    return mask.astype("uint16") * 257


def _write_image(folder: Path, name: str) -> None:
    import cv2
    import numpy as np

    cv2.imwrite(str(folder / name), np.random.default_rng(0).integers(0, 255, (24, 32, 3), np.uint8))


def _read_image(folder: Path, name: str) -> None:
    from mmocap_warp.masks.frames import as_colour, open_image
    from mmocap_warp.masks.mask_image import decode_mask

    for image in open_image(folder / name).read():
        as_colour(image)
        decode_mask(image)


def write_video(folder: Path, name: str, codec: str) -> None:
    import cv2
    import numpy as np

    video = cv2.VideoWriter(str(folder / name), cv2.VideoWriter_fourcc(*codec), 30, (32, 24))
    for frame in range(4):
        video.write(np.random.default_rng(frame).integers(0, 255, (24, 32, 3), np.uint8))
    video.release()


def _read_video(folder: Path, name: str) -> None:
    from mmocap_warp.masks.frames import open_frames

    for _ in open_frames(folder / name).read():
        pass


def _read_chosen_masks(folder: Path, masks: str) -> None:
    """As a scene reads them: opened, looked through for identities, and decoded for one of them and for all."""
    from mmocap_warp.masks.mask_files import open_masks
    from mmocap_warp.masks.mask_image import decode_mask, identities_of

    opened = open_masks(folder / masks)
    identities_of(opened.sample(2))
    for image in opened.read():
        decode_mask(image, 0, opened.soft)
        decode_mask(image, 1, opened.soft)


def _two_objects():
    """(height, width) uint8: the pixels of two identities, and background."""
    import numpy as np

    index = np.zeros((24, 32), np.uint8)
    index[5:20, 12:20], index[8:22, 2:9] = 1, 3
    return index


def _write_palette_masks(folder: Path, depth: int) -> None:
    import numpy as np
    from given_masks import palette_png

    palette = np.array([[0, 0, 0], [128, 0, 0], [0, 128, 0], [128, 128, 0]], np.uint8)
    (folder / "cam01").mkdir()
    for frame in range(2):
        (folder / f"cam01/{frame}.png").write_bytes(palette_png(_two_objects(), palette, depth))


def _write_run_lengths(folder: Path, form: str) -> None:
    import json

    from given_masks import rle

    index = _two_objects()
    one, three = rle(index == 1), rle(index == 3, pack=False)
    contents = {
        "coco": {
            "images": [{"id": 7, "file_name": "10.jpg"}, {"id": 9, "file_name": "9.jpg"}],
            "annotations": [
                {"id": 1, "image_id": 7, "category_id": 1, "segmentation": one},
                {"id": 2, "image_id": 9, "category_id": 1, "track_id": 3, "segmentation": three},
            ],
        },
        "video": {"annotations": [{"id": 1, "segmentations": [None, one]}, {"id": 3, "segmentations": [three, one]}]},
        "listed": [[one, None, three], one, None],
    }
    (folder / "x.json").write_text(json.dumps(contents[form]))


def _write_masks_tar(folder: Path) -> None:
    import cv2
    from given_masks import write_tar

    image = cv2.imencode(".png", _two_objects() * 80)[1].tobytes()
    long_name = f"cam01/{'x' * 120}_10.png"  # which has a header of its own
    write_tar(folder / "x.tar", ("cam01/frame_9.png", image), (long_name, image), ("cam01/notes.txt", b"none"))


def _write_made_masks(folder: Path) -> None:
    from synthetic import ring_rig

    from mmocap_warp.scene.kept_masks import MaskMark, calibration_hash

    _write_scene(folder)
    made_with = calibration_hash(ring_rig(3, (32, 24)), 0, 1.0, (0.0, 0.0), whole_rig=False)
    MaskMark("cam01", (32, 24), 1.0, (32, 24), 0, 0, 1, False, made_with).write(folder / "cam01")


def _write_study(folder: Path) -> None:
    (folder / "study.toml").write_text(
        '[study]\nname = "tiny"\nseeds = 2\nfirst_seed = 0\nframes = 9\nscale = 0.1\n'
        '[sequences]\nWalk = "walk/scene.toml"\n'
        '[[grid]]\nsequences = ["Walk", "S1/Walking"]\nalgorithms = ["h-cmaes", "de"]\ndof = [51, 39]\n'
        'evaluations = [12]\npresets = ["recording"]\n'
    )


def _read_study(folder: Path) -> None:
    from mmocap_warp.study.definition import load_study

    load_study(folder / "study.toml")


_MASK = Reader("mask.png", "cam01/1.png", _write_scene, _read_masks, mutations.png)

READERS: tuple[Reader, ...] = (
    Reader("scene.toml", "scene.toml", _write_scene, _read_scene, LINES),
    _MASK,
    replace(_MASK, name="mask-alpha.png", write=_write_painted_mask(_with_alpha)),
    replace(_MASK, name="mask-16-bit.png", write=_write_painted_mask(_deep)),
    *(
        Reader(
            f"mask-palette-{depth}.png",
            "cam01/1.png",
            partial(_write_palette_masks, depth=depth),
            partial(_read_chosen_masks, masks="cam01"),
            mutations.png,
        )
        for depth in (8, 2)
    ),
    *(
        Reader(
            f"masks-{form}.json",
            "x.json",
            partial(_write_run_lengths, form=form),
            partial(_read_chosen_masks, masks="x.json"),
            mutations.json_text,
        )
        for form in ("coco", "video", "listed")
    ),
    Reader("masks.tar", "x.tar", _write_masks_tar, partial(_read_chosen_masks, masks="x.tar"), mutations.tarred),
    Reader("masks.toml", "cam01/masks.toml", _write_made_masks, _read_masks, LINES),
    *(
        Reader(
            f"image.{end}",
            f"x.{end}",
            partial(_write_image, name=f"x.{end}"),
            partial(_read_image, name=f"x.{end}"),
            mutations.any_bytes,
        )
        for end in ("jpg", "bmp", "tif", "webp")
    ),
    *(
        Reader(
            f"video.{end}",
            f"x.{end}",
            partial(write_video, name=f"x.{end}", codec=codec),
            partial(_read_video, name=f"x.{end}"),
            mutations.any_bytes,
        )
        for end, codec in (("mkv", "FFV1"), ("avi", "MJPG"), ("mp4", "mp4v"))
    ),
    Reader("study.toml", "study.toml", _write_study, _read_study, LINES),
)
