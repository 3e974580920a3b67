"""A study on a Ray cluster: the files of a local run though a machine dies, and a clear line if the cluster is gone."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import ray
from ray.cluster_utils import Cluster
from tiny_study import STUDY as ALL_ALGORITHMS
from tiny_study import answer_members, run_quietly, tasks_of, write_study

from mmocap_warp import cli
from mmocap_warp.cli import console
from mmocap_warp.errors import InputError
from mmocap_warp.jobs import ray_engine as engine_module
from mmocap_warp.jobs.engine import LESS_MEMORY, Death, EngineLost, Notice
from mmocap_warp.jobs.ray_engine import RayEngine, Shares, _how_it_ended, join_cluster, share_cluster
from mmocap_warp.study.job import Worker

STUDY = ALL_ALGORITHMS.replace('"h-cmaes", "cmaes", "de", "pso"', '"h-cmaes", "pso"')
CELLS = 6
PATIENCE = 120.0  # for whatever a cluster does [s]


@pytest.fixture(scope="module")
def clusters() -> Iterator[list[Cluster]]:
    """The cluster that tests share, last in the list; one that a test has shut down is followed by another."""
    made: list[Cluster] = []
    yield made
    for cluster in made:
        cluster.shutdown()


@pytest.fixture
def cluster(clusters) -> Cluster:
    """A head and two machines with room for a worker each; all are processes of this machine."""
    if not clusters or clusters[-1].head_node is None:
        clusters.append(Cluster(initialize_head=True, head_node_args={"num_cpus": 0, "include_dashboard": False}))
    for _ in range(3 - len(clusters[-1].list_all_nodes())):
        clusters[-1].add_node(num_cpus=1)
    return clusters[-1]


def started(
    cluster: Cluster, study: Path, results: Path, finished: int = 1, patience: float = 60.0
) -> subprocess.Popen:
    """A run on the cluster's two machines that begin together, once both have a cell and some are ``finished``."""
    busy = [results.with_name(f"busy.{worker}") for worker in range(2)]
    main = f"""
import sys
from pathlib import Path
from mmocap_warp.jobs import ray_engine as ray
from mmocap_warp.jobs.engine import Ready
from mmocap_warp.cli import main
ray._PATIENCE = {patience}
ray._SECONDS_BETWEEN_PROBES = 1.0
submit, events, ready = ray.RayEngine.submit, ray.RayEngine.events, []
def noted(engine, worker, job):
    submit(engine, worker, job)
    Path(f"{results.with_name("busy")}.{{worker}}").touch()
def together(engine, seconds):
    happened = events(engine, seconds)
    if len(ready) >= 2:
        return happened
    ready.extend(each for each in happened if isinstance(each[1], Ready))
    return [each for each in happened if each not in ready] + (ready if len(ready) >= 2 else [])
ray.RayEngine.submit, ray.RayEngine.events = noted, together
sys.exit(main(sys.argv[1:]))
"""
    where = ["--engine", "ray", "--address", cluster.address, "--workers", "2", "--json"]
    command = [sys.executable, "-c", main, "study", "run", str(study), "-o", str(results), *where]
    run = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + PATIENCE
    while run.poll() is None and time.monotonic() < deadline:
        if all(file.exists() for file in busy) and len(list(results.glob("*.npz"))) >= finished:
            break
        time.sleep(0.01)
    return run


def test_two_workers_give_the_files_of_a_local_run_though_a_machine_dies(cluster, tmp_path):
    study = write_study(tmp_path, STUDY.replace("seeds = 2", "seeds = 4").replace("[12]", "[60]"))
    run = started(cluster, study, tmp_path / "ray", finished=0)
    cluster.remove_node(cluster.list_all_nodes()[-1], allow_graceful=False)
    output, notes = run.communicate(timeout=PATIENCE)
    assert run.returncode == console.OK, notes
    assert "died" in notes
    assert "the cell is tried again" in notes
    assert json.loads(output)["finished_now"] == CELLS
    local = tasks_of(study, tmp_path / "local")
    run_quietly(local)
    assert len(list((tmp_path / "ray").iterdir())) == CELLS
    for task in local:
        assert answer_members(tmp_path / "ray" / task.path.name) == answer_members(task.path)


@pytest.mark.nightly
def test_a_cluster_that_vanishes_is_told_and_what_is_finished_stays(cluster, tmp_path):
    study = write_study(tmp_path, STUDY.replace("seeds = 2", "seeds = 10").replace("[12]", "[100]"))
    run, address = started(cluster, study, tmp_path / "ray"), cluster.address
    cluster.shutdown()
    output, notes = run.communicate(timeout=PATIENCE)
    assert run.returncode == console.FAILURE
    answer = json.loads(output)
    assert f"the Ray cluster at {address} has vanished" in notes
    assert 1 <= answer["finished_now"] == CELLS - len(answer["failed"])
    assert all("has vanished" in failure["problem"] for failure in answer["failed"])
    assert len(list((tmp_path / "ray").glob("*.npz"))) == answer["finished_now"]


