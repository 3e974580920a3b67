"""STUDY.toml: what it says, and one clear line for what is wrong with it; keys of what it says."""

from __future__ import annotations

import re
import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from synthetic import synthetic_result
from tiny_study import write_scene, write_study

from mmocap_warp.commands.inputs import truth_of
from mmocap_warp.errors import InputError
from mmocap_warp.formats.table import export
from mmocap_warp.optimizers.pso import Pso, PsoConfig
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.scenes import ROOT
from mmocap_warp.study.cell import Cell
from mmocap_warp.study.definition import load_study
from mmocap_warp.study.source import Clip, clip_facts, open_clip
from mmocap_warp.study.store import content_key, plan_tasks
from mmocap_warp.tracking.algorithms import ALGORITHMS

GRID = """
[[grid]]
sequences = ["S1/Walking"]
algorithms = ["pso"]
dof = [39]
evaluations = [500]
"""


def study_of(folder: Path, text: str):
    path = folder / "study.toml"
    path.write_text(text)
    return load_study(path)


def test_a_grid_is_every_combination_with_what_it_inherits(tmp_path):
    study = study_of(
        tmp_path,
        """
        [study]
        name = "n"
        seeds = 4
        first_seed = 7
        frames = 9

        [sequences]
        Own = "elsewhere/scene.toml"

        [[grid]]
        sequences = ["Own", "S1/Box"]
        algorithms = ["pso", "de"]
        dof = [39, 28]
        evaluations = [500, 1500]

        [[grid]]
        sequences = ["Own"]
        algorithms = ["pso"]
        dof = [39]
        evaluations = [500]
        presets = ["paper"]
        seeds = 2
        frames = 3
        """,
    )
    assert (study.name, len(study.plans)) == ("n", 17)
    first, last = study.plans[0], study.plans[-1]
    assert first.cell == Cell("Own", "pso", 39, 500)
    assert first.clip == Clip("Own", tmp_path / "elsewhere/scene.toml", 9)
    assert (first.config.runs, first.config.seed, first.config.algorithm) == (4, 7, "pso")
    assert last.cell == Cell("Own", "pso", 39, 500, "paper")
    assert (last.clip.frames, last.config.runs, last.config.preset) == (3, 2, "paper")
    assert {plan.clip.scene for plan in study.plans if plan.cell.sequence == "S1/Box"} == {None}


def test_what_searches_nothing_is_tracked_once_for_all_budgets(tmp_path):
    text = GRID.replace('["pso"]', '["pso", "contour"]').replace("[500]", "[20, 40]")
    assert [str(plan.cell) for plan in study_of(tmp_path, text).plans] == [
        "S1/Walking pso 39 DOF 20 evaluations recording",
        "S1/Walking contour 39 DOF 0 evaluations recording",
        "S1/Walking pso 39 DOF 40 evaluations recording",
    ]


def test_settings_of_an_optimizer_of_ones_own_are_in_the_key(tmp_path, monkeypatch):
    (plan,) = study_of(tmp_path, GRID).plans

    def key(source):
        monkeypatch.setitem(ALGORITHMS, "pso", replace(ALGORITHMS["pso"], source=source))
        return content_key(plan, "clip", "cpu", "code")

    assert key(partial(Pso, config=PsoConfig())) == key(partial(Pso, config=PsoConfig()))
    assert key(partial(Pso, config=PsoConfig())) != key(partial(Pso, config=PsoConfig(population=7)))
    assert key(partial(Pso, config=PsoConfig())) != key(Pso)


def test_the_same_cell_twice_is_one(tmp_path):
    assert len(study_of(tmp_path, GRID + GRID).plans) == 1


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", r"there is no grid; add a table \[\[grid\]\]"),
        ("grid = [1]", "grid is not a list of tables"),
        ("[study\n", "is not valid TOML"),
        ("[study]\nseed = 3" + GRID, r"\[study\]: unknown key 'seed'; did you mean 'seeds'"),
        ("[study]\nseeds = 0" + GRID, r"seeds = 0 is below 1"),
        ("[study]\nfirst_seed = -1" + GRID, "first_seed = -1 is below 0"),
        ("[study]\nscale = 2.0" + GRID, "scale must be in"),
        ("[other]" + GRID, "unknown key 'other'"),
        ("[sequences]\nA = 3" + GRID, "A = 3 is not a string; name a scene.toml"),
        (GRID.replace('["pso"]', '["psoo"]'), r"\[grid 1\]: algorithm must be one of"),
        (GRID.replace('["pso"]', '["pso+solve"]'), r"'pso\+solve' has another \+ than \['polish', 'solved'\]"),
        (GRID.replace('["pso"]', '["pso+solved+polish"]'), "in this order"),
        (GRID.replace('["pso"]', '["pso+polish+polish"]'), "in this order"),
        (GRID.replace('["pso"]', '["contour+polish"]'), "polish is for"),
        (GRID.replace("[39]", "[40]"), r"\[grid 1\]: dof must be one of"),
        (GRID.replace("[500]", "[0]"), "evaluations must be at least 1"),
        (GRID.replace("[500]", "500"), "evaluations = 500 is not a list"),
        (GRID.replace("[500]", '["500"]'), "is not a list of whole numbers"),
        (GRID.replace("[39]", "[]"), "dof = [] is not a list".replace("[", r"\[")),
        (GRID.replace("dof = [39]\n", ""), "'dof' is missing"),
        (GRID + 'presets = ["mine"]', "preset must be one of"),
        (GRID + GRID + "seeds = 5", r"\[grid 2\]: S1/Walking pso 39 DOF .* is in an earlier grid with other seeds"),
    ],
)
def test_what_is_wrong_is_one_clear_line(text, problem, tmp_path):
    with pytest.raises(InputError, match=problem) as caught:
        study_of(tmp_path, text)
    assert caught.value.source.startswith(str(tmp_path / "study.toml"))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("path", sorted((ROOT / "studies").glob("*.toml")), ids=lambda path: path.stem)
