"""The reader of MakeHuman's data and what is made of it, on made-up data.

Where MMOCAP_MAKEHUMAN names the real data's folder, the shipped bodies are made again too.
"""

from __future__ import annotations

import gzip
import json
import os
import re
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_up_makehuman import MACROS, local_stretch, write_makehuman, write_target
from make_body import main, make_body
from makehuman import MacroSliders, MakeHuman, age_slider, macro_weights
from person_skeleton import JOINTS
from synthetic import synthetic_body

from mmocap_warp.body.mesh_pieces import is_closed
from mmocap_warp.body.model import BodyModel, SkinMesh
from mmocap_warp.errors import InputError
from mmocap_warp.formats.usd.usd_body import read_body
from mmocap_warp.scenes import ROOT

BODIES = Path(ROOT) / "bodies"
HEIGHT_M = 2e-4  # a body's height is found to 1e-4
NEGLIGIBLE_M = 6e-5  # displacements below 5e-5 are dropped
SINGLE_PRECISION = 1e-6  # of weights


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A square of skin, one joint cube of four vertices, and the targets of an average young man."""
    (tmp_path / "3dobjs").mkdir()
    (tmp_path / "3dobjs" / "base.obj").write_text(
        "# made up\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 4 0 0\nv 6 0 0\nv 6 2 0\nv 4 2 0\n"
        "vt 0 0\ng body\nf 1/1 2/1 3/1 4/1\ng joint-pelvis\nf 5/1 6/1 7/1 8/1\n"
    )
    for ancestry in ("african", "asian", "caucasian"):
        write_target(tmp_path, f"macrodetails/{ancestry}-male-young", "# none\n")
    write_target(tmp_path, "macrodetails/universal-male-young-averagemuscle-averageweight", "# x\n3 0 2 0\n\n4 1 0 0\n")
    build = "male-young-averagemuscle-averageweight"
    write_target(tmp_path, f"macrodetails/height/{build}-maxheight", "3 0 8 0\n")
    rigs = tmp_path / "rigs" / "standard"
    rigs.mkdir(parents=True)
    bones = {
        "Hips": {"parent": "", "head": {"strategy": "CUBE", "cube_name": "joint-pelvis"}},
        "Neck": {"parent": "Hips", "head": {"strategy": "MEAN", "vertex_indices": [2, 3]}},
        "Tip": {"parent": "Neck", "head": {"strategy": "VERTEX", "vertex_index": 3}},
    }
    (rigs / "rig.cmu_mb.json").write_text(json.dumps(bones))
    (rigs / "weights.cmu_mb.json").write_text(json.dumps({"weights": {"Neck": [[2, 0.25], [3, 1.0]]}}))
    return tmp_path


def test_reads_in_metres(folder: Path) -> None:
    makehuman = MakeHuman(folder)
    np.testing.assert_allclose(makehuman.rest[2], [0.1, 0.1, 0.0])
    np.testing.assert_array_equal(makehuman.group_face["body"], [[0, 1, 2, 3]])
    np.testing.assert_array_equal(makehuman.bone_head("Hips"), [4, 5, 6, 7])
    np.testing.assert_array_equal(makehuman.bone_head("Neck"), [2, 3])
    np.testing.assert_array_equal(makehuman.bone_head("Tip"), [3])
    assert makehuman.parent_bone == {"Hips": "", "Neck": "Hips", "Tip": "Neck"}
    np.testing.assert_allclose(makehuman.bone_weight["Neck"], [0, 0, 0.25, 1, 0, 0, 0, 0])


def test_sliders_blend_targets(folder: Path) -> None:
    makehuman = MakeHuman(folder)
    average = makehuman.shaped(MacroSliders(gender=1.0))
    np.testing.assert_allclose(average[3] - makehuman.rest[3], [0, 0.2, 0])
    np.testing.assert_allclose(average[4] - makehuman.rest[4], [0.1, 0, 0])
    tall = makehuman.shaped(MacroSliders(gender=1.0, height=0.75))
    np.testing.assert_allclose(tall[3] - average[3], [0, 0.4, 0])


def test_macro_weights_interpolate_between_anchors() -> None:
    weights = macro_weights(MacroSliders(gender=0.25, age=0.75, weight=0.25, height=1.0))
    assert weights["caucasian-male-old"] == pytest.approx(0.25 * 0.5 / 3)
    assert weights["universal-female-young-averagemuscle-minweight"] == pytest.approx(0.75 * 0.5 * 0.5)
    tall = sum(weight for name, weight in weights.items() if name.startswith("height/"))
    assert tall == pytest.approx(1.0)
    assert all("maxheight" in name for name in weights if name.startswith("height/"))
    average = macro_weights(MacroSliders())
    assert not [name for name in average if name.startswith(("height/", "proportions/"))]


def test_ages() -> None:
    assert [age_slider(years) for years in (1, 10, 25, 90)] == [0.0, 0.1875, 0.5, 1.0]
    assert age_slider(57.5) == pytest.approx(0.75)
    with pytest.raises(ValueError, match=r"age must lie in 1..90 years, got 91"):
        age_slider(91)


def test_sliders_end_at_0_and_1() -> None:
    with pytest.raises(ValueError, match=r"muscle must lie in 0..1, got 1.5"):
        MacroSliders(muscle=1.5)


def test_missing_data(tmp_path: Path, folder: Path) -> None:
    with pytest.raises(InputError, match=r"3dobjs/base.obj is missing; .*--data"):
        MakeHuman(tmp_path / "nowhere")
    with pytest.raises(InputError, match=r"asian-female-young.*is missing|african-female-young.*is missing"):
        MakeHuman(folder).shaped(MacroSliders(gender=0.0))


@pytest.mark.parametrize(
    "content",
    [b"not gzip", gzip.compress(b"3 0 two 0\n"), gzip.compress(b"99 0 0 0\n")],
    ids=["plain", "word", "vertex 99"],
)
def test_broken_target(folder: Path, content: bytes) -> None:
    path = folder / "targets" / "macrodetails" / "caucasian-male-young.target.gz"
    path.write_bytes(content)
    with pytest.raises(InputError, match="not a MakeHuman target"):
        MakeHuman(folder).shaped(MacroSliders(gender=1.0))


def test_broken_mesh_and_rig(folder: Path) -> None:
    (folder / "rigs" / "standard" / "rig.cmu_mb.json").write_text("{")
    with pytest.raises(InputError, match=r"rig.cmu_mb.json: not JSON"):
        _ = MakeHuman(folder).parent_bone
    (folder / "3dobjs" / "base.obj").write_text("v 0 0 zero\n")
    with pytest.raises(InputError, match="not MakeHuman's base mesh"):
        MakeHuman(folder)
    (folder / "3dobjs" / "base.obj").write_text("v 0 0 0\n")
    with pytest.raises(InputError, match="no faces in a group called 'body'"):
        MakeHuman(folder)


def test_a_body_needs_a_usd_name(folder: Path) -> None:
    with pytest.raises(ValueError, match="name must be letters"):
        make_body(folder, "adult man", gender=1, age=30, height=1.8)


@pytest.fixture(scope="module")
def boxes() -> BodyModel:
    """The figure of boxes, its elbows bent: their hinge is found from the bend."""
    body = synthetic_body()
    joint_rest = body.joint_rest.copy()
    joint_rest[[JOINTS.index("LWrist"), JOINTS.index("RWrist")], 2] += 0.1
    return replace(body, joint_rest=joint_rest)


@pytest.fixture(scope="module")
def data(boxes: BodyModel, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The data folder of a whole made-up person."""
    folder = tmp_path_factory.mktemp("makehuman")
    write_makehuman(folder, boxes)
    return folder


