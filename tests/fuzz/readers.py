"""Everything that reads a file: how a small sound file comes to be, how it is damaged, and how it is read.

A new reader of files is a line in ``READERS``. What it needs is imported by its functions, so that a trial of one
reader does not wait for the others.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import mutations
from given_clips import BVH
from mutations import Mutation


@dataclass(frozen=True)
class Reader:
    """A reader.

    Attributes:
        name: of what it reads, without blanks.
        file: the file that is damaged, from a folder on.
        write: writes that file and all it needs into a folder.
        read: reads it, from the folder; all that can be wrong with the file is an ``InputError``.
        damage: what is done to the file.
    """

    name: str
    file: str
    write: Callable[[Path], object]
    read: Callable[[Path], object]
    damage: Mutation


# Scenes, studies and masks


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
    from mmocap_warp.formats.toml_table import config_from_table
    from mmocap_warp.scene.scene_toml import load_scene
    from mmocap_warp.tracking.config import TrackConfig
    from mmocap_warp.tracking.fit import FitConfig

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
    from mmocap_warp.foreground.frames import as_colour, open_image
    from mmocap_warp.foreground.mask_image import decode_mask

    for image in open_image(folder / name).read():
        as_colour(image)
        decode_mask(image)


def _write_video(folder: Path, name: str, codec: str) -> None:
    import cv2
    import numpy as np

    video = cv2.VideoWriter(str(folder / name), cv2.VideoWriter_fourcc(*codec), 30, (32, 24))
    for frame in range(4):
        video.write(np.random.default_rng(frame).integers(0, 255, (24, 32, 3), np.uint8))
    video.release()


def _read_video(folder: Path, name: str) -> None:
    from mmocap_warp.foreground.frames import open_frames

    for _ in open_frames(folder / name).read():
        pass


def _read_chosen_masks(folder: Path, masks: str) -> None:
    """As a scene reads them: opened, looked through for identities, and decoded for one of them and for all."""
    from mmocap_warp.foreground.labels import identities_of
    from mmocap_warp.foreground.mask_files import open_masks
    from mmocap_warp.foreground.mask_image import decode_mask

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

    from mmocap_warp.scene.mask_mark import MaskMark, calibration_hash

    _write_scene(folder)
    made_with = calibration_hash(ring_rig(3, (32, 24)), 0, 1.0, (0.0, 0.0), whole_rig=False)
    MaskMark("cam01", (32, 24), 1.0, (32, 24), 0, 0, 1, False, made_with).write(folder / "cam01")


def _write_project(folder: Path, calibration: Callable[[Path], object]) -> None:
    """Videos and their calibration, as they are before there is a scene file."""
    from mmocap_warp.formats.table import read_calibration

    calibration(folder)
    found = next(file for file in sorted(folder.iterdir()) if file.name != "extri.yml")
    for name in read_calibration(found, "m", "+y").names:
        _write_video(folder, f"{name}.avi", "MJPG")


def _draft(folder: Path) -> None:
    """As ``mmocap init`` does: draft a scene, write it, and load it where nothing is missing."""
    import tomllib

    from mmocap_warp.scene.drafting import draft_scene
    from mmocap_warp.scene.scene_toml import load_scene

    draft = draft_scene(folder)
    tomllib.loads(draft.text)
    if not draft.missing:
        (folder / "scene.toml").write_bytes(draft.text.encode())
        load_scene(folder / "scene.toml", masks=False)


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


# Calibrations


def _write_toml_rig(folder: Path) -> None:
    from synthetic import ring_rig

    from mmocap_warp.formats.calibration.toml_rig import write_toml_rig

    write_toml_rig(folder / "calibration.toml", ring_rig(2))


def _write_qualisys(folder: Path) -> None:
    turn = " ".join(f'r{i}{j}="{float(i == j)}"' for i in (1, 2, 3) for j in (1, 2, 3))
    lens = 'focalLengthU="64000" focalLengthV="64000" centerPointU="20480" centerPointV="15360" skew="0"'
    bent = 'radialDistortion1="0" radialDistortion2="0" radialDistortion3="0" tangentalDistortion1="0"'
    cameras = "".join(
        f'<camera serial="{name}"><fov_video left="0" top="0" right="639" bottom="479"/>\n'
        f'<transform x="{x}" y="0" z="1000" {turn}/>\n<intrinsic {lens} {bent} tangentalDistortion2="0"/></camera>\n'
        for name, x in (("a", 0), ("b", 2000))
    )
    (folder / "some.qca.txt").write_text(
        f'<?xml version="1.0"?>\n<calibration>\n<cameras>{cameras}</cameras></calibration>'
    )


def _write_opencv(folder: Path) -> None:
    import cv2
    from synthetic import ring_rig

    rig = ring_rig(2)
    names = "names:\n" + "".join(f'  - "{name}"\n' for name in rig.names)

    def matrix(key: str, values) -> str:
        rows, columns = values.shape
        data = ", ".join(map(str, values.ravel().tolist()))
        return f"{key}: !!opencv-matrix\n  rows: {rows}\n  cols: {columns}\n  dt: d\n  data: [ {data} ]\n"

    intrinsics, extrinsics = [names], [names]
    for k, name in enumerate(rig.names):
        intrinsics += [matrix(f"K_{name}", rig.K[k]), matrix(f"dist_{name}", rig.distortion[k : k + 1])]
        intrinsics += [f"H_{name}: {rig.size[k, 1]}\n", f"W_{name}: {rig.size[k, 0]}\n"]
        extrinsics += [matrix(f"R_{name}", cv2.Rodrigues(rig.R[k])[0]), matrix(f"Rot_{name}", rig.R[k])]
        extrinsics += [matrix(f"T_{name}", rig.t[k][:, None])]
    (folder / "intri.yml").write_text("%YAML:1.0\n---\n" + "".join(intrinsics))
    (folder / "extri.yml").write_text("%YAML:1.0\n---\n" + "".join(extrinsics))


def _read_rig(folder: Path, name: str) -> None:
    from mmocap_warp.formats.table import read_calibration

    read_calibration(folder / name, "m", "+y").undistorted()


# Motion, truth and HumanEva


def _write_text(folder: Path, **files: str) -> None:
    for name, content in files.items():
        (folder / name.replace("__", ".")).write_text(content)


_ASF = """\
:version 1.10
:root
   order TX TY TZ RX RY RZ
   axis XYZ
   position 0 0 0
