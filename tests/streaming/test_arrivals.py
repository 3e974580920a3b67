"""Frames as they come: the newest one counts, a camera that stops is lost and comes back, and nothing is queued."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterator

import cv2
import numpy as np
import pytest
from small_scene import CAMERAS, SCENE, SIZE, make_scene

from mmocap_warp.errors import InputError
from mmocap_warp.scene.scene_toml import load_scene
from mmocap_warp.streaming.arrivals import Arrival, arrivals, newest

EMPTY = np.zeros(SIZE[::-1], np.uint8)
SQUARE = EMPTY.copy()
SQUARE[10:40, 24:40] = 255
PNG = cv2.imencode(".png", SQUARE)[1].tobytes()


@pytest.fixture
def scene(tmp_path):
    """Three cameras whose files are not there yet."""
    folder = make_scene(tmp_path)
    (folder / "scene.toml").write_text(SCENE.replace(CAMERAS, CAMERAS.replace("masks = ", "# ")))
    return load_scene(folder, live=True)


def seen(arrival: Arrival) -> list[int | None]:
    """Of each camera, the foreground pixels."""
    (observation,) = arrival.seen
    return [None if k in arrival.silent else int(pixels) for k, pixels in enumerate(observation.foreground)]


@pytest.mark.parametrize("awake", [False, True])
def test_a_frame_that_waits_when_the_next_comes_is_dropped(awake):
    taken, released, closed = threading.Event(), threading.Event(), threading.Event()

    def source() -> Iterator[Arrival]:
        try:
            for number in range(6):
                if number == 2:
                    assert taken.wait(10.0)  # the second frame is being worked on
                yield Arrival(number, 0.0, [])
            released.set()
        finally:
            closed.set()

    numbers = []
    for frame in newest(source(), awake=awake):
        numbers.append(frame.number)
        if frame.number == 1:
            taken.set()
            assert released.wait(10.0)
    assert numbers == [0, 1, 5]
    assert closed.is_set()


def test_the_source_is_not_asked_for_more_while_the_first_frame_is_searched():
    asked = []

    def source() -> Iterator[Arrival]:
        for number in range(2):
            asked.append(number)
            yield Arrival(number, 0.0, [])

    frames = newest(source())
    next(frames)
    time.sleep(0.05)
    assert asked == [0]
    assert [frame.number for frame in frames] == [1]


def test_what_is_wrong_with_a_source_is_told():
    def source() -> Iterator[Arrival]:
        yield Arrival(0, 0.0, [])
        raise InputError("camera", "burns", "put it out")

    with pytest.raises(InputError, match="camera: burns"):
        list(newest(source()))


def test_a_scenes_own_files_come_at_their_pace(tmp_path):
    scene = load_scene(make_scene(tmp_path))
    frames = list(arrivals([scene], 1.0, ()))
    assert [frame.number for frame in frames] == [0, 1, 2]
    assert frames[2].time - frames[1].time > 0.5 / scene.fps
    for frame, observation in zip(frames, scene.observations(), strict=True):
        np.testing.assert_array_equal(frame.seen[0].words, observation.words)


def test_a_folder_that_grows(scene, tmp_path):
    folders = [tmp_path / "growing" / name for name in scene.calibrated.names]
    for folder in folders:
        folder.mkdir(parents=True)
        (folder / "0006.png").write_bytes(b"old")
        (folder / "0007.png").write_bytes(PNG)
    coming = arrivals([scene], 1.0, [str(tmp_path / "growing")])
    frame = next(coming)
    assert frame.number == 7  # from the last that is there
    assert seen(frame) == [480, 480, 480]
    (folders[0] / "0008.png").write_bytes(PNG)
    (folders[2] / "0008.png").write_bytes(PNG)
    for folder in folders:
        (folder / "0009.png").write_bytes(PNG)
    assert seen(next(coming)) == [480, None, 480]  # the next frame is there, and one camera lacks this one
    assert seen(next(coming)) == [480, 480, 480]
    for folder, data in zip(folders, (PNG, PNG[:40], PNG), strict=True):
        (folder / "0010.png").write_bytes(data)
    assert seen(next(coming)) == [480, None, 480]  # one is half-written
    for folder in folders:
        (folder / "0015.png.part").write_bytes(b"being written")
        (folder / "0014.png").write_bytes(PNG)
    assert next(coming).number == 14  # numbers were left out
    for number in (15, 16, 17):
        for folder in folders:
            (folder / f"{number:04d}.png").write_bytes(PNG)
    assert next(coming).number == 16  # the other was two behind
    with pytest.raises(InputError, match="cam01: no such folder"):
        next(arrivals([scene], 1.0, [str(tmp_path)]))


def test_images_without_a_number_are_told(scene, tmp_path):
    for name in scene.calibrated.names:
        (tmp_path / name).mkdir()
        (tmp_path / name / f"{name}_0001.png").write_bytes(PNG)
    with pytest.raises(InputError, match=r"cam01_0001\.png: has a name that is no number; name images 0001\.png"):
        next(arrivals([scene], 1.0, [str(tmp_path)]))


def test_numbers_that_are_left_out_in_a_row_cost_little_time(scene, tmp_path):
    folders = [tmp_path / name for name in scene.calibrated.names]
    for folder in folders:
        folder.mkdir()
        (folder / "0001.png").write_bytes(PNG)
    coming = arrivals([scene], 1.0, [str(tmp_path)])
    assert next(coming).number == 1
    for folder in folders:
        (folder / "0004.png").write_bytes(PNG)
    begun = time.monotonic()
    assert next(coming).number == 4
    assert time.monotonic() - begun < 0.5


def test_label_images_are_split_into_people_and_what_may_be_in_front(scene, tmp_path):
    people = "[people.anna]\nlabel = 1\n[people.ben]\nlabel = 2\n[labels]\nthing = 3\n"
    (scene.directory / "scene.toml").write_text(SCENE.replace(CAMERAS, CAMERAS.replace("masks = ", "# ")) + people)
    labels = EMPTY.copy()
    labels[10:40, 24:40], labels[10:40, 40:50], labels[30:40, 20:30] = 1, 2, 3
    for name in scene.calibrated.names:
        (tmp_path / "growing" / name).mkdir(parents=True)
        cv2.imwrite(str(tmp_path / "growing" / name / "0001.png"), labels)
    both = load_scene(scene.directory, live=True)
    scenes = [both.of_person(name) for name in both.people]
    anna, ben = next(arrivals(scenes, 1.0, [str(tmp_path / "growing")])).seen
    assert anna.foreground.tolist() == [30 * 16 - 10 * 6] * 3
    assert ben.foreground.tolist() == [30 * 10] * 3
    for person, other in ((anna, ben), (ben, anna)):
        pixels = np.bitwise_count(person.hidden).sum(axis=(1, 2))
        assert pixels.tolist() == (other.foreground + 10 * 10).tolist()


class Capture:
    """A camera that shows an image unless it is switched off."""

    off: set[str]
    image: np.ndarray

    def __init__(self, address: str) -> None:
        self.address = address

    def read(self) -> tuple[bool, np.ndarray | None]:
        """An image, if there is one."""
        time.sleep(0.002)
        return (False, None) if self.address in Capture.off else (True, Capture.image)

    def release(self) -> None:
        """Let it go."""


@pytest.fixture
def cameras(monkeypatch) -> type[Capture]:
    """OpenCV's."""
    Capture.off, Capture.image = set(), SQUARE
    monkeypatch.setattr("cv2.VideoCapture", Capture)
    return Capture


