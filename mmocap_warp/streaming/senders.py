"""Packets to other programs, by the libraries that these use. No sender waits for those who listen."""

import json
import queue
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from itertools import count
from typing import Any
from urllib.parse import urlsplit

import numpy as np

from mmocap_warp.body.model import Subject
from mmocap_warp.body.rotations import quarter_turn, quaternions, transposed
from mmocap_warp.cameras.rig import CameraRig
from mmocap_warp.display.chart import COLOURS, colour_rules
from mmocap_warp.display.overlay import Look
from mmocap_warp.display.page.page_content import body_content, look_content
from mmocap_warp.display.page.viewer import embedded, filled, resource
from mmocap_warp.errors import UsageError, input_errors, needs_package
from mmocap_warp.formats.exports.rigs import RIGS, rest_pose, rig_names
from mmocap_warp.scene.mask_writing import TINTS
from mmocap_warp.tracking.live_smoothing import LiveFrame

_HERE = "mmocap_warp.streaming"
_UNSENT = 256  # packets that wait for a slow listener; it misses later ones


@dataclass(frozen=True, eq=False)
class Packet:
    """An answer to a frame, of its first run."""

    answer: LiveFrame  # what was found
    subject: Subject  # whose body that is
    time: float  # when the frame was seen, in seconds since 1970
    smooth: bool  # whether frames after it had a say
    dropped: int  # frames that were dropped so far
    person: str = ""  # the name of the one of several people whose body that is

    @cached_property
    def world(self) -> np.ndarray:
        """(joint, 4, 4) of the joints in the world, turned from the body's bind pose [m]."""
        world = self.answer.world[0].copy()
        world[:, :3, :3] = world[:, :3, :3] @ transposed(self.subject.body.skeleton.frame.astype(float))
        return world

    @cached_property
    def values(self) -> np.ndarray:
        """(joint, 7) the same as x, y, z [m] and quaternions x, y, z, w."""
        return np.concatenate([self.world[:, :3, 3], quaternions(self.world[:, :3, :3])], axis=1)

    @cached_property
    def json(self) -> str:
        """As ZMQ and WebSocket send it."""
        values: dict[str, Any] = {name: getattr(self, name) for name in ("time", "smooth", "dropped")}
        values |= {"frame": self.answer.number, "status": self.answer.status[0]}
        values |= {"person": self.person} if self.person else {}
        values |= {"joints": self.subject.body.skeleton.joints, "place": self.values[:, :3].round(5).tolist()}
        iou = [None if each != each else each for each in self.answer.iou[0].round(4).tolist()]
        return json.dumps(values | {"turn": self.values[:, 3:].round(6).tolist(), "iou": iou}, separators=(",", ":"))


def open_sender(address: str, people: Mapping[str, Subject], rig: CameraRig, fps: float) -> Any:
    """A sender of people's packets to those who listen at an address: ``send(packet)`` sends, ``close()`` ends it.

    Raises:
        UsageError: there is no such kind of address.
        InputError: a package is missing, the address is taken, or a body is none that the listeners know.
    """
    try:
        parts = urlsplit(address)
        host, port = parts.hostname or "127.0.0.1", parts.port
    except ValueError as error:
        raise UsageError(f"--to {address} is no address: {error}") from None
    if parts.scheme in ("tcp", "ipc"):
        return _Zmq(address)
    if parts.scheme == "ws" and port:
        return _Web(address, host, port, people, rig)
    # A listener of VMC knows one body: the next has the next port.
    if parts.scheme == "vmc" and port and parts.query in ("", "smooth"):
        ports = zip(count(port), people.items())
        return _Each({name: _Vmc(address, host, own, subject, rig.up) for own, (name, subject) in ports})
    if parts.scheme == "lsl" and parts.netloc:
        streams = {name: f"{address[6:]}-{name}" if len(people) > 1 else address[6:] for name in people}
        return _Each({name: _Lsl(address, stream, people[name], fps) for name, stream in streams.items()})
    kinds = "tcp://HOST:PORT (ZMQ), ws://HOST:PORT (a page), vmc://HOST:PORT and lsl://NAME"
    raise UsageError(f"--to {address} is no address; give one of {kinds}")


class _Each:
    """Sends each person's packets by a sender of their own."""

    def __init__(self, senders: Mapping[str, Any]) -> None:
        self._senders = senders

    def send(self, packet: Packet) -> None:
        self._senders[packet.person].send(packet)

    def close(self) -> None:
        for sender in self._senders.values():
            sender.close()


def _package(address: str, module: str, package: str) -> Any:
    with needs_package(address, package, "opened", "live", "leave that address out"):
        return import_module(module)


class _Zmq:
    """Publishes packets as JSON, a message each."""

    def __init__(self, address: str) -> None:
        zmq = _package(address, "zmq", "pyzmq")
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.PUB)
        self._socket.set_hwm(_UNSENT)
        with input_errors(address, "cannot be opened ({error})", "choose another port", zmq.ZMQError):
            self._socket.bind(address)

    def send(self, packet: Packet) -> None:
        self._socket.send_string(packet.json)

    def close(self) -> None:
        self._context.destroy(linger=1000)