def test_shipped_studies_are_right(path, tmp_path):
    study = load_study(path)
    assert study.name == path.stem
    assert len(plan_tasks(study, tmp_path, "cpu")) == len(study.plans)


def test_the_papers_grid_is_whole():
    study = load_study(ROOT / "studies" / "paper.toml")
    assert len(study.plans) == 8 * 2 * 3 * 9
    assert {plan.config.runs for plan in study.plans} == {30}


def test_a_sequence_that_is_not_shipped_is_named(tmp_path):
    study = study_of(tmp_path, GRID.replace("S1/Walking", "S9/Flying"))
    with pytest.raises(InputError, match="there is no sequence 'S9/Flying'; use one of S1/Walking"):
        plan_tasks(study, tmp_path, "cpu")


def test_shipped_sequences_have_one_scale(tmp_path):
    study = study_of(tmp_path, "[study]\nscale = 0.5" + GRID)
    with pytest.raises(InputError, match=r"scale = 0.5, but S1/Walking is a shipped sequence; use scale = 1"):
        plan_tasks(study, tmp_path, "cpu")


def test_a_scene_needs_a_subject_that_every_cell_starts_from(tmp_path):
    scene = write_scene(tmp_path / "walk")
    scene.write_text(scene.read_text().replace('subject = "subject.usdc"\n', ""))
    with pytest.raises(InputError, match="names no subject; fit one with 'mmocap fit'"):
        clip_facts(Clip("Walk", scene))


def test_a_model_that_a_scenes_body_lacks_is_refused_before_it_is_tracked(tmp_path, scene):
    grid = f"[sequences]\nwalk = {str(scene)!r}\n" + GRID.replace("S1/Walking", "walk")
    assert clip_facts(Clip("walk", scene)).models == [39, 28, 51]
    study = study_of(tmp_path, grid)
    assert plan_tasks(study, tmp_path, "cpu")
    study = study_of(tmp_path, grid.replace("dof = [39]", "dof = [40]"))
    with pytest.raises(InputError, match=r"dof = 40 is no model of walk's body, which has 39, 28, 51; give that"):
        plan_tasks(study, tmp_path, "cpu")


@pytest.fixture(scope="module")
def scene(tmp_path_factory) -> Path:
    return write_scene(tmp_path_factory.mktemp("scene") / "walk", frames=5)


def test_a_scene_is_cut_and_its_truth_with_it(scene):
    clip = open_clip(Clip("Walk", scene, frames=3, scale=0.25))
    assert clip.frames == clip_facts(Clip("Walk", scene, frames=3)).frames == len(list(clip.observations)) == 3
    assert clip.truth.frame_numbers.tolist() == [0, 1, 2]
    assert clip.rig.size.tolist()[0] == [40, 30]


def test_a_trc_counts_from_the_frame_that_the_scene_says(scene, tmp_path):
    """For the commands, and for a clip of a study."""
    late = write_scene(tmp_path / "late", frames=5)
    export(synthetic_result(frames=4), late.with_name("reference.trc"))
    late.write_text(late.read_text().replace('"truth.usdc"', '"reference.trc"\nfirst_frame = 1'))
    assert truth_of(load_scene(late)).frame_numbers.tolist() == [1, 2, 3, 4]
    clip = Clip("Walk", late, frames=3)
    assert open_clip(clip).truth.frame_numbers.tolist() == [1, 2]
    identity = clip_facts(clip).identity
    late.write_text(late.read_text().replace("first_frame = 1", "first_frame = 2"))
    assert clip_facts(clip).identity != identity


def test_a_scenes_own_frames_are_a_clip_with_its_truth(scene, tmp_path):
    own = write_scene(tmp_path / "own", frames=5)
    whole = clip_facts(Clip("Walk", own))
    own.write_text(own.read_text().replace("fps = 60", 'fps = 60\nframes = "1:5:2"'))
    clip, all_frames = open_clip(Clip("Walk", own)), open_clip(Clip("Walk", scene))
    assert (clip.fps, clip.frames, clip.truth.frame_numbers.tolist()) == (30, 2, [0, 1])
    np.testing.assert_array_equal(clip.truth.joints, all_frames.truth.joints[[1, 3]])
    masks = [observation.words for observation in all_frames.observations]
    for mine, number in zip(clip.observations, (1, 3), strict=True):
        np.testing.assert_array_equal(mine.words, masks[number])
    assert clip_facts(Clip("Walk", own)).identity != whole.identity