:bonedata
  begin
    id 1
    name lfemur
    direction 0 -1 0
    length 4
    axis 0 0 90 XYZ
    dof rx ry rz
    limits (-160.0 20.0)
  end
  begin
    name ltibia
    direction 0 -2 0
    length 3
    axis 0 0 0 XYZ
  end
:hierarchy
  begin
    root lfemur
    lfemur ltibia
  end
"""
_AMC = ":FULLY-SPECIFIED\n:DEGREES\n1\nroot 0 7 0 0 0 0\nlfemur 0 0 0\n2\nroot 1 7 0 0 0 0\nlfemur 0 90 0\n"
_TRC = (
    "PathFileType\t4\t(X/Y/Z)\tsome.trc\n"
    "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames\n"
    "60\t60\t2\t2\tmm\t60\t0\t2\nFrame#\tTime\tRHip\t\t\tLHip\t\t\t\n\t\tX1\tY1\tZ1\tX2\tY2\tZ2\t\n"
    "1\t0.016\t1000\t2000\t3000\t4000\t5000\t6000\n2\t0.033\t10\t20\t30\t\t\t\n"
)
_CAL = "600\n600\n320\n240\n0\n0\n0\n0\n0\n0\n" + "1\n0\n0\n0\n1\n0\n0\n0\n1\n" + "0\n0\n4000\n"


def _read_clip(folder: Path, name: str) -> None:
    from mmocap_warp.synthesis.motion.retarget import read_clip

    read_clip(folder / name).at_rate(60.0)


def _write_c3d(folder: Path) -> None:
    import ezc3d
    import numpy as np

    file = ezc3d.c3d()
    about = file["parameters"]["POINT"]
    about["UNITS"]["value"], about["RATE"]["value"], about["LABELS"]["value"] = ["mm"], [100.0], ["Ann:AAA", "BBB"]
    file["data"]["points"] = np.random.default_rng(0).uniform(1, 2, (4, 2, 3))
    file.write(str(folder / "some.c3d"))


def _read_c3d(folder: Path) -> None:
    from mmocap_warp.formats.motion.c3d import read_c3d

    read_c3d(folder / "some.c3d")


def _read_truth(folder: Path, name: str) -> None:
    from mmocap_warp.formats.truth import load_truth

    load_truth(folder / name)


def _read_cal(folder: Path) -> None:
    from mmocap_warp.formats.humaneva.cal import read_cal
    from mmocap_warp.views.rig import rig_of

    rig_of([read_cal(folder / "C1.cal", "C1", (640, 480))], "+z", folder / "C1.cal")


def _read_ofs(folder: Path) -> None:
    from mmocap_warp.formats.humaneva.sync import read_ofs

    read_ofs(folder / "C1.ofs")


def _read_measures(folder: Path) -> None:
    from mmocap_warp.formats.humaneva.numbers import read_measures

    read_measures(folder / "S1.mp")


# USD


def _write_body(folder: Path, name: str) -> None:
    from mmocap_warp.formats.usd.body import write_body

    write_body(folder / name, _small_body())


def _small_body():
    """Six boxes with a shape target, so that a file is read quickly."""
    from dataclasses import replace

    import numpy as np
    from other_bodies import arm_robot

    body = arm_robot()
    shape, joints = np.zeros((1, len(body.skin.rest), 3)), np.zeros((1, len(body.joint_rest), 3))
    shape[0, 3:9, 1], joints[0, 1, 2] = 0.1, 0.2
    shapes = {"shape_vertex": shape.astype(np.float32), "shape_joint": joints.astype(np.float32)}
    return replace(body, shape_names=("height_incr",), **shapes)


def _small_subject():
    import numpy as np

    from mmocap_warp.body.model import Subject

    body = _small_body()
    return Subject(body, np.eye(3), np.zeros(body.skeleton.coordinates), {"source": "tests", "seed": 3})


def _write_packed_body(folder: Path) -> None:
    from pxr import UsdUtils

    _write_body(folder, "b.usdc")
    UsdUtils.CreateNewUsdzPackage(str(folder / "b.usdc"), str(folder / "b.usdz"))


def _read_body(folder: Path, name: str) -> None:
    from mmocap_warp.bodies.shipped import load_body

    load_body(folder / name)


def _write_subject(folder: Path, name: str) -> None:
    from mmocap_warp.formats.usd.body import write_subject

    write_subject(folder / name, _small_subject())


def _read_subject(folder: Path, name: str) -> None:
    from mmocap_warp.formats.usd.body import read_subject

    read_subject(folder / name)


def _write_result(folder: Path, name: str) -> None:
    import numpy as np
    from synthetic import ring_rig

    from mmocap_warp.formats.usd.result import write_result
    from mmocap_warp.result.result import Result

    random, subject = np.random.default_rng(0), _small_subject()
    runs = {"cost": random.random((2, 3)), "evaluations": np.full((2, 3), 9), "status": np.zeros((2, 3), np.int8)}
    pose, sigma = (random.random((2, 3, subject.body.skeleton.coordinates)) for _ in range(2))
    more = {"iou": random.random((2, 3, 2)), "seconds": 1.5, "config": {"seed": 7}, "versions": {"device": "cpu"}}
    result = Result(subject, ring_rig(2), 60.0, np.arange(3), pose, **runs, **more, angle_sigma=sigma)
    write_result(folder / name, result)


def _read_result(folder: Path, name: str) -> None:
    from mmocap_warp.formats.usd.result import holds_result, read_result

    if holds_result(folder / name):
        read_result(folder / name)


def _write_truth(folder: Path, name: str) -> None:
    import numpy as np

    from mmocap_warp.formats.usd.truth import write_truth
    from mmocap_warp.result.truth import Truth

    random = np.random.default_rng(0)
    markers, joints = random.random((3, 2, 3)), random.random((3, 4, 3))
    markers[1, 0] = np.nan
    truth = Truth(60.0, np.arange(3), ("A", "B"), markers, tuple("CDEF"), joints, random.random((3, 5)), np.eye(3))
    write_truth(folder / name, truth)


# What the program keeps


def _write_cell(folder: Path) -> None:
    from study_results import made_up_result

    from mmocap_warp.study.cell import Cell, write_cell

    write_cell(folder / "cell.npz", made_up_result(Cell("S1/Box", "h-cmaes", 39, 500), 2, 3))


def _read_cell(folder: Path) -> None:
    from mmocap_warp.study.cell import read_cell

    read_cell(folder / "cell.npz")


def _checkpoint(folder: Path):
    import numpy as np

    from mmocap_warp.tracking.checkpoint import Checkpoint

    return Checkpoint(folder / "r.checkpoint", {"seed": 1, "frames": 3}, 2, 6, 3, [np.zeros((2, 4), np.float32)])


def _write_checkpoint(folder: Path) -> None:
    import numpy as np

    from mmocap_warp.result.result import FrameAnswer

    answer = FrameAnswer(np.ones((2, 6)), np.ones(2), np.ones((2, 3)), 9, np.array([0, 1]), 0.5)
    _checkpoint(folder).save([(answer, np.zeros(2, np.int32))] * 3, [np.ones((2, 4), np.float32)])


def _read_checkpoint(folder: Path) -> None:
    _checkpoint(folder).load()


def _write_report(folder: Path) -> None:
    import json

    from mmocap_warp.bench.suite import FORMAT

    lines = [{"name": "pose", "ms": 1.5, "ok": True, "sizes": [1, 2]}]
    (folder / "bench.json").write_text(json.dumps({"format": FORMAT, "ok": True, "device": "cpu", "stages": lines}))


def _read_report(folder: Path) -> None:
    from mmocap_warp.bench.report_file import read_report

    read_report(folder / "bench.json")


# MakeHuman


def _write_makehuman(folder: Path) -> None:
    from made_up_makehuman import write_target

    (folder / "3dobjs").mkdir()
    corners = ["v 0 0 0", "v 1 0 0", "v 1 1 0", "v 0 1 0", "v 0 0 1"]
    (folder / "3dobjs/base.obj").write_text(
        "\n".join([*corners, "g body", "f 1/1 2/1 3/1 4/1", "g joint-a", "f 1 2 3 5"])
    )
    write_target(folder, "some", "# made up\n0 0.1 0.2 0.3\n3 -1 0 0\n")
    rigs = folder / "rigs/standard"
    rigs.mkdir(parents=True)
    (rigs / "rig.cmu_mb.json").write_text(
        '{"a": {"parent": "", "head": {"strategy": "CUBE", "cube_name": "joint-a"}},'
        ' "b": {"parent": "a", "head": {"strategy": "MEAN", "vertex_indices": [0, 1]}},'
        ' "c": {"parent": "a", "head": {"strategy": "VERTEX", "vertex_index": 2}}}'
    )
    (rigs / "weights.cmu_mb.json").write_text('{"weights": {"a": [[0, 1.0], [1, 0.5]], "b": [[1, 0.5], [2, 1.0]]}}')


def _read_makehuman(folder: Path) -> None:
    from mmocap_warp.bodies.makehuman import MakeHuman

    data = MakeHuman(folder)
    data.target("some")
    for bone in data.parent_bone:
        data.rest[data.bone_head(bone)].mean(axis=0)
    _ = data.bone_weight


def _usd(kind: str, write: Callable, read: Callable) -> tuple[Reader, ...]:
    """As text and as binary."""
    return tuple(
        Reader(
            f"{kind}.{ending}",
            f"x.{ending}",
            partial(write, name=f"x.{ending}"),
            partial(read, name=f"x.{ending}"),
            damage,
        )
        for ending, damage in (("usda", mutations.text_or_bytes), ("usdc", mutations.any_bytes))
    )


_LINES = mutations.text_or_bytes
_MASK = Reader("mask.png", "cam01/1.png", _write_scene, _read_masks, mutations.png)
_HUMAN = Reader("makehuman.obj", "3dobjs/base.obj", _write_makehuman, _read_makehuman, _LINES)
_JPEG, _MKV = ("x.jpg",), ("x.mkv",)

READERS: dict[str, Reader] = {
    reader.name: reader
    for reader in (
        Reader("scene.toml", "scene.toml", _write_scene, _read_scene, _LINES),
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
        Reader("masks.toml", "cam01/masks.toml", _write_made_masks, _read_masks, _LINES),
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
                partial(_write_video, name=f"x.{end}", codec=codec),
                partial(_read_video, name=f"x.{end}"),
                mutations.any_bytes,
            )
            for end, codec in (("mkv", "FFV1"), ("avi", "MJPG"), ("mp4", "mp4v"))
        ),
        Reader(
            "calibration.toml", "calibration.toml", _write_toml_rig, partial(_read_rig, name="calibration.toml"), _LINES
        ),
        Reader("qualisys.qca.txt", "some.qca.txt", _write_qualisys, partial(_read_rig, name="some.qca.txt"), _LINES),
        Reader("opencv-intri.yml", "intri.yml", _write_opencv, partial(_read_rig, name="intri.yml"), _LINES),
        Reader("opencv-extri.yml", "extri.yml", _write_opencv, partial(_read_rig, name="extri.yml"), _LINES),
        *(
            Reader(f"draft-{file}", file, partial(_write_project, calibration=write), _draft, _LINES)
            for file, write in (
                ("calibration.toml", _write_toml_rig),
                ("some.qca.txt", _write_qualisys),
                ("intri.yml", _write_opencv),
            )
        ),
        Reader(
            "draft-cam01.avi",
            "cam01.avi",
            partial(_write_project, calibration=_write_toml_rig),
            _draft,
            mutations.any_bytes,
        ),
        *_usd("body", _write_body, _read_body),
        Reader("body.usdz", "b.usdz", _write_packed_body, partial(_read_body, name="b.usdz"), mutations.any_bytes),
        *_usd("subject", _write_subject, _read_subject),
        *_usd("result", _write_result, _read_result),
        *_usd("truth", _write_truth, _read_truth),
        Reader("truth.trc", "x.trc", partial(_write_text, x__trc=_TRC), partial(_read_truth, name="x.trc"), _LINES),
        Reader("clip.bvh", "x.bvh", partial(_write_text, x__bvh=BVH), partial(_read_clip, name="x.bvh"), _LINES),
        *(
            Reader(
                f"clip.{end}",
                f"x.{end}",
                partial(_write_text, x__asf=_ASF, x__amc=_AMC),
                partial(_read_clip, name="x.amc"),
                _LINES,
            )
            for end in ("asf", "amc")
        ),
        Reader("clip.c3d", "some.c3d", _write_c3d, _read_c3d, mutations.any_bytes),
        Reader("humaneva.cal", "C1.cal", partial(_write_text, C1__cal=_CAL), _read_cal, _LINES),
        Reader("humaneva.ofs", "C1.ofs", partial(_write_text, C1__ofs="12.0\n32.4\n2.001\n"), _read_ofs, _LINES),
        Reader(
            "humaneva.mp",
            "S1.mp",
            partial(_write_text, S1__mp="$LKneeWidth = 105.0\n$A = -1e2\n"),
            _read_measures,
            _LINES,
        ),
        Reader("study.toml", "study.toml", _write_study, _read_study, _LINES),
        Reader("study-cell.npz", "cell.npz", _write_cell, _read_cell, mutations.zipped),
        Reader(
            "checkpoint",
            "r.checkpoint",
            _write_checkpoint,
            _read_checkpoint,
            mutations.headed(b"mmocap checkpoint 4\n"),
        ),
        Reader("bench.json", "bench.json", _write_report, _read_report, mutations.json_text),
        _HUMAN,
        replace(
            _HUMAN, name="makehuman.target", file="targets/some.target.gz", damage=mutations.gzipped(mutations.text)
        ),
        replace(_HUMAN, name="makehuman-rig.json", file="rigs/standard/rig.cmu_mb.json", damage=mutations.json_text),
        replace(
            _HUMAN, name="makehuman-weights.json", file="rigs/standard/weights.cmu_mb.json", damage=mutations.json_text
        ),
    )
}
