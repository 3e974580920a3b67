"""The reader of MakeHuman's data, on a made-up data folder and, where MMOCAP_MAKEHUMAN names it, on the real one."""

from __future__ import annotations

import gzip
import json
import os
import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from mmocap_warp.bodymaking import make_body
from mmocap_warp.errors import InputError
from mmocap_warp.formats.makehuman import MacroSliders, MakeHuman, age_slider, macro_weights
from mmocap_warp.formats.usd_body import read_body, write_body
from mmocap_warp.scenes import ROOT

BODIES = Path(ROOT) / "bodies"


def write_target(folder: Path, name: str, lines: str) -> None:
    path = folder / "targets" / f"{name}.target.gz"
    path.parent.mkdir(parents=True, exist_ok=True)
    with gzip.open(path, "wt") as file:
        file.write(lines)


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


@pytest.mark.parametrize("content", [b"not gzip", gzip.compress(b"3 0 two 0\n"), gzip.compress(b"99 0 0 0\n")])
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
def real_data() -> Path:
    if "MMOCAP_MAKEHUMAN" not in os.environ:
        pytest.skip("set MMOCAP_MAKEHUMAN to MPFB2's data folder (see scenes/bodies/LICENSE.md)")
    return Path(os.environ["MMOCAP_MAKEHUMAN"])


@pytest.mark.parametrize("name", ["adult_man", "adult_woman", "tall_slim_adult"])
def test_documented_commands_make_the_shipped_bodies(real_data: Path, tmp_path: Path, name: str) -> None:
    (command,) = re.findall(
        rf"^mmocap body make .*/{name}\.usdc .*$", (BODIES / "LICENSE.md").read_text(), re.MULTILINE
    )
    words = shlex.split(command)
    options = {word[2:]: words[i + 1] for i, word in enumerate(words[:-1]) if word.startswith("--")}
    build = {key: float(options[key]) for key in ("gender", "age", "height", "weight", "muscle") if key in options}
    made, shipped = make_body(real_data, name, **build), read_body(BODIES / f"{name}.usdc")
    write_body(tmp_path / "made.usdc", made)
    assert (tmp_path / "made.usdc").read_bytes() == (BODIES / f"{name}.usdc").read_bytes()
    np.testing.assert_array_equal(made.skin.rest, shipped.skin.rest)


def test_height_out_of_reach(real_data: Path) -> None:
    with pytest.raises(ValueError, match=r"height must lie in 1\.\d\d\.\.2\.\d\d m for this person, got 3"):
        make_body(real_data, "giant", gender=1, age=30, height=3.0)
