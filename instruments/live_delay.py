"""Measure live tracking: ``python instruments/live_delay.py SECONDS [FPS]``, from masks in memory to packets received.

The walker of the built-in scene goes to and fro before its five cameras of 640x480. Another process listens by ZMQ.
"""

from __future__ import annotations

import gc
import json
import multiprocessing
import sys
import time
from collections.abc import Generator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
from walk_scene import walking

from mmocap_warp.body.model import Subject
from mmocap_warp.body.posing import Poser
from mmocap_warp.cameras.silhouette import silhouettes
from mmocap_warp.commands.caller import start_warp
from mmocap_warp.streaming.arrivals import Arrival, newest
from mmocap_warp.streaming.senders import Packet, open_sender
from mmocap_warp.tracking.live import LiveTracker
from mmocap_warp.tracking.track_config import TrackConfig

ADDRESS = "tcp://127.0.0.1:5557"
PERIOD = 4.0  # of the walk to and fro [s]


def listen(told: Any) -> None:
    """Say how late packets are that arrive, at once and smoothed [s], once none has come for three seconds."""
    import zmq

    socket = zmq.Context().socket(zmq.SUB)
    socket.subscribe(b"")
    socket.connect(ADDRESS)
    late: dict[bool, list[float]] = {False: [], True: []}
    while socket.poll(3000 if late[False] else 60000):
        packet = json.loads(socket.recv())
        late[packet["smooth"]].append(time.time() - packet["time"])
    told.put(late)


def memory() -> int:
    """Of this process [MB]."""
    return int(Path("/proc/self/statm").read_text().split()[1]) >> 8


def main(seconds: float, fps: float) -> None:
    """Measure, and print."""
    start_warp()
    made = walking()
    rig, poser, count = made.rig.undistorted(), Poser(made.body, made.root_base), round(PERIOD * fps)
    share = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(count) / count)  # it stands still at both ends
    number = share * (len(made.poses) - 1)
    poses = np.stack([np.interp(number, np.arange(len(made.poses)), each) for each in made.poses.T], axis=1)
    face = made.body.skin.face
    triangles = np.concatenate([face[:, [0, k, k + 1]] for k in range(1, face.shape[1] - 1)])
    masks = [silhouettes(rig, poser.vertices(pose)[0], triangles) for pose in poses]
    subject = Subject(made.body, made.root_base, poses[0], {})

    def source() -> Generator[Arrival, None, None]:
        begin = 0.0
        for n in range(round(seconds * fps)):
            begin = time.monotonic() - n / fps if n <= 1 else begin  # the clock starts once the first frame is done
            time.sleep(max(0.0, begin + n / fps - time.monotonic()))
            yield Arrival(n, time.time(), masks[n % count])

    context = multiprocessing.get_context("spawn")
    told = context.Queue()
    context.Process(target=listen, args=(told,), daemon=True).start()
    times: dict[int, float] = {}
    last, dropped, before = 0, 0, 0
    with (
        closing(open_sender(ADDRESS, subject, rig, fps)) as sender,
        closing(LiveTracker(subject, rig, fps, TrackConfig())) as tracker,
    ):
        gc.freeze()
        for arrival in newest(source()):
            dropped += max(0, arrival.number - last - 1)
            last, times[arrival.number] = arrival.number, arrival.time
            sender.send(Packet(tracker.step(arrival.number, arrival.masks), subject, arrival.time, False, dropped))
            for frame in tracker.smoothed():
                sender.send(Packet(frame, subject, times.pop(frame.number, arrival.time), True, dropped))
            before = before or memory()
        after = memory()
        for frame in tracker.rest():
            sender.send(Packet(frame, subject, times.pop(frame.number, time.time()), True, dropped))
        late = told.get()
    print(f"{last + 1} frames at {fps:g} a second, {dropped} dropped; memory {before} MB at first, {after} in the end")
    for smooth, name in enumerate(("at once", "smoothed")):
        delays = 1000 * np.array(late[bool(smooth)])
        half, most, nearly_all, all_of_them = np.percentile(delays, [50, 90, 99, 100])
        spread = f"median {half:.1f}, 90 % {most:.1f}, 99 % {nearly_all:.1f}, most {all_of_them:.1f} ms"
        print(f"{name}: {len(delays)} packets, {spread}")


if __name__ == "__main__":
    main(float(sys.argv[1]), float(sys.argv[2]) if len(sys.argv) > 2 else 30.0)