@pytest.mark.nightly
def test_a_cluster_without_a_machine_left_is_told_and_what_is_missing(cluster, tmp_path):
    """Its head lives on; Ray would wait for another machine for ever."""
    study = write_study(tmp_path, STUDY.replace("seeds = 2", "seeds = 10").replace("[12]", "[100]"))
    run, address = started(cluster, study, tmp_path / "ray", patience=4.0), cluster.address
    for node in cluster.list_all_nodes()[1:]:
        cluster.remove_node(node, allow_graceful=False)
    output, notes = run.communicate(timeout=PATIENCE)
    assert run.returncode == console.FAILURE
    answer = json.loads(output)
    assert f"the Ray cluster at {address} has no machine left that a worker fits on; waiting 4 s for one" in notes
    assert "no worker has started yet" not in notes.partition("waiting")[2]
    assert 1 <= answer["finished_now"] == CELLS - len(answer["failed"])
    problem = f"the Ray cluster at {address} has had no machine that a worker fits on for 4 s"
    assert {failure["problem"] for failure in answer["failed"]} == {problem}


@pytest.mark.parametrize("address", ["127.0.0.1:1", "nowhere"])
def test_without_a_cluster_the_remedy_is_told(address, tmp_path, capsys):
    study = write_study(tmp_path)
    code = cli.main(["study", "run", str(study), "-o", str(tmp_path / "r"), "--engine", "ray", "--address", address])
    assert code == console.BAD_INPUT
    assert "there is no Ray cluster" in (told := capsys.readouterr().err)
    assert "start one with 'ray start --head'" in told
    assert told.count("\n") == 1


def test_a_workers_end_is_told_in_one_line_by_its_cause():
    failed = ray.exceptions.RayTaskError("work", "Traceback\n ...", ValueError("no such\nthing")).as_instanceof_cause()
    assert _how_it_ended(failed) == Death("ValueError: no such thing")
    killed = ray.exceptions.OutOfMemoryError("Task was killed due to the node running low on memory.\nMemory on ...")
    assert _how_it_ended(killed) == Death("Task was killed due to the node running low on memory", LESS_MEMORY)


def test_without_ray_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(InputError, match=r"Ray is not installed; pip install 'mmocap-warp\[ray\]'"):
        join_cluster("auto")


def machines(monkeypatch, *resources: dict[str, float]) -> None:
    """A cluster of such machines."""
    nodes = [{"Alive": True, "Resources": each} for each in resources]
    total = {name: sum(each.get(name, 0.0) for each in resources) for name in ("CPU", "GPU")}
    monkeypatch.setattr(ray, "nodes", lambda: nodes)
    monkeypatch.setattr(ray, "cluster_resources", lambda: {name: value for name, value in total.items() if value})


@pytest.mark.parametrize(
    ("workers", "gpus", "shares"),
    [
        (None, 1.0, Shares(10, 1.0, 1)),
        (None, 0.5, Shares(20, 0.5, 1)),
        (None, 0.3, Shares(30, 0.3, 1)),
        (None, 2.0, Shares(5, 2.0, 1)),
        (3, 1.0, Shares(3, 1.0, 1)),
        (None, 0.0, Shares(2, 0.0, 32)),
        (4, 0.0, Shares(4, 0.0, 16)),
    ],
)
def test_a_cluster_is_shared_out(workers, gpus, shares, monkeypatch):
    machines(monkeypatch, {"CPU": 64.0, "GPU": 8.0}, {"CPU": 32.0, "GPU": 2.0}, {})
    assert share_cluster(workers, gpus) == shares
    assert shares.device_kind == ("cuda" if gpus else "cpu")


def test_a_head_that_does_not_answer_has_vanished():
    with pytest.raises(EngineLost, match=r"the Ray cluster at 127\.0\.0\.1:1 has vanished"):
        RayEngine(Worker, "127.0.0.1:1", Shares(0, 0.0, 2))._check_head()


def test_a_machine_that_a_worker_fits_on_is_waited_for(monkeypatch):
    monkeypatch.setattr(engine_module, "_PATIENCE", 0.0)
    engine = RayEngine(Worker, "head:1", Shares(0, 0.0, 2))
    for _ in range(2):  # once it is there again, the next wait is a new one
        machines(monkeypatch, {"CPU": 1.0}, {"CPU": 2.0})
        assert engine._check_machines() == []
        machines(monkeypatch, {"CPU": 1.0})
        (notice,) = engine._check_machines()
        problem = "the Ray cluster at head:1 has no machine left that a worker fits on; waiting 0 s for one"
        assert notice == Notice(problem)
    with pytest.raises(EngineLost, match="the Ray cluster at head:1 has had no machine that a worker fits on for 0 s"):
        engine._check_machines()


@pytest.mark.parametrize(
    ("workers", "gpus", "problem"),
    [
        (0, 1.0, "workers must be at least 1"),
        (None, -1.0, "gpus must be"),
        (None, 1.5, "gpus must be"),
        (None, float("nan"), "gpus must be"),
        (3, 1.0, "1 each leave room for 2"),
        (9, 0.0, "workers must be at most 8"),
    ],
)
def test_shares_that_cannot_be_are_refused(workers, gpus, problem, monkeypatch):
    machines(monkeypatch, {"CPU": 8.0, "GPU": 2.0})
    with pytest.raises(ValueError, match=problem):
        share_cluster(workers, gpus)
