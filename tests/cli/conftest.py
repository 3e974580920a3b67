"""What tests of commands may ask for."""

from __future__ import annotations

import socket

import pytest


@pytest.fixture
def no_network(monkeypatch) -> None:
    """Whoever asks the network fails the test, whatever command it is."""

    def asked(*arguments: object) -> None:
        pytest.fail(f"the network was asked: {arguments}")

    for name in ("connect", "connect_ex", "sendto"):
        monkeypatch.setattr(socket.socket, name, asked)
    monkeypatch.setattr(socket, "getaddrinfo", asked)