def test_a_body_is_made_as_the_data_says(data: Path, boxes: BodyModel) -> None:
    """All lengths up and down are stretched to the height; joints, faces and weights are those of the data."""
    ground, tall = boxes.skin.rest[:, 1].min(), float(np.ptp(boxes.skin.rest[:, 1]))
    made = make_body(data, "Boxes", gender=1, age=25, height=1.05 * tall)

    def stretched(points: np.ndarray) -> np.ndarray:
        return (points - [0, ground, 0]) * [1, 1.05, 1]

    np.testing.assert_allclose(made.skin.rest, stretched(boxes.skin.rest), rtol=0, atol=HEIGHT_M)
    np.testing.assert_allclose(made.joint_rest, stretched(boxes.joint_rest), rtol=0, atol=HEIGHT_M)
    np.testing.assert_array_equal(made.skin.face, boxes.skin.face)
    np.testing.assert_allclose(dense(made.skin), dense(boxes.skin), rtol=0, atol=SINGLE_PRECISION)
    assert (np.diff(made.skin.weight, axis=1) <= 0).all()  # heaviest first
    assert is_closed(made.tracking_face)


def dense(skin: SkinMesh) -> np.ndarray:
    """(vertex, joint), every joint's weight."""
    weight = np.zeros((len(skin.rest), len(JOINTS)))
    np.add.at(weight, (np.arange(len(weight))[:, None], skin.joint), skin.weight)
    return weight


