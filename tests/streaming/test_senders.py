"""Packets arrive with the frame's number and time, and what they say is where the joints are."""

from __future__ import annotations

import json
import socket
import sys
from collections.abc import Iterator
from contextlib import closing
from http.client import HTTPConnection

import numpy as np
import pytest
from live_packet import RIG, SUBJECT, free_port, packet
from synthetic import ring_rig

from mmocap_warp.body.model import Subject, joint_transforms
from mmocap_warp.body.shape_space import upright_base
from mmocap_warp.errors import InputError, UsageError
from mmocap_warp.rigging.shipped import load_body
from mmocap_warp.streaming.senders import Packet, open_sender
from mmocap_warp.tracking.live_smoothing import LiveFrame


def check(told: dict) -> None:
    """What JSON says of the packet."""
    known = packet()
    assert [told[name] for name in ("frame", "time", "smooth", "dropped", "status")] == [7, 2.5, False, 3, "partial"]
    assert told["iou"] == [0.91, None]
    assert told["joints"] == list(SUBJECT.body.skeleton.joints)
    np.testing.assert_allclose(told["place"], known.answer.joints[0], atol=1e-5)
    assert np.shape(told["turn"]) == (len(told["joints"]), 4)


def test_what_json_says():
    check(json.loads(packet().json))
    assert "person" not in packet().json
    assert json.loads(packet(person="ben").json)["person"] == "ben"


def test_turns_are_from_the_bind_pose():
    still = np.zeros((1, SUBJECT.body.skeleton.coordinates))
    world = joint_transforms(SUBJECT, still)[1]
    standing = LiveFrame(0, still, still, world, np.zeros((1, 1)), ("lost",))
    turn = Packet(standing, SUBJECT, 0.0, False, 0).values[:, 3:]
    np.testing.assert_allclose(np.abs(turn @ turn[0]), 1.0, atol=1e-6)  # every joint turns as the root does


@pytest.mark.parametrize(
    "address",
    [
        "file://a",
        "127.0.0.1",
        "ws://127.0.0.1",
        "vmc://host:port",
        "vmc://host:39539?smoth",
        "lsl://",
        "",
        "ws://127.0.0.1:99999",
        "ws://[::1",
    ],
)
def test_addresses_that_cannot_be(address):
    with pytest.raises(UsageError, match="is no address"):
        open_sender(address, {"": SUBJECT}, RIG, 30.0)


@pytest.mark.parametrize(
    ("address", "module"),
    [
        ("tcp://127.0.0.1:1", "zmq"),
        ("ws://127.0.0.1:1", "websockets.sync.server"),
        ("vmc://127.0.0.1:1", "pythonosc.udp_client"),
        ("lsl://here", "pylsl"),
    ],
)
def test_a_missing_package_names_the_extra(address, module, monkeypatch):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(InputError, match=r'pip install "mmocap-warp\[live\]"'):
        open_sender(address, {"": SUBJECT}, RIG, 30.0)


def test_zmq():
    zmq = pytest.importorskip("zmq")
    address = f"tcp://127.0.0.1:{free_port()}"
    with closing(open_sender(address, {"": SUBJECT}, RIG, 30.0)) as sender, zmq.Context() as context:
        with pytest.raises(InputError, match="cannot be opened"):
            open_sender(address, {"": SUBJECT}, RIG, 30.0)
        with context.socket(zmq.SUB) as listener:
            listener.subscribe(b"")
            listener.connect(address)
            while not listener.poll(10):
                sender.send(packet())
            check(json.loads(listener.recv()))


@pytest.fixture
def web() -> Iterator[tuple[int, object]]:
    """A port that is served, and its sender."""
    pytest.importorskip("websockets")
    port = free_port()
    with closing(open_sender(f"ws://127.0.0.1:{port}", {"": SUBJECT}, RIG, 30.0)) as sender:
        yield port, sender


def test_websocket(web):
    from websockets.sync.client import connect

    port, sender = web
    with connect(f"ws://127.0.0.1:{port}/") as listener:
        while True:
            sender.send(packet())
            try:
                check(json.loads(listener.recv(timeout=0.05)))
                break
            except TimeoutError:
                continue


def test_other_pages_may_not_listen(web):
    from websockets.exceptions import InvalidStatus
    from websockets.sync.client import connect

    address = f"ws://127.0.0.1:{web[0]}/"
    with pytest.raises(InvalidStatus, match="403"), connect(address, origin="http://elsewhere.example"):
        pass
    with connect(address, origin=f"http://127.0.0.1:{web[0]}"):
        pass


def test_the_page_is_served_and_may_connect_to_its_server_alone(web):
    connection = HTTPConnection("127.0.0.1", web[0])
    connection.request("GET", "/")
    answer = connection.getresponse()
    page = answer.read().decode()
    assert answer.headers["Content-Type"] == "text/html; charset=utf-8"
    assert "connect-src 'self'" in page
    assert "$" not in page.split("<body>")[1].split("<script>")[0].split('id="content"')[0]


