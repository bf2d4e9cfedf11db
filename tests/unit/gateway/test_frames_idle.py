"""Idle senders of frames: the connection is closed with a reason and its slot is freed."""

from __future__ import annotations

import contextlib
import json
import socket as sockets
from collections.abc import Iterator

import httpx
import pytest
from helios_core import proto as pb
from helios_core.memory_bus import MemoryBus
from helios_core.topics import PUSH
from helios_gateway.request_limits import MOST_LARGE
from helios_gateway.routes.frames import MOST_SENDERS
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect
from websockets.sync.connection import Connection

from tests.gateway_process import Served, served
from tests.support import wait_until
from tests.unit.gateway.gateway_frames import COLOR, DEPTH, META

IDLE_S = 2.0


@pytest.fixture
def gateway() -> Iterator[Served]:
    with served("--frame-idle-s", str(IDLE_S)) as out:
        taken = pb.PushReply(acks=[pb.Ack(service="map2d", part="occupancy", accepted=True)])
        MemoryBus(out.backend.hub).serve(PUSH, lambda _: taken)
        yield out


def open_socket(gateway: Served) -> Connection:
    return connect(f"ws://127.0.0.1:{gateway.port}/v1/frames/ws", open_timeout=60)


def frame_is_integrated(socket: Connection) -> bool:
    socket.send(json.dumps(META))
    socket.send(COLOR)
    socket.send(DEPTH)
    return json.loads(socket.recv(timeout=60)).get("integrated", False)


def has_free_slot(gateway: Served) -> bool:
    try:
        with open_socket(gateway) as socket:
            return frame_is_integrated(socket)
    except (InvalidStatus, ConnectionClosed):  # 503: all slots are in use; or it was idle
        return False


def test_an_idle_socket_gets_status_408_and_is_closed(gateway: Served) -> None:
    with open_socket(gateway) as socket:
        assert frame_is_integrated(socket)
        problem = json.loads(socket.recv(timeout=60))
        assert problem["status"] == 408
        assert f"no whole message came for {IDLE_S:g} s" in problem["detail"]
        with pytest.raises(ConnectionClosed) as closed:
            socket.recv(timeout=60)
    assert closed.value.rcvd is not None
    assert closed.value.rcvd.code == 1001
    assert "connect again" in closed.value.rcvd.reason


def test_a_socket_that_stops_within_a_frame_is_idle(gateway: Served) -> None:
    with open_socket(gateway) as socket:
        socket.send(json.dumps(META))
        assert json.loads(socket.recv(timeout=60))["status"] == 408


def test_idle_sockets_free_their_slots(gateway: Served) -> None:
    with contextlib.ExitStack() as idle:
        for _ in range(MOST_SENDERS):
            idle.enter_context(open_socket(gateway))
        wait_until(lambda: has_free_slot(gateway), 60, "a place is free")


def test_sockets_of_vanished_clients_free_their_slots(gateway: Served) -> None:
    """The client neither reads nor closes, like a shut laptop or a phone out of range."""
    request = (
        f"GET /v1/frames/ws HTTP/1.1\r\nHost: 127.0.0.1:{gateway.port}\r\n"
        "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
        "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
    ).encode()
    gone = []
    for _ in range(MOST_SENDERS):
        one = sockets.create_connection(("127.0.0.1", gateway.port))
        one.sendall(request)
        assert b"101" in one.recv(20)
        gone.append(one)
    wait_until(lambda: has_free_slot(gateway), 60, "a place is free")
    for one in gone:
        one.close()


def test_stalled_request_bodies_free_their_slots(
    gateway: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("helios_gateway.request_limits.STALL_S", IDLE_S)
    head = (
        f"POST /v1/frames HTTP/1.1\r\nHost: 127.0.0.1:{gateway.port}\r\n"
        "Content-Type: multipart/form-data; boundary=x\r\nContent-Length: 5000\r\n\r\n--x"
    ).encode()
    stalled = [sockets.create_connection(("127.0.0.1", gateway.port)) for _ in range(MOST_LARGE)]
    for one in stalled:
        one.sendall(head)

    def taken() -> bool:
        answer = httpx.post(
            f"{gateway.url}/v1/frames",
            data={"meta": json.dumps(META)},
            files={"color": COLOR, "depth": DEPTH},
            timeout=60,
        )
        return answer.status_code == 200

    wait_until(taken, 60, "a place is free")
    for one in stalled:
        one.settimeout(10)
        said = one.recv(4000)
        assert b" 408 " in said
        assert b"no byte of the body came for" in said
        one.close()
