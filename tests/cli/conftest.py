"""What tests of commands may ask for."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest
from moving_figure import write_moving_figure

from mmocap_warp import cli
from mmocap_warp.cli import console


@pytest.fixture
def no_network(monkeypatch) -> None:
    """Whoever asks the network fails the test, whatever command it is."""

    def asked(*arguments: object) -> None:
        pytest.fail(f"the network was asked: {arguments}")

    for name in ("connect", "connect_ex", "sendto"):
        monkeypatch.setattr(socket.socket, name, asked)
    monkeypatch.setattr(socket, "getaddrinfo", asked)


@pytest.fixture(scope="module")
def scene(tmp_path_factory) -> Path:
    return write_moving_figure(tmp_path_factory.mktemp("recording"))


@pytest.fixture(scope="module")
def result(scene) -> Path:
    """The scene, tracked once."""
    path = scene.parent / "result.usdc"
    assert cli.main(["track", str(scene), "-o", str(path), "--quiet", "--seed", "3"]) == console.OK
    return path
