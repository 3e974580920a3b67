"""A worker beside others uses its share of the cores."""

from __future__ import annotations

import subprocess
import sys

from mmocap_warp.device.cores import waits_awake

PROGRAM = """
import cv2
from mmocap_warp.device.cores import available_threads, work_beside_others

work_beside_others(1)
print(available_threads(), cv2.getNumThreads())
"""


def test_a_worker_uses_no_more_threads_than_are_its_own():
    run = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True)
    assert run.stdout.split() == ["1", "1"]


def test_a_core_is_kept_busy_for_a_gpu_alone_and_where_there_are_many(monkeypatch):
    monkeypatch.setattr("mmocap_warp.device.cores.available_threads", lambda: 8)
    assert (waits_awake("cuda:0"), waits_awake("cpu")) == (True, False)
    monkeypatch.setattr("mmocap_warp.device.cores.available_threads", lambda: 4)
    assert not waits_awake("cuda:0")
