"""Frames over a socket: each one is answered, and an invalid one does not end the connection."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import pytest
from fastapi.testclient import TestClient
from helios_gateway.routes.frames import MOST_SENDERS
from starlette.testclient import WebSocketDenialResponse

from tests.unit.gateway.gateway_frames import (
    COLOR,
    META,
    SOCKET,
    Bridge,
    send,
)


def test_a_socket_answers_each_frame(client: TestClient, bridge: Bridge) -> None:
    with client.websocket_connect(SOCKET) as socket:
        for _ in range(3):
            send(socket)
            assert socket.receive_json()["integrated"]
        send(socket, depth=b"")
        assert socket.receive_json()["integrated"]
    depths = [request.frame.WhichOneof("depth") for request in bridge.requests]
    assert depths == ["compressed_depth"] * 3 + [None]


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda s: send(s, "{"), "meta is wrong"),
        (lambda s: send(s, color=b"no image"), "no JPEG or PNG"),
        (lambda s: s.send_bytes(COLOR), "where a frame's meta was due"),
    ],
)
def test_an_invalid_frame_gets_a_problem_and_the_socket_stays_open(
    client: TestClient, bridge: Bridge, spoil: Callable[[Any], None], said: str
) -> None:
    with client.websocket_connect(SOCKET) as socket:
        spoil(socket)
        problem = socket.receive_json()
        assert problem["status"] == 400
        assert said in problem["detail"]
        send(socket)
        assert socket.receive_json()["integrated"]


def test_a_truncated_frame_is_reported_and_the_next_frame_is_accepted(
    client: TestClient, bridge: Bridge
) -> None:
    with client.websocket_connect(SOCKET) as socket:
        socket.send_text(json.dumps(META))
        socket.send_bytes(COLOR)
        send(socket)
        assert "depth was due" in socket.receive_json()["detail"]
        assert socket.receive_json()["integrated"]


def test_the_number_of_open_sockets_is_limited(client: TestClient, bridge: Bridge) -> None:
    both = (SOCKET, SOCKET.replace("/v1/", "/v1/robots/robot/"))  # one limit for all addresses
    open_ones = [client.websocket_connect(both[i % 2]) for i in range(MOST_SENDERS)]
    for one in open_ones:
        one.__enter__()
    with (
        pytest.raises(WebSocketDenialResponse) as denied,
        client.websocket_connect(SOCKET),
    ):
        pass
    assert denied.value.status_code == 503
    assert "close one" in denied.value.json()["detail"]
    for one in open_ones:
        one.__exit__(None, None, None)
    with client.websocket_connect(SOCKET) as socket:
        send(socket)
        assert socket.receive_json()["integrated"]