def test_a_camera_that_stops_is_lost_and_comes_back(scene, cameras, monkeypatch):
    monkeypatch.setattr("mmocap_warp.streaming.arrivals._RETRY", 0.01)

    def until(*wanted: int | None) -> int:
        return next(frame.number for frame in coming if seen(frame) == [*wanted])

    coming = arrivals([scene], 1.0, ["one", "two", "three"])
    assert until(480, 480, 480) == 0
    cameras.off.add("two")
    lost = until(480, None, 480)
    cameras.off.clear()
    assert until(480, 480, 480) > lost
    coming.close()


def test_a_camera_that_never_sends(scene, cameras, monkeypatch):
    monkeypatch.setattr("mmocap_warp.streaming.arrivals._FIRST_IMAGE", 0.05)
    cameras.off.add("two")
    with pytest.raises(InputError, match="two: OpenCV gets no image from it"):
        next(arrivals([scene], 1.0, ["one", "two", "three"]))


def test_images_of_another_size_are_refused(scene, cameras):
    cameras.image = np.zeros((20, 30, 3), np.uint8)
    with pytest.raises(InputError, match="cam01: sends 30x20, the calibration says 64x48"):
        next(arrivals([scene], 1.0, ["0", "1", "2"]))


def test_pictures_are_subtracted_from_a_clean_plate_as_they_come(tmp_path, cameras):
    folder = make_scene(tmp_path)
    plate = np.full((*SIZE[::-1], 3), 90, np.uint8)
    picture = plate.copy()
    picture[10:40, 24:40] = (200, 40, 180)
    cv2.imwrite(str(folder / "plate.png"), plate)
    tables = CAMERAS
    for name in ("cam01", "cam02", "cam03"):
        tables = tables.replace(f'masks = "masks/{name}"', 'clean_plate = "plate.png"')
    tables += '[foreground]\nsource = "clean_plate"\nmin_area = 0.0\n'
    (folder / "scene.toml").write_text(SCENE.replace(CAMERAS, tables))
    cameras.image = picture
    coming = arrivals([load_scene(folder, live=True)], 1.0, ["0", "1", "2"])
    assert all(400 < pixels <= 480 for pixels in seen(next(coming)))  # cleaning rounds corners
    coming.close()