def vmc_values(subject: Subject, up: str, sent: Packet) -> dict[str, tuple]:
    """What a listener gets of a packet, by bone."""
    pytest.importorskip("pythonosc")
    from pythonosc.osc_message import OscMessage

    with socket.socket(type=socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", 0))
        address = f"vmc://127.0.0.1:{listener.getsockname()[1]}?smooth"
        with closing(open_sender(address, {"": subject}, ring_rig(2, up=up), 30.0)) as sender:
            sender.send(packet(subject))  # not smoothed: not told
            sender.send(sent)
        messages = []
        while not messages or messages[-1].address != "/VMC/Ext/T":
            messages.append(OscMessage(listener.recv(1 << 16)))
    told = {each.params[0]: tuple(each.params[1:]) for each in messages if each.address == "/VMC/Ext/Bone/Pos"}
    return told | {each.address: tuple(each.params) for each in messages if each.address.startswith("/mmocap")}


def matrix(quaternion: tuple[float, ...]) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    return Rotation.from_quat(quaternion).as_matrix()


def test_vmc_puts_the_joints_where_they_are_in_unitys_axes():
    base = upright_base("+z")
    subject = Subject(load_body("adult_man"), base, np.zeros(60), {})
    skeleton = subject.body.skeleton
    pose = np.zeros(skeleton.coordinates)
    pose[:3], pose[3:] = (0.3, -0.2, 0.9), np.random.default_rng(0).uniform(-0.3, 0.3, skeleton.coordinates - 3)
    world = joint_transforms(subject, pose[None])[1]
    answer = LiveFrame(7, pose[None], pose[None], world, np.zeros((1, 2)), ("tracked",))
    told = vmc_values(subject, "+z", Packet(answer, subject, 2.5, True, 0))
    assert told["/mmocap/frame"] == (7, "2.5")
    # Each bone in its parent, as Unity's humanoid has them; a mirror is its own inverse.
    above = {"Spine": "Hips", "Chest": "Spine", "Neck": "Chest"}
    for side in ("Left", "Right"):
        above |= {f"{side}UpperArm": "Chest", f"{side}LowerArm": f"{side}UpperArm", f"{side}Hand": f"{side}LowerArm"}
        above |= {f"{side}UpperLeg": "Hips", f"{side}LowerLeg": f"{side}UpperLeg", f"{side}Foot": f"{side}LowerLeg"}
    placed = {"Hips": (np.array(told["Hips"][:3]), matrix(told["Hips"][3:]))}
    for bone, parent in above.items():
        place, turn = placed[parent]
        placed[bone] = place + turn @ told[bone][:3], turn @ matrix(told[bone][3:])
    own = {"Hips": "Root", "Neck": "Neck", "LeftHand": "LWrist", "RightFoot": "RAnkle", "RightLowerArm": "RElbow"}
    for bone, joint in own.items():
        x, y, z = answer.joints[0, skeleton.index(joint)]
        np.testing.assert_allclose(placed[bone][0], (-x, z, -y), atol=1e-5)


def test_vmc_has_a_port_for_each_person():
    pytest.importorskip("pythonosc")
    man = Subject(load_body("adult_man"), np.eye(3), np.zeros(60), {})
    with socket.socket(type=socket.SOCK_DGRAM) as first, socket.socket(type=socket.SOCK_DGRAM) as second:
        port = free_port()
        first.bind(("127.0.0.1", port))
        second.bind(("127.0.0.1", port + 1))
        second.settimeout(20)
        with closing(open_sender(f"vmc://127.0.0.1:{port}", {"anna": man, "ben": man}, RIG, 30.0)) as sender:
            sender.send(packet(man, person="ben"))
        assert b"/mmocap/frame" in second.recv(1 << 16)
        first.setblocking(False)
        with pytest.raises(BlockingIOError):
            first.recv(1 << 16)


def test_vmc_is_for_people():
    pytest.importorskip("pythonosc")
    fox = load_body("fox")
    animal = Subject(fox, np.eye(3), np.zeros(fox.skeleton.coordinates), {})
    with pytest.raises(InputError, match="VMC is for people"):
        open_sender("vmc://127.0.0.1:1", {"": animal}, RIG, 30.0)


@pytest.mark.nightly
def test_lsl():
    lsl = pytest.importorskip("pylsl")
    name = f"live{free_port()}"
    with closing(open_sender(f"lsl://{name}", {"": SUBJECT, "ben": SUBJECT}, RIG, 30.0)) as sender:
        assert lsl.resolve_byprop("name", f"{name}-ben-smooth", timeout=20)
        (found,) = lsl.resolve_byprop("name", f"{name}-", timeout=20)
        listener = lsl.StreamInlet(found)
        listener.open_stream(timeout=20)
        sender.send(packet(smooth=True))  # of the other stream
        sender.send(packet())
        values, seen = listener.pull_sample(timeout=20)
        labels = listener.info(timeout=20).get_channel_labels()
    joints = SUBJECT.body.skeleton.joints
    assert labels[:3] == ["frame", "time", f"{joints[0]}.x"]
    np.testing.assert_allclose(values[:5], [7, 2.5, *packet().answer.joints[0, 0]])
    assert len(values) == 2 + 7 * len(joints)
    assert seen < lsl.local_clock() - 1e6  # of 1970
