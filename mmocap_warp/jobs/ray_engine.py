"""A Ray cluster: an actor per GPU, or per share of one, on any of its machines."""

import logging
import math
import os
import re
import socket
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from mmocap_warp.device.cores import work_beside_others
from mmocap_warp.errors import InputError, input_errors
from mmocap_warp.jobs import engine

_PROBE = 2.0  # how long the cluster's head may take to answer [s]
_SECONDS_BETWEEN_PROBES = 5.0  # while no worker answers
_PATIENCE = 60.0  # how long to wait while the cluster has no machine for a worker [s]


@dataclass(frozen=True)
class Shares:
    """What each worker gets of a cluster."""

    workers: int  # their number
    gpus: float  # of each worker
    cpus: int  # of each worker

    @property
    def device_kind(self) -> str:
        """``cuda`` or ``cpu``."""
        return "cuda" if self.gpus else "cpu"


def join_cluster(address: str) -> str:
    """Connect this process to a running Ray cluster; returns the address of its head.

    ``auto`` is what ``RAY_ADDRESS`` says, or the cluster of this machine. Raises an InputError if Ray, or such a
    cluster, is missing.
    """
    with input_errors("--engine ray", "Ray is not installed", "pip install 'mmocap-warp[ray]'", ImportError):
        import ray
    named = os.environ.get("RAY_ADDRESS", "auto") if address == "auto" else address
    try:
        if named != "auto":
            _knock(named)
        ray.init(address=named, log_to_driver=False, logging_level=logging.ERROR)
    except (OSError, RuntimeError, ValueError) as error:
        problem = f"there is no Ray cluster ({' '.join(str(error).split())})"
        raise InputError(f"--address {named}", problem, "start one with 'ray start --head'") from None
    return ray.get_runtime_context().gcs_address


