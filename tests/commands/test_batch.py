"""Many recordings through the same steps: what fails is told, what is done is not done again, however a run ends."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recordings import write_recording
from report_page import Page

import mmocap_warp as mm
from mmocap_warp.cli import main
from mmocap_warp.cli.console import FAILURE
from mmocap_warp.commands import batch as module
from mmocap_warp.formats.usd.usd_body import read_subject
from mmocap_warp.jobs.engine import Engine, Ready

STEPS = "track,eval,export:glb,view"
PLAN = """
[track]
evaluations = 30
[[scenes]]
match = "a/*"
track = { evaluations = 40, seed = 3 }
"""


class Here(Engine):
    """Works in this process, which spares the start of another."""

    def __init__(self, make):
        self._worker, self._waiting = make("cpu", 1), [iter([Ready("cpu")])]

    def submit(self, worker, job):
        self._waiting.append(self._worker.work(job))

    def events(self, seconds):
        events = [(0, event) for each in self._waiting for event in each]
        self._waiting = []
        return events

    def close(self):
        pass

    _start = _end = None


@pytest.fixture
def here(monkeypatch):
    """Batches work in this process."""
    monkeypatch.setattr(module, "engine_of", lambda make, *_: ("cpu", lambda: Here(make)))


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    """Three recordings of three frames, and a scene that names no file that is there."""
    folder = tmp_path_factory.mktemp("made")
    for name in ("a/one", "a/two", "b"):
        (folder / name).mkdir(parents=True)
        write_recording(folder / name, 3)
    (folder / "broken").mkdir()
    text = (folder / "b" / "scene.toml").read_text()
    (folder / "broken" / "scene.toml").write_text(text.replace("calibration.toml", "nowhere.toml"))
    (folder / "b" / "made").mkdir()  # a scene that was made of another one
    (folder / "b" / "made" / "scene.toml").write_text(text)
    (folder / "plan.toml").write_text(PLAN)
    return folder


@pytest.fixture(scope="module")
def whole(made, tmp_path_factory) -> tuple[Path, module.BatchRun]:
    """All of them."""
    output = tmp_path_factory.mktemp("whole") / "out"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "engine_of", lambda make, *_: ("cpu", lambda: Here(make)))
        with pytest.warns(UserWarning, match="broken: given up: "):
            done = mm.batch(made, output, steps=STEPS, plan=made / "plan.toml")
    return output, done


def finished(output: Path) -> dict[str, int]:
    return {str(path): path.stat().st_mtime_ns for path in output.rglob("done.*.json")}


def test_every_scene_is_done_but_the_broken_one_which_is_told(whole):
    output, done = whole
    assert [each["name"] for each in done.trials] == ["a/one", "a/two", "b"]
    assert list(done.failures) == ["broken"]
    assert "does not exist" in done.failures["broken"]
    assert done.status.finished == 3
    for each in done.trials:
        assert each["frames"] == 3
        assert each["mean_iou"] > 0.8
        assert each["mpjpe_mm"] < 30
        folder = output / "trials" / each["name"]
        assert {"result.usdc", "result.glb", "view.html", "evaluation.json"} <= {file.name for file in folder.iterdir()}


def test_a_recording_of_several_people_is_told_and_not_tracked(made, here, tmp_path):
    shutil.copytree(made / "b", tmp_path / "people")
    with (tmp_path / "people" / "scene.toml").open("a") as text:
        text.write("\n[people.anna]\nlabel = 255\n")
    with pytest.warns(UserWarning, match="people: given up: "):
        done = mm.batch([tmp_path / "people"], tmp_path / "out", steps="track")
    assert "names several people, and a batch tracks one each; use mmocap track" in done.failures["people"]


def test_settings_are_those_of_the_last_pattern_that_matches(whole):
    output, _ = whole
    configs = {name: mm.load_result(output / "trials" / name / "result.usdc").config for name in ("a/one", "b")}
    assert [configs[name][key] for name in configs for key in ("evaluations", "seed")] == [40, 3, 30, 0]


def test_many_scenes_are_read_by_processes_as_by_this_one(made, monkeypatch):
    """On a machine of any size: Windows allows a pool 61 processes."""
    files, asked = [made / name / "scene.toml" for name in ("a/one", "a/two", "b", "broken", "b/made")], []
    alone = module._facts_of(files)
    assert [type(each) for each in alone] == [dict, dict, dict, str, str]
    pool = module.ProcessPoolExecutor
    monkeypatch.setattr(module, "_MANY", 4)
    monkeypatch.setattr(module, "available_threads", lambda: 128)
    monkeypatch.setattr(module, "ProcessPoolExecutor", lambda count, context: asked.append(count) or pool(1, context))
    assert module._facts_of(files) == alone
    assert asked == [61]


def test_the_page_has_a_row_for_each_with_a_link_to_its_view(whole):
    output, done = whole
    page = Page(done.page.read_text(encoding="utf-8"))
    assert [link["href"] for link in page.all("a")] == [f"trials/{each['name']}/view.html" for each in done.trials]
    assert all((output / link["href"]).exists() for link in page.all("a"))
    assert len(page.all("img")) == 3
    assert "does not exist" in page.text
    assert f"{done.trials[0]['mean_iou']:.3f}" in page.text


def test_what_has_not_changed_is_not_done_again(whole, made, here, tmp_path):
    output = Path(shutil.copytree(whole[0], tmp_path / "out"))
    before = finished(output)
    scenes = [made / name for name in ("a/one", "a/two", "b")]
    same = {"steps": STEPS, "plan": made / "plan.toml"}
    again = mm.batch(scenes, output, **same)
    assert (again.status.reused, again.status.finished, again.failures) == (3, 0, {})
    assert finished(output) == before
    # Another setting of some, and a damaged record.
    other = tmp_path / "other.toml"
    other.write_text(PLAN.replace("evaluations = 30", "evaluations = 31"))
    (record,) = (output / "trials" / "a" / "one").glob("done.*.json")
    record.write_bytes(b"{")
    with pytest.warns(UserWarning, match="is not valid JSON"):
        changed = mm.batch(scenes, output, **same | {"plan": other})
    assert (changed.status.reused, changed.status.finished) == (1, 2)
    assert mm.load_result(output / "trials" / "b" / "result.usdc").config["evaluations"] == 31


def test_other_steps_go_on_with_what_is_there(whole, made, here, tmp_path):
    output = Path(shutil.copytree(whole[0], tmp_path / "out"))
    results = sorted(output.glob("trials/**/result.usdc"))
    before = [result.stat().st_mtime_ns for result in results]
    scenes, plan = [made / name for name in ("a/one", "a/two", "b")], made / "plan.toml"
    added = mm.batch(scenes, output, steps=f"{STEPS},export:csv", plan=plan)
    assert (added.status.finished, added.failures) == (3, {})
    assert [result.stat().st_mtime_ns for result in results] == before
    assert all(result.with_suffix(".csv").exists() for result in results)
    results[0].unlink()
    with pytest.warns(UserWarning, match="is of a result that is gone"):
        again = mm.batch(scenes, output, steps=STEPS, plan=plan)
    assert (again.status.reused, again.status.finished) == (2, 1)
    assert results[0].exists()


def test_masks_that_a_step_makes_are_another_recording(made, tmp_path):
    files = {"b": made / "b" / "scene.toml"}
    keys = []
    for steps in (("track",), ("track", "eval"), ("mask", "track"), ("mask", "track", "eval")):
        _, (task,), _ = module._planned(files, tmp_path, steps, [], "the plan", "cpu")
        keys.append(task.job.key)
    assert keys[0] == keys[1] != keys[2] == keys[3]


def test_scenes_in_folders_that_are_links_are_done(made, tmp_path):
    (tmp_path / "linked").symlink_to(made / "b")
    assert list(module._scene_files(tmp_path, tmp_path / "out")) == ["linked"]


@pytest.mark.parametrize(
    ("fitted", "size"),  # a fit's body is so many times as large, and costs so much
    [
        ([(1.02, 0.12), (0.98, 0.1)], 1.0),
        ([(1.3, 0.21), (0.98, 0.1)], 0.98),
        ([None, (0.98, 0.1)], 0.98),
    ],
    ids=["mean", "one has failed", "one cannot be fitted"],
)
def test_a_person_is_fitted_once_and_tracked_in_every_recording(fitted, size, made, here, tmp_path, monkeypatch):
    fits = []
    subject = read_subject(made / "b" / "subject.usdc")

    def fit(scene, body=None, **given):
        name = Path(getattr(scene, "path", scene)).parent.name
        fits.append((name, body, given.get("rigid"), given.get("finalists")))
        if body is not None:  # what is found with less fits one scene badly
            given["reporter"].warn(f"fit {len(fits)}")
            return replace(subject, provenance={"fit.cost": 0.09 if name == "one" and "finalists" in given else 0.05})
        if (now := fitted[len(fits) - 1]) is None:
            raise mm.InputError(scene, "shows nobody", "look at it")
        return replace(subject, body=subject.body.in_unit(1 / now[0]), provenance={"fit.cost": now[1]})

    monkeypatch.setattr(module.track, "fit", fit)
    plan = tmp_path / "plan.toml"
    plan.write_text('[track]\nevaluations = 30\n[[scenes]]\nmatch = "a/*"\nperson = "Anna"\n')
    scenes = [made / name for name in ("a/one", "a/two", "b")]
    done = mm.batch(scenes, tmp_path / "out", steps="track", plan=plan)
    assert done.failures == {}
    body = tmp_path / "out" / "people" / "Anna" / "body.usdc"
    of_person = [("one", None, None, None), ("two", None, None, None)]
    assert fits == [*of_person, ("one", body, True, 1), ("one", body, True, None), ("two", body, True, 1)]
    np.testing.assert_allclose(mm.load_body(body).joint_rest, size * subject.body.joint_rest, atol=1e-3)
    said = {each["name"]: [line for line in each["notes"] if line.startswith("fit ")] for each in done.trials}
    assert said == {"a/one": ["fit 4"], "a/two": ["fit 5"], "b": []}  # none of the fit that did not count


@pytest.mark.parametrize(
    ("devices", "there", "running", "noted"),
    [
        (["cuda:0"], True, False, True),
        (["cuda:0"], True, True, False),
        (["cuda:0"], False, False, False),  # Windows has no such program
        (["cuda:0", "cuda:1"], True, False, False),
        (["cpu"], True, False, False),
    ],
)
def test_workers_that_take_turns_on_a_gpu_are_noted(devices, there, running, noted, made, here, tmp_path, monkeypatch):
    mark = tmp_path / "nvidia-cuda-mps-control.pid"
    if running:
        mark.touch()
    monkeypatch.setattr(module, "_MPS", mark)
    monkeypatch.setattr(module.shutil, "which", lambda name: name if there else None)
    monkeypatch.setattr(module, "local_devices", lambda _: devices)
    notes = []
    reporter = mm.Reporter()
    reporter.note = notes.append
    mm.batch([made / "b"], tmp_path / "out", steps="fit", workers=2, reporter=reporter)
    assert any("nvidia-cuda-mps-control -d" in note for note in notes) == noted


@pytest.mark.nightly
def test_killed_it_goes_on_and_ends_with_the_same_files(made, whole, tmp_path):
    output, reference = tmp_path / "out", whole[0]
    command = [sys.executable, "-m", "mmocap_warp", "batch", str(made), "-o", str(output), "--steps", STEPS]
    command += ["--plan", str(made / "plan.toml"), "--device", "cpu", "--workers", "2", "--quiet"]
    kept: dict[str, int] = {}
    while len(kept) < 3:
        running = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
        )
        while len(finished(output)) == len(kept) and running.poll() is None:
            time.sleep(0.005)
        if not kept:  # at the beginning of the next one
            os.killpg(running.pid, signal.SIGKILL)
        assert running.wait() in (-signal.SIGKILL, FAILURE)
        assert kept.items() <= finished(output).items()  # no job twice
        kept = finished(output)
    for file in reference.rglob("result.glb"):
        assert (output / file.relative_to(reference)).read_bytes() == file.read_bytes()
    assert (output / "index.html").exists()


def test_interrupted_it_goes_on_with_what_is_not_done(made, here, tmp_path, monkeypatch):
    scenes, take = [made / name for name in ("a/one", "b")], module.TrialWorker.work

    def interrupted(worker, job):
        if job.name == "b":
            raise KeyboardInterrupt
        yield from take(worker, job)

    with monkeypatch.context() as patch:
        patch.setattr(module.TrialWorker, "work", interrupted)
        with pytest.raises(KeyboardInterrupt):
            mm.batch(scenes, tmp_path / "out", steps="track", plan=made / "plan.toml")
    done = mm.batch(scenes, tmp_path / "out", steps="track", plan=made / "plan.toml")
    assert (done.status.reused, done.status.finished, done.failures) == (1, 1, {})


def test_the_command_says_what_is_missing(whole, made, here, tmp_path, capsys):
    output = Path(shutil.copytree(whole[0], tmp_path / "out"))
    scenes = tmp_path / "scenes.txt"
    scenes.write_text("\n".join(["# of today", *(f"{made / name}" for name in ("a/one", "a/two", "b", "broken"))]))
    command = ["batch", str(scenes), "-o", str(output), "--steps", STEPS, "--plan", str(made / "plan.toml")]
    assert main([*command, "--json"]) == FAILURE
    answer = json.loads(capsys.readouterr().out)
    assert (answer["finished_before"], answer["finished_now"]) == (3, 0)
    assert [each["scene"] for each in answer["failed"]] == ["broken"]


def test_scenes_are_named_from_the_folder_that_was_given(made, here, tmp_path):
    (tmp_path / "days").mkdir()
    shutil.copytree(made / "b", tmp_path / "days" / "monday" / "b")
    plan = tmp_path / "plan.toml"
    plan.write_text("[[scenes]]\nmatch = 'monday/*'\n[[scenes]]\nmatch = 'tuesday/*'\n")
    with pytest.warns(UserWarning, match="plan.toml: no scene matches 'tuesday/\\*'; the first is called 'monday/b'"):
        done = mm.batch(tmp_path / "days", tmp_path / "out", steps="track", plan=plan)
    assert [each["name"] for each in done.trials] == ["monday/b"]
    # A scene's own folder or file, and a list, give the last folder's name.
    own = tmp_path / "days" / "monday" / "b"
    for number, given in enumerate([own, [own], own / "scene.toml"]):
        done = mm.batch(given, tmp_path / str(number), steps="track")
        assert [each["name"] for each in done.trials] == ["b"]


@pytest.mark.parametrize(
    ("given", "error", "told"),
    [
        ({"steps": "dance"}, mm.UsageError, "steps must be of mask, fit, .* and export:ENDING, got 'dance'"),
        ({"steps": "mask,view"}, mm.UsageError, "steps needs track"),
        ({"steps": "track,export:usdc"}, mm.UsageError, "takes no export:usdc"),
        ({"engine": "ray", "device": "cpu"}, mm.UsageError, "cannot be given with engine ray"),
        ({"workers": 0}, mm.UsageError, "workers must be at least 1"),
        ({"minutes": 0.0}, mm.UsageError, "minutes must be positive, got 0"),
        ({"engine": "cloud"}, mm.UsageError, "engine must be local or ray"),
        ({"scenes": "."}, mm.InputError, "names no scene"),
        ({"scenes": ["b", "b/scene.toml"]}, mm.InputError, "names two scenes of one folder"),
        ({"scenes": ["b", "b/made"]}, mm.InputError, "names two scenes of one folder"),
        ({"plan": "[track]\ndance = 1"}, mm.InputError, r"\[track\]: dance is not known; use one of"),
        ({"plan": "[fit]\nrigid = 'no'"}, mm.InputError, r"\[fit\]: rigid = 'no' is not true or false"),
        ({"plan": "[[scenes]]\nmatch = 'b'\ntrack.runs = 0"}, mm.InputError, r"\[track\]: runs must be at least 1"),
        ({"plan": "mask.scale = 'x'"}, mm.InputError, r"\[mask\]: scale = 'x' is not a number"),
        ({"plan": "scenes = [1]"}, mm.InputError, "scenes is not a list of tables"),
        ({"scenes": "list.txt"}, mm.InputError, "names no file .embedded null"),
        ({"scenes": "absent.toml"}, mm.InputError, "absent.toml: no such file"),
        ({"plan": "[[scenes]]\nperson = 'x'"}, mm.InputError, "'match' is missing"),
    ],
)
def test_wrong_arguments_are_told_before_anything_is_written(given, error, told, made, tmp_path):
    given = {"scenes": made} | given
    if "plan" in given:
        (tmp_path / "plan.toml").write_text(given["plan"])
        given["plan"] = tmp_path / "plan.toml"
    if given["scenes"] == "list.txt":
        (tmp_path / "list.txt").write_bytes(b"a\0b")
        given["scenes"] = tmp_path / "list.txt"
    if given["scenes"] == ".":
        (tmp_path / "empty").mkdir()
        given["scenes"] = tmp_path / "empty"
    if isinstance(given["scenes"], list):
        given["scenes"] = [made / name for name in given["scenes"]]
    with pytest.raises(error, match=told):
        mm.batch(output=tmp_path / "out", **given)
    assert not (tmp_path / "out").exists()


def test_results_are_not_written_among_the_scenes(made):
    with pytest.raises(mm.InputError, match=r"holds all the scenes.*name another output"):
        mm.batch(made, output=made)


def test_files_of_others_are_left_alone(made, here, tmp_path):
    mine = tmp_path / "out" / "trials" / "b" / "mine.txt"
    mine.parent.mkdir(parents=True)
    mine.write_text("mine")
    with pytest.warns(UserWarning, match="holds files that no batch has written"):
        done = mm.batch([made / "b"], tmp_path / "out", steps="track")
    assert list(done.failures) == ["b"]
    assert mine.read_text() == "mine"


def test_recordings_of_a_person_who_cannot_be_fitted_fail_and_the_others_go_on(made, here, tmp_path, monkeypatch):
    def fit(scene, *_, **__):
        raise mm.InputError(scene, "shows nobody", "look at it")

    monkeypatch.setattr(module.track, "fit", fit)
    plan = tmp_path / "plan.toml"
    plan.write_text('[track]\nevaluations = 30\n[[scenes]]\nmatch = "a/*"\nperson = "Anna"\n')
    with pytest.warns(UserWarning, match="Anna: given up: .*shows nobody"):
        done = mm.batch([made / name for name in ("a/one", "b")], tmp_path / "out", steps="track", plan=plan)
    assert [each["name"] for each in done.trials] == ["b"]
    assert list(done.failures) == ["a/one"]
    assert done.failures["a/one"].startswith("the body of Anna failed: ")
