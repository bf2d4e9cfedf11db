"""Tests the relay to the fake Spot."""

from __future__ import annotations

import socket
from contextlib import closing

from tests.fake_spot.wire import Wire
from tests.support import free_port


def test_a_failed_connection_leaves_the_relay_usable() -> None:
    target = free_port()
    with closing(Wire(target)) as wire:
        with socket.create_connection(("127.0.0.1", wire.port), timeout=10) as early:
            assert early.recv(1) == b""  # no server yet
        with (
            socket.create_server(("127.0.0.1", target)) as server,
            socket.create_connection(("127.0.0.1", wire.port), timeout=10) as near,
        ):
            server.settimeout(10)
            far, _ = server.accept()
            with far:
                far.sendall(b"x")
                assert near.recv(1) == b"x"