def share_cluster(workers: int | None, gpus: float) -> Shares:
    """How the cluster that this process has joined is shared out among workers that get so many ``gpus`` each.

    By default there is one worker for these, or one per machine where there are no GPUs. Raises a ValueError for
    numbers that make no sense, or more than the cluster has.
    """
    import ray

    if workers is not None and workers < 1:
        raise ValueError(f"workers must be at least 1, got {workers}")
    if not 0 <= gpus < math.inf or (gpus > 1 and gpus != int(gpus)):
        raise ValueError(f"gpus must be a whole number, or between 0 and 1, got {gpus:g}")
    there = ray.cluster_resources()
    machines = [node["Resources"] for node in ray.nodes() if node["Alive"] and node["Resources"].get("CPU")]
    if gpus and there.get("GPU"):
        # None is spread over two GPUs unless it gets whole ones.
        here = (machine.get("GPU", 0.0) for machine in machines)
        places = sum(int(each // gpus) if gpus >= 1 else int(each) * int(1 / gpus + 1e-9) for each in here)
        if (workers or 1) > places:
            raise ValueError(f"gpus must leave room for {workers or 1} workers, {gpus:g} each leave room for {places}")
        return Shares(workers or places, gpus, cpus=1)
    if not machines:
        raise ValueError("workers must have a machine with a CPU core to run on, the cluster has none")
    count = workers or len(machines)
    per_machine = math.ceil(count / len(machines))
    cpus = int(min(machine["CPU"] for machine in machines)) // per_machine
    if not cpus:
        raise ValueError(f"workers must be at most {int(there['CPU'])}, the cluster's CPU cores, got {count}")
    return Shares(count, 0.0, cpus)


class _Actor:
    """A worker on some machine of the cluster."""

    def __init__(self, make: engine.MakeWorker, shares: Shares) -> None:
        device = "cuda:0" if shares.gpus else "cpu"  # Ray shows a worker no GPU but its own
        work_beside_others(shares.cpus)
        self._worker = make(device, shares.cpus)

    def name(self) -> str:
        """The machine and the device."""
        import ray

        gpus = ",".join(map(str, ray.get_gpu_ids()))
        return f"{socket.gethostname()} {f'cuda:{gpus}' if gpus else self._worker.device}"

    def work(self, job: Any) -> Iterator[Any]:
        """See :class:`~mmocap_warp.jobs.engine.Worker`."""
        yield from self._worker.work(job)


class RayEngine(engine.Engine):
    """Workers on a Ray cluster that this process has joined: how many, and what each gets, say its ``shares``."""

    def __init__(self, make: engine.MakeWorker, head: str, shares: Shares) -> None:
        import ray

        self._ray: Any = ray  # which may not be installed where jobs are done otherwise
        self._make, self._head, self._shares = make, head, shares
        self._actor: Any = ray.remote(num_gpus=shares.gpus, num_cpus=shares.cpus)(_Actor)
        self._heard = time.monotonic()
        self._deserted: float | None = None  # since when no machine is left
        super().__init__([None] * shares.workers)

    def submit(self, worker: int, job: Any) -> None:
        """See :class:`~mmocap_warp.jobs.engine.Engine`."""
        seat = self._seats[worker]
        seat.line = seat.worker.work.options(num_returns="streaming").remote(job)

    def events(self, seconds: float) -> list[tuple[int, Any]]:
        """See :class:`~mmocap_warp.jobs.engine.Engine`."""
        if not self._seats:
            raise engine.EngineLost("every worker of the Ray cluster died while starting")
        asked = {seat.line: worker for worker, seat in self._seats.items() if seat.line is not None}
        answered, _ = self._ray.wait(list(asked), num_returns=1, timeout=seconds) if asked else ([], [])
        if answered:
            self._heard = time.monotonic()
        elif time.monotonic() - self._heard > _SECONDS_BETWEEN_PROBES:
            self._check_head()
            return [(min(self._seats), notice) for notice in self._check_machines()]
        heard = [(asked[answer], self._hear(asked[answer])) for answer in answered]
        return [(worker, event) for worker, event in heard if event is not None]

    def close(self) -> None:
        """See :class:`~mmocap_warp.jobs.engine.Engine`."""
        super().close()
        self._ray.shutdown()

    def _start(self, place: None) -> engine.Seat:
        """Ask the cluster for a worker, on whatever machine has room."""
        actor = self._actor.remote(self._make, self._shares)
        return engine.Seat(place, actor, actor.name.remote())

    def _end(self, seat: engine.Seat) -> None:
        with suppress(self._ray.exceptions.RayError):
            self._ray.kill(seat.worker)

    def _hear(self, worker: int) -> Any | None:
        """What a worker answers; None at the end of its job."""
        seat = self._seats[worker]
        try:
            if seat.ready:
                return self._ray.get(next(seat.line))
            name = self._ray.get(seat.line)
            seat.ready, seat.line = True, None
            return engine.Ready(name)
        except StopIteration:
            seat.line = None
            return None
        except self._ray.exceptions.RayError as error:
            self._check_head()
            self._replace(worker)
            return _how_it_ended(error)

    def _check_head(self) -> None:
        """Ray itself waits for a head that is gone, and then ends this process without a word."""
        try:
            _knock(self._head)
        except OSError:
            raise engine.EngineLost(f"the Ray cluster at {self._head} has vanished") from None
        self._heard = time.monotonic()

    def _check_machines(self) -> list[engine.Notice]:
        """Ray waits for ever for a machine that a worker fits on; nobody may be left to start one."""
        now = time.monotonic()
        needed = {"CPU": self._shares.cpus, "GPU": self._shares.gpus}
        there = [node["Resources"] for node in self._ray.nodes() if node["Alive"]]
        if any(all(machine.get(kind, 0.0) >= count for kind, count in needed.items()) for machine in there):
            self._deserted = None
        elif self._deserted is None:
            self._deserted = now
            problem = f"the Ray cluster at {self._head} has no machine left that a worker fits on"
            return [engine.Notice(f"{problem}; waiting {_PATIENCE:.0f} s for one")]
        elif now - self._deserted > _PATIENCE:
            problem = f"the Ray cluster at {self._head} has had no machine that a worker fits on for {_PATIENCE:.0f} s"
            raise engine.EngineLost(problem)
        return []


def _knock(address: str) -> None:
    """See that somebody listens there; Ray itself would wait for minutes."""
    host, _, port = address.rpartition(":")
    if not (host and port.isdecimal()):
        raise ValueError("an address is auto, or host:port")
    socket.create_connection((host.strip("[]"), int(port)), _PROBE).close()


def _how_it_ended(error: Exception) -> engine.Death:
    """The worker's own error, or what Ray says first; pages about where and why it may have happened follow."""
    import ray

    if isinstance(error, ray.exceptions.RayTaskError):
        return engine.Death(engine.one_line(error.cause))
    text = re.split(r"\.? (?:class_name|actor_id|The task may)|\. ", " ".join(str(error).split()), maxsplit=1)[0]
    return engine.Death(text, engine.LESS_MEMORY if isinstance(error, ray.exceptions.OutOfMemoryError) else "")