class _Web:
    """Serves a page that draws the body, and packets as JSON over WebSocket to it and to programs."""

    def __init__(self, address: str, host: str, port: int, people: Mapping[str, Subject], rig: CameraRig) -> None:
        server = _package(address, "websockets.sync.server", "websockets")
        self._gone = import_module("websockets.exceptions").ConnectionClosed
        self._page, self._listeners, self._closed = _page(people, rig), set[queue.Queue[str]](), False
        with input_errors(address, "cannot be opened ({error})", "choose another host or port", OSError):
            self._server = server.serve(self._listen, host, port, process_request=self._answer, compression=None)
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    def send(self, packet: Packet) -> None:
        for waiting in tuple(self._listeners):
            with suppress(queue.Full):
                waiting.put_nowait(packet.json)

    def close(self) -> None:
        self._closed = True
        self._server.shutdown()

    def _listen(self, connection: Any) -> None:
        waiting: queue.Queue[str] = queue.Queue(_UNSENT)
        self._listeners.add(waiting)
        with suppress(self._gone):
            while not self._closed:
                with suppress(queue.Empty):
                    connection.send(waiting.get(timeout=0.5))
        self._listeners.remove(waiting)

    def _answer(self, connection: Any, request: Any) -> Any:
        """The page, to whoever asks for no WebSocket; a WebSocket to programs and to this page, not to other pages."""
        origin = request.headers.get("Origin")
        if "Upgrade" in request.headers:
            is_other = origin is not None and urlsplit(origin).netloc != request.headers.get("Host")
            return connection.respond(403, "open this server's own page\n") if is_other else None
        response = connection.respond(200, self._page)
        del response.headers["Content-Type"]
        response.headers["Content-Type"] = "text/html; charset=utf-8"
        return response


def _page(people: Mapping[str, Subject], rig: CameraRig) -> str:
    """The page that draws what is sent."""
    cameras = [{what: getattr(rig, what)[k].tolist() for what in ("K", "R", "t", "size")} for k in range(len(rig))]
    looks = [look_content(Look(name, TINTS[n % len(TINTS)])) for n, name in enumerate(people)]
    several = looks if len(people) > 1 else [{}]
    shown = [look | {"body": body_content(each.body)} for look, each in zip(several, people.values(), strict=True)]
    content = {"people": shown, "cameras": cameras, "names": rig.names, "colours": COLOURS}
    scripts = [resource("mmocap_warp.display.page", f"{name}.js") for name in ("data", "pinhole", "stage", "layers")]
    script = "\n".join([*scripts, resource(_HERE, "live.js")])
    style = colour_rules(":root") + resource("mmocap_warp.display.page", "page.css")
    shown_content = embedded(content | {"up": rig.up_vector.tolist()})
    template = resource(_HERE, "live.html")
    return filled(template, title="Live", script=script, style=style, connects="'self'", content=shown_content)


class _Vmc:
    """Sends a person's bones by the Virtual Motion Capture protocol, as Unity has them: left-handed, y up."""

    def __init__(self, address: str, host: str, port: int, subject: Subject, up: str) -> None:
        client = _package(address, "pythonosc.udp_client", "python-osc")
        with input_errors(address, "cannot be opened ({error})", "choose another host", OSError):
            self._client = client.SimpleUDPClient(host, port, allow_broadcast=True)
        skeleton = subject.body.skeleton
        with input_errors(address, "{error}", "VMC is for people: send to another address", ValueError):
            rig_names(subject.body, "unity")
        self._bones = [(skeleton.index(joint), name) for joint, name in RIGS["unity"].names.items()]
        turn, rest = rest_pose(subject.body, RIGS["unity"])
        self._from_rest, self._parent = transposed(turn), np.array(skeleton.parent)
        self._offset, self._upright = rest - rest[self._parent], quarter_turn(up, "+y")
        self._smooth, self._begin = address.endswith("?smooth"), 0.0

    def send(self, packet: Packet) -> None:
        if packet.smooth != self._smooth:
            return
        self._begin = self._begin or packet.time
        turned = self._upright @ packet.world[:, :3, :3] @ self._from_rest
        place, own = self._offset.copy(), transposed(turned[self._parent]) @ turned
        place[0], own[0] = self._upright @ packet.world[0, :3, 3], turned[0]
        values = np.concatenate([place, quaternions(own)], axis=1) * [-1, 1, 1, 1, -1, -1, 1]  # x is mirrored
        send = self._client.send_message
        with suppress(OSError):  # the network may be away for a while
            send("/mmocap/frame", [packet.answer.number, str(packet.time)])
            send("/VMC/Ext/Root/Pos", ["root", *(0.0,) * 6, 1.0])
            for joint, name in self._bones:
                send("/VMC/Ext/Bone/Pos", [name, *values[joint].tolist()])
            send("/VMC/Ext/OK", 1)
            send("/VMC/Ext/T", packet.time - self._begin)

    def close(self) -> None:
        pass


class _Lsl:
    """Two streams of Lab Streaming Layer, NAME and NAME-smooth: number, time, and seven values of each joint."""

    def __init__(self, address: str, stream: str, subject: Subject, fps: float) -> None:
        lsl, self._outlets = _package(address, "pylsl", "pylsl"), []
        axes = ("x", "y", "z", "qx", "qy", "qz", "qw")
        labels = ["frame", "time", *(f"{joint}.{axis}" for joint in subject.body.skeleton.joints for axis in axes)]
        for name in (stream, f"{stream}-smooth"):
            info = lsl.StreamInfo(name, "MoCap", len(labels), fps, lsl.cf_double64, f"mmocap {name}")
            info.set_channel_labels(labels)
            self._outlets.append(lsl.StreamOutlet(info))
        self._clock = lsl.local_clock

    def send(self, packet: Packet) -> None:
        seen = self._clock() - (time.time() - packet.time)
        self._outlets[packet.smooth].push_sample([packet.answer.number, packet.time, *packet.values.ravel()], seen)

    def close(self) -> None:
        self._outlets = []
