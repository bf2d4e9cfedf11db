"""A reader of events that does not read is disconnected and counted; its queue stays bounded."""

from __future__ import annotations

import socket
from urllib.parse import urlsplit

import pytest
from helios_core import proto as pb
from helios_core.topics import DECISION

from tests.gateway_process import Served, served
from tests.support import LOOPBACK, wait_until

BACKLOG = 50
WEBSOCKET = (
    "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
)
DECISION_OF = pb.Decision(task_id="a", why="x" * 50_000)


@pytest.mark.parametrize(
    ("path", "headers"), [("/v1/events", ""), ("/v1/events/ws", WEBSOCKET)], ids=["http", "ws"]
)
def test_a_reader_that_does_not_read_is_dropped_with_a_counter(
    monkeypatch: pytest.MonkeyPatch, path: str, headers: str
) -> None:
    monkeypatch.setattr("helios_gateway.bus_listener.BACKLOG", BACKLOG)
    with served() as stack:
        events = next(iter(stack.gateway.robots.robots.values())).monitor.events
        deaf = _connected(stack, path, headers)
        wait_until(lambda: events.viewers == 1, 60, "it watches")
        sent = 0
        while not events.dropped:  # the buffers of the system take some megabytes first
            stack.backend.bus.publish(DECISION, DECISION_OF)
            sent += 1
            assert sent < 5000
            assert events.longest_queue <= 2 * BACKLOG + 1
        wait_until(lambda: events.viewers == 0, 60, "its stream has ended")
        figures = LOOPBACK.get(f"{stack.url}/metrics").text
        assert 'helios_event_viewers_dropped_total{robot="robot"} 1.0' in figures
        assert 'helios_event_queue{robot="robot"} 0.0' in figures
        deaf.close()


def _connected(stack: Served, path: str, headers: str) -> socket.socket:
    deaf = socket.socket()
    deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    deaf.connect(("127.0.0.1", urlsplit(stack.url).port))
    deaf.sendall(f"GET {path} HTTP/1.1\r\nHost: localhost\r\n{headers}\r\n".encode())
    return deaf
