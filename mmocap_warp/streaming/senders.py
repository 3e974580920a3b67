"""Packets to other programs, by the libraries that these use: ZMQ, VMC over OSC, and LSL."""

from __future__ import annotations

from urllib.parse import urlsplit

from mmocap_warp.errors import InputError, UsageError, missing_package
from mmocap_warp.streaming.packets import Packet, Sender

_UNSENT = 256  # packets that wait for a slow listener; it misses later ones


def open_sender(address: str) -> Sender:
    """Who is told at an address.

    Raises:
        UsageError: there is no such way.
        InputError: a package is missing, or the address cannot be had.
    """
    kind = urlsplit(address).scheme
    if kind in ("tcp", "ipc"):
        return ZmqSender(address)
    raise UsageError(f"--to {address} is no address: give tcp://HOST:PORT")


class ZmqSender:
    """Publishes packets as JSON, a message each.

    Raises:
        InputError: ``pyzmq`` is not installed, or the address is taken.
    """

    def __init__(self, address: str) -> None:
        try:
            import zmq
        except ImportError:
            raise missing_package(address, "pyzmq", "written", "live", "send to another address") from None
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.PUB)
        self._socket.setsockopt(zmq.SNDHWM, _UNSENT)
        try:
            self._socket.bind(address)
        except zmq.ZMQError as error:
            raise InputError(address, f"cannot be opened ({error})", "choose another port") from None

    def send(self, packet: Packet) -> None:
        """Publish it to those who listen."""
        self._socket.send(packet.json)

    def close(self) -> None:
        """Let the port go."""
        self._context.destroy(linger=0)