def test_shape_targets_are_differences_from_the_person(data: Path) -> None:
    made = make_body(data, "Boxes", gender=1, age=25, height=1.7)
    target = dict(zip(made.shape_names, zip(made.shape_vertex, made.shape_joint, strict=True), strict=True))
    assert "gender_male" not in target  # he is one already
    person = made.skin.rest / [1, np.ptp(made.skin.rest[:, 1]) / np.ptp(synthetic_body().skin.rest[:, 1]), 1]
    arm = local_stretch("arms/measure-upperarm-length-incr") + local_stretch("arms/measure-lowerarm-length-incr")
    for name, stretch in {
        "weight_incr": np.array(MACROS["maxweight"]),
        "muscle_decr": np.array(MACROS["minmuscle"]),
        "gender_female": np.array(MACROS["female"]),
        "arm_length_incr": arm,
        "arm_length_decr": -arm,
    }.items():
        vertex, joint = target[name]
        np.testing.assert_allclose(vertex[:, [0, 2]], (person * stretch)[:, [0, 2]], rtol=0, atol=NEGLIGIBLE_M)
        assert np.abs(joint).max() > NEGLIGIBLE_M
        assert vertex[made.skin.rest[:, 1].argmin(), 1] == 0  # the feet stay on the ground


def test_height_out_of_reach(data: Path) -> None:
    with pytest.raises(ValueError, match=r"height must lie in 1\.\d\d\.\.2\.\d\d m for this person, got 3"):
        make_body(data, "giant", gender=1, age=30, height=3.0)


def test_missing_data_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    build = ["--gender=1", "--age=30", "--height=1.8"]
    monkeypatch.setattr("sys.argv", ["make_body.py", "-o", str(tmp_path / "b.usdc"), f"--data={tmp_path}", *build])
    assert main() == 3
    (line,) = capsys.readouterr().err.splitlines()
    assert "3dobjs/base.obj is missing" in line


SHIPPED = ("adult_man", "adult_woman", "tall_slim_adult")


def documented_command(name: str) -> list[str]:
    """How LICENSE.md says that a shipped body was made, without the program's name."""
    text = (BODIES / "LICENSE.md").read_text()
    (command,) = re.findall(rf"^python (instruments/make_body.py .*/{name}\.usdc .*)$", text, re.MULTILINE)
    return shlex.split(command)


@pytest.mark.parametrize("name", SHIPPED)
def test_documented_commands_are_those_of_the_shipped_bodies(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """Given the made-up data they make another body of the same build: a body says of what build it is."""
    command = documented_command(name)
    command[command.index("-o") + 1] = str(tmp_path / f"{name}.usdc")
    command[command.index("--data") + 1] = str(data)
    monkeypatch.setattr("sys.argv", command)
    assert main() == 0
    made, shipped = read_body(tmp_path / f"{name}.usdc"), read_body(BODIES / f"{name}.usdc")
    assert made.attribution == shipped.attribution
    assert (made.name, made.marker_names) == (shipped.name, shipped.marker_names)
    assert set(made.shape_names) >= set(shipped.shape_names) - {"gender_female", "gender_male"}


if "MMOCAP_MAKEHUMAN" in os.environ:  # MakeHuman's data is no part of the project: see scenes/bodies/LICENSE.md

    @pytest.mark.parametrize("name", SHIPPED)
    def test_documented_commands_make_the_shipped_bodies(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
    ) -> None:
        command, path = documented_command(name), tmp_path / f"{name}.usdc"
        command[command.index("-o") + 1] = str(path)
        command[command.index("--data") + 1] = os.environ["MMOCAP_MAKEHUMAN"]
        monkeypatch.setattr("sys.argv", command)
        assert main() == 0
        assert path.read_bytes() == (BODIES / path.name).read_bytes()