def test_sources_that_cannot_be(scene):
    with pytest.raises(InputError, match="2 sources for 3 cameras; give --source once for each of cam01, cam02"):
        arrivals([scene], 1.0, ["0", "1"])
    with pytest.raises(InputError, match=r"typo: is one of 1 sources for 3 cameras; .* or one folder or ZMQ address"):
        arrivals([scene], 1.0, ["typo"])
    with pytest.raises(InputError, match="is a file, and no camera; name it in the scene"):
        arrivals([scene], 1.0, [str(scene.path)] * 3)


@pytest.mark.parametrize("address", ["tcp://127.0.0.1", "tcp://127.0.0.1:port"])
def test_an_address_that_cannot_be_is_wrong_input(scene, address):
    pytest.importorskip("zmq")
    with pytest.raises(InputError, match=f"{address}: cannot be opened .*; name it as tcp://HOST:PORT"):
        next(arrivals([scene], 1.0, [address]))


def test_frames_that_a_program_publishes(scene):
    zmq = pytest.importorskip("zmq")
    with zmq.Context() as context, context.socket(zmq.PUB) as socket:
        address = f"tcp://127.0.0.1:{socket.bind_to_random_port('tcp://127.0.0.1')}"
        frames: list[Arrival] = []
        reader = threading.Thread(target=lambda: frames.extend(arrivals([scene], 1.0, [address])))
        reader.start()
        while not frames:  # until it listens
            socket.send_multipart([json.dumps({"frame": 7, "time": 1.5}).encode(), PNG, b"", PNG])
            time.sleep(0.01)
        while reader.is_alive():
            socket.send_multipart([b'{"end": true}'])
            time.sleep(0.01)
        assert (frames[0].number, frames[0].time, seen(frames[0])) == (7, 1.5, [480, None, 480])


HEAD = b'{"frame": 1, "time": 2}'


@pytest.mark.parametrize(
    ("parts", "why"),
    [
        ([b"{"], "Expecting property name"),
        ([b"[]"], "has no attribute"),
        ([b'{"frame": 1}', PNG], "'time'"),
        ([b'{"frame": Infinity, "time": 2}', PNG, PNG, PNG], "infinity"),
        ([b"[" * 100_000], "recursion"),
        ([HEAD], "images: 0, cameras: 3"),
        ([HEAD, PNG], "images: 1, cameras: 3"),
        ([HEAD, PNG, PNG, b"", PNG], "images: 4, cameras: 3"),
    ],
)
def test_messages_that_are_no_frame(scene, parts, why):
    zmq = pytest.importorskip("zmq")
    with zmq.Context() as context, context.socket(zmq.PUB) as socket:
        address = f"tcp://127.0.0.1:{socket.bind_to_random_port('tcp://127.0.0.1')}"
        errors: list[str] = []

        def read() -> None:
            try:
                list(arrivals([scene], 1.0, [address]))
            except InputError as error:
                errors.append(str(error))

        reader = threading.Thread(target=read)
        reader.start()
        while reader.is_alive():
            socket.send_multipart(parts)
            time.sleep(0.01)
        assert errors[0].startswith(f"{address}: sent what is no frame (")
        assert why in errors[0].partition("; send {")[0]


def test_what_a_program_publishes_of_another_size_and_after_it_began_anew(scene):
    zmq = pytest.importorskip("zmq")
    small = cv2.imencode(".png", np.zeros((20, 30), np.uint8))[1].tobytes()
    with zmq.Context() as context, context.socket(zmq.PUB) as socket:
        address = f"tcp://127.0.0.1:{socket.bind_to_random_port('tcp://127.0.0.1')}"
        numbers: list[int] = []
        errors: list[str] = []

        def read() -> None:
            try:
                for each in arrivals([scene], 1.0, [address]):
                    numbers.append(each.number)
            except InputError as error:
                errors.append(str(error))

        def publish(number: int, *images: bytes) -> None:
            socket.send_multipart([json.dumps({"frame": number, "time": 1.5}).encode(), *images])
            time.sleep(0.02)

        reader = threading.Thread(target=read)
        reader.start()
        while len(numbers) < 3:
            publish(7, PNG, PNG, PNG)
            publish(0, PNG, PNG, PNG)
        assert (np.diff(numbers) > 0).all()
        while reader.is_alive():
            publish(0, small, small, small)
        assert errors[0].startswith("cam01: sends 30x20, the calibration says")


def test_messages_without_their_package(scene, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "zmq", None)
    with pytest.raises(InputError, match=r'pip install "mmocap-warp\[live\]"'):
        next(arrivals([scene], 1.0, ["tcp://127.0.0.1:1"]))
