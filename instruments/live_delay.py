"""Measure live tracking: ``python instruments/live_delay.py SECONDS [FPS [PEOPLE]]``, from masks to packets received.

The walker of the built-in scene goes to and fro before its five cameras of 640x480, or several before seven. Masks are
in memory, and another process listens by ZMQ.
"""

from __future__ import annotations

import gc
import json
import multiprocessing
import sys
import time
from collections.abc import Generator
from contextlib import ExitStack, closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from walk_scene import walking

from mmocap_warp.body.model import Subject
from mmocap_warp.body.posing import Poser
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.cameras.silhouette import silhouettes
from mmocap_warp.commands.caller import Reporter, start_warp
from mmocap_warp.commands.live_session import Tracked, follow
from mmocap_warp.device.cores import waits_awake
from mmocap_warp.device.resolve import resolve_device
from mmocap_warp.masks.observation import Observation
from mmocap_warp.streaming.arrivals import Arrival, newest
from mmocap_warp.streaming.senders import open_sender
from mmocap_warp.synthesis.footage.made_recording import placed_camera
from mmocap_warp.tracking.live_process import make_live
from mmocap_warp.tracking.track_config import TrackConfig

ADDRESS = "tcp://127.0.0.1:5557"
PERIOD = 4.0  # of the walk to and fro [s]
CIRCLE = 1.3  # radius of that on which several people stand [m]


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


@dataclass(frozen=True)
class Person:
    """One who is filmed."""

    name: str
    subject: Subject
    masks: list[list[np.ndarray]]  # per frame and camera (height, width) bool
    hidden: list[list[np.ndarray] | None]  # what may be in front, or None


def walkers(count: int, fps: float) -> tuple[list[Person], CameraRig]:
    """People who walk to and fro as in the built-in scene, and the cameras.

    One is before its five cameras. Several stand on a circle, amid seven; who is nearer to a camera hides the others.
    """
    made = walking()
    rig, poser, frames = made.rig.undistorted(), Poser(made.body, made.root_base), round(PERIOD * fps)
    share = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(frames) / frames)  # they stand still at both ends
    number = share * (len(made.poses) - 1)
    poses = np.stack([np.interp(number, np.arange(len(made.poses)), each) for each in made.poses.T], axis=1)
    face = made.body.skin.face
    triangles = np.concatenate([face[:, [0, k, k + 1]] for k in range(1, face.shape[1] - 1)])
    if count == 1:
        masks = [silhouettes(rig, poser.vertices(pose)[0], triangles) for pose in poses]
        return [Person("", Subject(made.body, made.root_base, poses[0], {}), masks, [None] * frames)], rig
    rig, bearing = ring(), 2 * np.pi * np.arange(count) / count
    places = CIRCLE * np.stack([np.cos(bearing), np.sin(bearing), np.zeros(count)], axis=1)
    skins = [poser.vertices(pose)[0] + places[:, None] for pose in poses[: frames // 2 + 1]]  # then they go back
    with multiprocessing.get_context("spawn").Pool() as pool:
        one_way = pool.map(partial(seen_and_hidden, rig, triangles), skins)
    people = []
    for n, place in enumerate(places):
        start = np.concatenate([poses[0, :3] + place, poses[0, 3:]])
        seen, hidden = zip(*(each[n] for each in [*one_way, *one_way[-2:0:-1]]), strict=True)
        people.append(Person(f"person{n + 1}", Subject(made.body, made.root_base, start, {}), [*seen], [*hidden]))
    return people, rig


def seen_and_hidden(rig: CameraRig, triangles: np.ndarray, skins: np.ndarray) -> list[tuple[Any, Any]]:
    """Of skins (person, vertex, 3), each one's masks, and those of the others, per camera (height, width) bool."""
    alone = [silhouettes(rig, skin, triangles) for skin in skins]
    depth = np.einsum("ki,ni->kn", rig.R[:, 2], skins.mean(axis=1))  # (camera, person), but for a constant
    count, views, people = len(skins), range(len(rig)), []
    for n in range(count):
        nearer = [
            [np.zeros_like(alone[n][k]), *(alone[j][k] for j in range(count) if depth[k, j] < depth[k, n])]
            for k in views
        ]
        seen = [alone[n][k] & ~np.any(nearer[k], axis=0) for k in views]
        others = [np.any([alone[j][k] for j in range(count) if j != n], axis=0) & ~seen[k] for k in views]
        people.append((seen, others))
    return people


def ring() -> CameraRig:
    """Seven cameras around several people."""
    placed = [placed_camera(360 / 7 * k, 5.5, 1.2 + 0.2 * k, 0.9, 0.0, 650.0, (0.0, 0.0), (640, 480)) for k in range(7)]
    K, R, t = (np.array(column) for column in zip(*placed, strict=True))
    return CameraRig(tuple("abcdefg"), K, R, t, np.tile((640, 480), (7, 1)), np.zeros((7, 5)), "+z").undistorted()


def main(seconds: float, fps: float, count: int) -> None:
    """Measure, and print."""
    start_warp()
    people, rig = walkers(count, fps)

    used: list[int] = []  # memory when each frame comes [MB]

    def source() -> Generator[Arrival, None, None]:
        begin = 0.0
        for n in range(round(seconds * fps)):
            begin = time.monotonic() - n / fps if n <= 1 else begin  # the clock starts once the first frame is done
            time.sleep(max(0.0, begin + n / fps - time.monotonic()))
            used.append(memory())
            seen, frame = time.time(), n % len(people[0].masks)
            yield Arrival(n, seen, [Observation.from_masks(p.masks[frame], None, p.hidden[frame]) for p in people])

    context = multiprocessing.get_context("spawn")
    told = context.Queue()
    context.Process(target=listen, args=(told,), daemon=True).start()
    subjects = {each.name: each.subject for each in people}
    about = [(each.subject, rig, fps, TrackConfig(), each.hidden[0] is not None) for each in people]
    with ExitStack() as stack:
        sender = stack.enter_context(closing(open_sender(ADDRESS, subjects, rig, fps)))
        trackers = [stack.enter_context(closing(each)) for each in make_live("auto", about)]
        for tracker in trackers:
            tracker.wait()
        gc.freeze()
        awake = count == 1 and waits_awake(resolve_device("auto"))
        tracked = [Tracked(each.name, each.subject, 1 / fps, [sender]) for each in people]
        report = follow(tracked, trackers, newest(source(), awake=awake), rig.names, Reporter())
        late = told.get()
    who = f"{len(people)} people, {len(rig)} cameras: {round(seconds * fps)} frames at {fps:g} a second"
    print(f"{who}, {report.dropped} dropped, {report.lost} lost; memory {used[1]} MB at first, {used[-1]} in the end")
    for smooth, name in enumerate(("at once", "smoothed")):
        delays = 1000 * np.array(late[bool(smooth)])
        half, most, nearly_all, all_of_them = np.percentile(delays, [50, 90, 99, 100])
        spread = f"median {half:.1f}, 90 % {most:.1f}, 99 % {nearly_all:.1f}, most {all_of_them:.1f} ms"
        print(f"{name}: {len(delays)} packets, {spread}")


if __name__ == "__main__":
    values = dict(enumerate(sys.argv[1:]))
    main(float(values[0]), float(values.get(1, 30)), int(values.get(2, 1)))
