"""Worker processes of this machine."""

import signal
import subprocess
import sys
from multiprocessing.process import BaseProcess

import pytest
from study_workers import ThreadCounter

from mmocap_warp.jobs.engine import Ready, Refusal
from mmocap_warp.jobs.local_engine import LocalEngine
from mmocap_warp.study.job import Worker


def test_opencv_takes_no_more_threads_than_its_worker():
    engine = LocalEngine(ThreadCounter, ["cpu"], threads=3)
    assert engine.events(60.0) == [(0, Ready("cpu"))]
    engine.submit(0, "anything")
    assert engine.events(60.0) == [(0, Refusal("3"))]
    engine.close()


@pytest.mark.skipif(sys.platform == "win32", reason="signals cannot be held back there")
def test_ctrl_c_waits_while_a_process_starts(monkeypatch):
    """A process inherits that, and so does the one that forks: a traceback of its imports would be shown."""
    blocked, start = [], BaseProcess.start

    def watched(process):
        blocked.append(signal.pthread_sigmask(signal.SIG_BLOCK, ()))
        start(process)

    monkeypatch.setattr(BaseProcess, "start", watched)
    engine = LocalEngine(Worker, ["cpu"], 1)
    engine.close()
    assert signal.SIGINT in blocked[0]
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())


MASK_OF_A_WORKER = """
from mmocap_warp.jobs.local_engine import LocalEngine
from mmocap_warp.study.job import Worker
engine = LocalEngine(Worker, ["cpu"], 1)
(seat,) = engine._seats.values()
print(next(line for line in open(f"/proc/{seat.worker.pid}/status") if line.startswith("SigBlk")).split()[1])
engine.close()
"""


@pytest.mark.skipif(sys.platform != "linux", reason="workers are forks there alone")
def test_ctrl_c_waits_in_the_first_process_that_is_started():
    """In a program of its own: what multiprocessing starts before a first process lets signals through again."""
    said = subprocess.run([sys.executable, "-c", MASK_OF_A_WORKER], capture_output=True, text=True, check=True)
    assert int(said.stdout, 16) & 1 << signal.SIGINT - 1


@pytest.mark.skipif(sys.platform != "linux", reason="workers are forks there alone")
def test_a_worker_is_started_although_the_process_that_forks_is_killed_meanwhile(monkeypatch):
    tries, start = [], BaseProcess.start

    def killed_once(process):
        tries.append(process)
        if len(tries) == 1:
            raise EOFError
        start(process)

    monkeypatch.setattr(BaseProcess, "start", killed_once)
    engine = LocalEngine(Worker, ["cpu"], 1)
    assert engine.events(60.0) == [(0, Ready("cpu"))]
    engine.close()
