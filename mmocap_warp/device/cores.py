"""The cores that this process may use; of the processor alone, so that no one waits for Warp to start."""

import os
import sys

_SWITCH_SECONDS = 0.0002  # Python's own .005 let a thread that reads masks hold up the one that launches kernels

_CORES_TO_SPARE = 8  # of so many, one may do nothing but wait

_most: list[int] = []  # threads, where other processes use the other cores


def available_threads() -> int:
    """CPU cores that this process may use."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min([cores, *_most])


def waits_awake(device: str) -> bool:
    """Whether frames that come live are waited for with a busy core: for a GPU, where there are cores to spare.

    A core that slept between frames computes more slowly for some milliseconds.
    """
    return device != "cpu" and available_threads() >= _CORES_TO_SPARE


def work_beside_others(threads: int | None) -> None:
    """This process is one of several workers: it uses so many threads, of OpenCV too; None for all."""
    sys.setswitchinterval(_SWITCH_SECONDS)
    if threads:
        import cv2

        cv2.setNumThreads(threads)
        _most[:] = [threads]