def test_a_shipped_sequence_is_cut():
    clip = open_clip(Clip("S1/Walking", frames=2))
    assert (clip.frames, len(clip.truth.frame_numbers)) == (2, 2)
    assert next(clip.observations).words.shape[0] == len(clip.rig) == 7


def test_an_identity_follows_what_a_result_depends_on_and_nothing_else(scene, tmp_path):
    one = clip_facts(Clip("Walk", scene)).identity
    moved = write_scene(tmp_path / "elsewhere", frames=5)
    assert clip_facts(Clip("Other", moved)).identity == one
    assert clip_facts(Clip("Walk", scene, frames=4)).identity != one
    assert clip_facts(Clip("Walk", scene, scale=0.5)).identity != one
    text = moved.read_text()
    for old, new in (("fps = 60", "fps = 50"), ("median = 3.0", "median = 2.0"), ("join = 6.0", "join = 7.0")):
        moved.write_text(text.replace(old, new))
        assert clip_facts(Clip("Walk", moved)).identity != one
    moved.write_text(text)
    for name in ("masks/cam03/000001.png", "subject.usdc", "truth.usdc"):
        with (moved.parent / name).open("ab") as file:
            file.write(b"x")
        changed = clip_facts(Clip("Walk", moved)).identity
        assert changed != one
        one = changed


def test_files_may_lie_in_the_folder_that_the_program_was_started_in(tmp_path, monkeypatch):
    scene = write_scene(tmp_path / "here", frames=2)
    text = scene.read_text().replace('masks = "masks/cam03"', 'masks = "masks/cam03"\nclean_plate = "plate.png"')
    scene.write_text(text)
    shutil.copy(scene.parent / "masks" / "cam03" / "000000.png", scene.with_name("plate.png"))
    whole = clip_facts(Clip("Walk", scene))
    monkeypatch.chdir(scene.parent)
    assert clip_facts(Clip("Walk", Path("scene.toml"))) == whole


def test_a_key_follows_what_a_result_depends_on(tmp_path, monkeypatch):
    plan = load_study(write_study(tmp_path)).plans[0]
    key = content_key(plan, "clip", "cpu")
    assert content_key(plan, "clip", "cpu") == key
    same = replace(plan, config=replace(plan.config, threads=7, device="cuda:3"), clip=Clip("x", Path("elsewhere")))
    assert content_key(same, "clip", "cpu") == key
    others = {
        content_key(plan, "clip", "cuda"),
        content_key(plan, "other clip", "cpu"),
        content_key(replace(plan, cell=replace(plan.cell, sequence="x")), "clip", "cpu"),
        *(
            content_key(replace(plan, config=replace(plan.config, **{name: value})), "clip", "cpu")
            for name, value in (("runs", 9), ("seed", 1), ("evaluations", 13), ("limits", False), ("cost", "iou"))
        ),
    }
    others.add(content_key(replace(plan, solved=True), "clip", "cpu"))
    monkeypatch.setattr("mmocap_warp.study.store.code_of", lambda *_: "other code")
    others.add(content_key(plan, "clip", "cpu"))
    assert key not in others
    assert len(others) == 10


def test_trackers_by_contours_have_budgets_of_their_own(tmp_path):
    names = ["search-contour", "contour+solved", "h-cmaes+polish", "h-cmaes+polish+solved"]
    text = GRID.replace('["pso"]', str(names).replace("'", '"')).replace("evaluations = [500]\n", "")
    plans = study_of(tmp_path, text).plans
    assert [plan.cell.algorithm for plan in plans] == names
    assert [(plan.config.algorithm, plan.config.polish, plan.solved, plan.cell.evaluations) for plan in plans] == [
        ("search-contour", False, False, 120),
        ("contour", False, True, 0),
        ("h-cmaes", True, False, 500),
        ("h-cmaes", True, True, 500),
    ]
    assert len({content_key(plan, "clip", "cpu") for plan in plans}) == 4


DOCUMENT = (Path(__file__).resolve().parents[2] / "docs" / "study.md").read_text(encoding="utf-8")


def example(language: str) -> str:
    """The document's example."""
    return re.search(rf"```{language}\n(.*?)```", DOCUMENT, re.S)[1]


def test_the_documents_study_is_right(tmp_path):
    study = study_of(tmp_path, example("toml"))
    assert len(study.plans) == 3 * 2 * 2 * 2
    assert {plan.config.runs for plan in study.plans} == {10}
    assert [clip.scene is None for clip in study.clips] == [False, False, True]


def test_the_documents_python_names_what_exists():
    exec("\n".join(line for line in example("python").splitlines() if line.startswith("from ")), {})
