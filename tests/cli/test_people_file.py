"""One file of several people: it refers to each person's own, and every command takes it."""

import json
import struct
from dataclasses import replace

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdSkel
from synthetic import synthetic_result

from mmocap_warp.cli import console, main
from mmocap_warp.cli.command import Answer, answer_of_each
from mmocap_warp.errors import InputError
from mmocap_warp.formats.usd.usd_check import faults
from mmocap_warp.formats.usd.usd_people import results_in, write_people
from mmocap_warp.formats.usd.usd_result import read_result, write_result

NAMES = ("anna", "Åse B.", "Cameras")
PRIMS = ("anna", "Åse_B_", "Cameras_")


@pytest.fixture(scope="module")
def people(tmp_path_factory):
    """A file of three people, one metre from each other."""
    folder, made = tmp_path_factory.mktemp("people"), {}
    for place, name in enumerate(NAMES):
        result = synthetic_result(3, up="+z")
        aside = np.r_[place, np.zeros(result.pose.shape[-1] - 1)]
        result = replace(result, pose=result.pose + aside, raw_pose=None, config=result.config | {"person": name})
        made[name] = folder / f"both.{name}.usdc", result
        write_result(*made[name])
    write_people(folder / "both.usdc", made)
    return folder / "both.usdc"


def test_each_body_is_a_prim_that_moves(people):
    assert results_in(people) == {name: people.with_name(f"both.{name}.usdc") for name in NAMES}
    assert faults(people) == []
    stage = Usd.Stage.Open(str(people))
    assert [prim.GetName() for prim in stage.GetPrimAtPath("/World").GetChildren()] == [*PRIMS, "Cameras"]
    for prim in PRIMS:
        skeleton = stage.GetPrimAtPath(f"/World/{prim}/Skeleton")
        (source,) = UsdSkel.BindingAPI(skeleton).GetAnimationSourceRel().GetTargets()
        assert source == f"/World/{prim}/Animation"
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (10, 12)
    assert results_in(people.with_name("both.anna.usdc")) == {}


def test_what_takes_one_person_says_so(people):
    with pytest.raises(InputError, match="holds several people"):
        read_result(people)


def test_a_file_that_is_away_is_named(people, tmp_path):
    alone = tmp_path / people.name
    alone.write_bytes(people.read_bytes())
    assert any("both.anna.usdc" in line for line in faults(alone))
    assert main(["eval", str(alone)]) == console.BAD_INPUT


@pytest.mark.parametrize("elsewhere", ["../other.usdc", "/elsewhere/other.usdc", "./..", "both.anna.usdc"])
def test_files_that_do_not_lie_beside_it_are_refused(people, tmp_path, elsewhere, capsys):
    stage = Usd.Stage.CreateNew(str(tmp_path / "bad.usda"))
    world = stage.DefinePrim("/World", "Xform")
    world.CreateAttribute("mmocap:people", Sdf.ValueTypeNames.StringArray).Set(["anna"])
    world.CreateAttribute("mmocap:results", Sdf.ValueTypeNames.StringArray).Set([elsewhere])
    stage.Save()
    assert main(["eval", str(tmp_path / "bad.usda")]) == console.BAD_INPUT
    assert "do not lie beside it" in capsys.readouterr().err


def test_eval_judges_each(people, capsys):
    code = main(["eval", str(people), "--json"])
    report = json.loads(capsys.readouterr().out)["people"]
    assert [*report] == [*NAMES]
    assert all(each["frames"] == 3 for each in report.values())
    held = all(each["verdict"]["holds"] for each in report.values())
    assert code == (console.OK if held else console.CHECK_FAILED)


def test_a_truth_is_of_one_person(people, capsys):
    assert main(["eval", str(people), "--truth", "truth.usdc"]) == console.USAGE
    assert "give it with that person's result, of anna, Åse B., Cameras" in capsys.readouterr().err


def test_one_glb_and_one_stage_hold_everybody(people, tmp_path):
    for name in ("all.glb", "all.usda"):
        assert main(["export", str(people), "-o", str(tmp_path / name)]) == 0
    data = (tmp_path / "all.glb").read_bytes()
    content = json.loads(data[20 : 20 + struct.unpack("<I", data[12:16])[0]])
    roots = [content["nodes"][node] for node in content["scenes"][0]["nodes"]]
    assert [node["name"] for node in roots] == [each for name in NAMES for each in (name, f"{name} skin")]
    assert [skin["skeleton"] for skin in content["skins"]] == [node["children"][0] for node in roots[::2]]
    (motion,) = content["animations"]
    moved = {channel["target"]["node"] for channel in motion["channels"]}
    assert all(set(skin["joints"]) <= moved for skin in content["skins"])
    assert [channel["sampler"] for channel in motion["channels"]] == list(range(len(motion["samplers"])))
    stage = Usd.Stage.Open(str(tmp_path / "all.usda"))
    bodies = [prim.GetName() for prim in stage.Traverse() if prim.IsA(UsdSkel.Root)]
    assert bodies == [*PRIMS]
    assert faults(tmp_path / "all.usda") == []


def test_nobodys_result_is_replaced(people, tmp_path, capsys):
    before = {file: file.read_bytes() for file in people.parent.iterdir()}
    for output, flags in ((people, ()), (people, ("--run", "0")), (people.with_name("both.anna.usdc"), ())):
        assert main(["export", str(people), "-o", str(output), *flags, "--force"]) == console.BAD_INPUT
        assert "is the result, of which an animation keeps less" in capsys.readouterr().err
    assert {file: file.read_bytes() for file in before} == before


def test_a_result_of_other_cameras_is_not_shown_beside(people, tmp_path, capsys):
    result = read_result(people.with_name("both.anna.usdc"))
    fewer = result.cameras.select(result.cameras.names[:-1])
    write_result(tmp_path / "few.usdc", replace(result, cameras=fewer, iou=result.iou[..., :-1], view_shift=None))
    for command, output in (("show", "a.webm"), ("view", "a.html")):
        given = [command, str(people), "--beside", str(tmp_path / "few.usdc"), "-o", str(tmp_path / output)]
        assert main(given) == console.USAGE
        assert "--beside needs results of the same frames and cameras" in capsys.readouterr().err


def test_other_formats_have_a_file_each(people, tmp_path, capsys):
    assert main(["export", str(people), "-o", str(tmp_path / "all.bvh"), "--json"]) == 0
    files = json.loads(capsys.readouterr().out)["files"]
    assert files == [str(tmp_path / f"all.{name}.bvh") for name in NAMES]
    assert len({(tmp_path / f"all.{name}.bvh").read_text() for name in NAMES}) == len(NAMES)


def test_what_fails_for_one_is_done_for_the_others(capsys):
    def fails():
        raise InputError("masks", "are empty", "make them anew")

    done = {"anna": fails, "ben": lambda: Answer({"frames": 3}, ["3 frames"], console.CHECK_FAILED)}
    answer = answer_of_each(console.Console(), done)
    assert answer.code == console.BAD_INPUT
    assert answer.values["people"]["ben"] == {"frames": 3}
    assert "are empty" in answer.values["people"]["anna"]["problem"]
    assert "anna: masks: are empty" in capsys.readouterr().err
