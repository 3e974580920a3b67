"""Where many jobs are done: the devices of this machine, or a Ray cluster that is running."""

from __future__ import annotations

from collections.abc import Callable

from mmocap_warp.commands.caller import arguments_checked
from mmocap_warp.device.resolve import device_kind
from mmocap_warp.errors import UsageError
from mmocap_warp.jobs.engine import Engine, MakeWorker


def engine_of(
    make: MakeWorker,
    engine: str,
    device: str,
    threads: int | None,
    address: str,
    workers: int | None,
    gpus: float,
) -> tuple[str, Callable[[], Engine]]:
    """The kind of the devices, and what starts a worker on each; the arguments are the commands'.

    Raises:
        UsageError: arguments that cannot be.
        InputError: Ray is not installed, or there is no such cluster.
    """
    if engine == "local":
        from mmocap_warp.jobs.local_engine import LocalEngine, local_devices

        with arguments_checked():
            devices = local_devices(device)
        return device_kind(devices[0]), lambda: LocalEngine(make, devices, threads)
    if engine != "ray":
        raise UsageError(f"--engine must be local or ray, got '{engine}'")
    from mmocap_warp.jobs.ray_engine import RayEngine, join_cluster, share_cluster

    head = join_cluster(address)
    with arguments_checked():
        shares = share_cluster(workers, gpus)
    return shares.device_kind, lambda: RayEngine(make, head, shares)
