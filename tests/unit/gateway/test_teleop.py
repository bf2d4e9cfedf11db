"""Teleoperation over the WebSocket and by single moves: dead-man switch, refusals, lease."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from helios_client.commands.api_keys import add_key
from helios_core import proto as pb
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import LEASE, ROBOT_DESCRIPTION
from helios_gateway.bus_listener import RobotMonitor
from helios_gateway.robot_registry import RobotEndpoint, RobotRegistry
from helios_gateway.settings import Settings
from helios_gateway.web_app import create_app
from starlette.testclient import WebSocketDenialResponse

from tests.gateway_backend import Backend
from tests.gateway_home import description
from tests.support import wait_until

SOCKET = "ws://localhost/v1/robot/teleop"
AHEAD = {"forward": 1.0}
INSTRUCTION = "move the mug to the kitchen counter"


@contextmanager
def connect_driver(client: TestClient) -> Iterator[Any]:
    with client.websocket_connect(SOCKET) as socket:
        yield socket


def receive_until(socket: Any, holds: Callable[[dict], bool], hold: dict | None = None) -> dict:
    """Receive states until one fits; send `hold` again after each other state."""
    for _ in range(500):
        state = socket.receive_json()
        if holds(state):
            return state
        if hold is not None:
            socket.send_json(hold)
    raise AssertionError("no such state came")


def is_in(*names: str) -> Callable[[dict], bool]:
    return lambda state: state["state"] in names


def test_a_held_command_moves_the_robot_and_its_release_stops_the_robot(
    client: TestClient, backend: Backend
) -> None:
    with connect_driver(client) as socket:
        assert socket.receive_json() == {
            "state": "standing",
            "reason": "",
            "kind": "",
            "pose": None,
        }
        socket.send_json(AHEAD)
        driven = receive_until(socket, lambda s: s["pose"] is not None)
        assert driven["pose"]["x_m"] == pytest.approx(0.1)
        socket.send_json({})
        receive_until(socket, is_in("standing"))
        moved = backend.driving.kinds().count("forward")
        wait_until(lambda: backend.driving.kinds()[-1] == "observe", 60, "a last keyframe is taken")
        assert backend.driving.kinds().count("forward") == moved


def test_a_command_that_is_not_repeated_expires(client: TestClient, backend: Backend) -> None:
    with connect_driver(client) as socket:
        socket.send_json(AHEAD)
        receive_until(socket, is_in("driving"))
        receive_until(socket, is_in("standing"))
        moved = backend.driving.kinds().count("forward")
        other = pb.LeaseRequest(holder="planner")
        wait_until(lambda: _granted(backend, other), 60, "the lease is given back")
        assert backend.driving.kinds().count("forward") == moved > 0


def test_a_closed_connection_stops_the_robot_and_releases_the_lease(
    client: TestClient, backend: Backend
) -> None:
    with connect_driver(client) as socket:
        socket.send_json(AHEAD)
        wait_until(lambda: backend.driving.moves, 60, "it moves")
    wait_until(lambda: backend.driving.kinds()[-1] == "observe", 60, "a last keyframe is taken")
    other = pb.LeaseRequest(holder="planner")
    wait_until(lambda: _granted(backend, other), 60, "the lease is given back")


def _granted(backend: Backend, request: pb.LeaseRequest) -> bool:
    try:
        return backend.bus.call(LEASE, request, 1).token > 0
    except Exception:
        return False


def test_teleop_takes_a_keyframe_only_every_half_metre(
    client: TestClient, backend: Backend
) -> None:
    with connect_driver(client) as socket:
        socket.send_json(AHEAD)
        receive_until(socket, lambda s: (s["pose"] or {}).get("x_m", 0) > 1.55, AHEAD)
        socket.send_json({})
        wait_until(lambda: backend.driving.kinds()[-1] == "observe", 60, "a last keyframe is taken")
    since_m = 0.0
    for request in backend.driving.moves:
        ahead_m = request.action.forward.distance_m
        is_due = request.action.HasField("observe") or since_m + ahead_m > 0.5
        assert request.no_keyframe is not is_due
        since_m = 0.0 if is_due else since_m + ahead_m


def test_a_move_that_the_robot_refuses_is_reported_and_not_retried(
    client: TestClient, backend: Backend
) -> None:
    backend.driving.blocked = "blocked after 0.02 m; look, and go another way"
    with connect_driver(client) as socket:
        socket.send_json(AHEAD)
        said = receive_until(socket, is_in("blocked"))
        assert said["reason"] == backend.driving.blocked
        for _ in range(20):
            socket.send_json(AHEAD)
        socket.send_json({"forward": 1.0, "turn": 1.0})
        wait_until(lambda: "turn" in backend.driving.kinds(), 60, "it turns away")
        assert backend.driving.kinds().count("forward") == 1


@pytest.mark.parametrize("state", ["running", "paused"])
def test_teleop_is_refused_while_a_task_has_the_robot(
    client: TestClient, backend: Backend, state: str
) -> None:
    backend.submit(INSTRUCTION)
    backend.change_task("t1", state)
    with connect_driver(client) as socket:
        said = receive_until(socket, is_in("refused"))
        assert f"task t1 is {state} and has the robot" in said["reason"]
        assert said["kind"] == "conflict"
    answer = client.post("/v1/robot/drive", json={"forward_m": 0.2})
    assert (answer.status_code, "cancel it" in answer.json()["detail"]) == (409, True)
    assert backend.driving.moves == []


def test_a_refusal_lasts_until_the_command_is_released(
    client: TestClient, backend: Backend
) -> None:
    backend.submit(INSTRUCTION)
    backend.change_task("t1", "running")
    with connect_driver(client) as socket:
        receive_until(socket, is_in("refused"))
        socket.send_json(AHEAD)
        wait_until(lambda: backend.calls.count("list") > 1, 60, "it was asked again")
        backend.change_task("t1", "succeeded")
        for _ in range(5):
            socket.send_json(AHEAD)
        assert backend.driving.moves == []
        socket.send_json({})
        receive_until(socket, is_in("standing"))
        socket.send_json(AHEAD)
        receive_until(socket, is_in("driving"))


def test_a_stop_ends_teleop_with_its_reason(client: TestClient, backend: Backend) -> None:
    with connect_driver(client) as socket:
        socket.send_json(AHEAD)
        receive_until(socket, lambda s: s["pose"] is not None)
        client.post("/v1/robot/stop", json={"reason": "child on the floor"})
        said = receive_until(socket, is_in("refused"), AHEAD)
        assert "child on the floor" in said["reason"]
    with connect_driver(client) as socket:
        assert "child on the floor" in receive_until(socket, is_in("refused"))["reason"]
    answer = client.post("/v1/robot/drive", json={"turn_rad": 0.2})
    assert (answer.status_code, "child on the floor" in answer.json()["detail"]) == (409, True)


def test_only_one_client_drives_at_a_time(client: TestClient, backend: Backend) -> None:
    with connect_driver(client) as first, connect_driver(client) as second:
        let_go = threading.Event()

        def hold() -> None:
            while not let_go.wait(0.05):
                first.send_json(AHEAD)

        holder = threading.Thread(target=hold)
        holder.start()
        try:
            receive_until(first, lambda s: s["pose"] is not None)
            second.send_json(AHEAD)
            said = receive_until(second, is_in("refused"))
            assert "drives the robot" in said["reason"]
        finally:
            let_go.set()
            holder.join()


def test_a_robot_that_cannot_move_refuses_teleop(client: TestClient, backend: Backend) -> None:
    still = description()
    still.can_move = False
    backend.bus.publish(ROBOT_DESCRIPTION, still)
    with connect_driver(client) as socket:
        assert "offers no motion" in receive_until(socket, is_in("refused"))["reason"]
    answer = client.post("/v1/robot/drive", json={"forward_m": 0.2})
    assert (answer.status_code, "offers no motion" in answer.json()["detail"]) == (409, True)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ('{"forward": 2}', "forward is 2; wanted less than or equal to 1"),
        ('{"forwards": 1}', "forwards is not known here"),
        ('{"forward": NaN}', "forward is nan; wanted a finite number"),
        ("ahead", "it is no JSON"),
        (b"\xff", "it is no JSON"),
    ],
)
def test_an_invalid_command_is_reported_and_does_not_move_the_robot(
    client: TestClient, backend: Backend, wrong: str | bytes, said: str
) -> None:
    with connect_driver(client) as socket:
        (socket.send_text if isinstance(wrong, str) else socket.send_bytes)(wrong)
        state = receive_until(socket, is_in("refused"))
        assert state["reason"].startswith("the command is wrong: ")
        assert state["kind"] == "invalid"
        assert said in state["reason"]
        assert backend.driving.moves == []
        socket.send_json(AHEAD)
        receive_until(socket, is_in("driving"))


def test_a_single_move_is_made_and_its_result_is_returned(
    client: TestClient, backend: Backend
) -> None:
    answer = client.post("/v1/robot/drive", json={"forward_m": 0.3})
    assert answer.status_code == 200
    made = answer.json()
    assert (made["succeeded"], made["moved_m"], made["pose"]["x_m"]) == (True, 0.3, 0.3)
    [move] = backend.driving.moves
    assert not move.no_keyframe
    backend.driving.lease.release(backend.driving.lease.grant("planner"))  # the lease is free
    backend.driving.blocked = "blocked after 0.1 m"
    answer = client.post("/v1/robot/drive", json={"forward_m": 0.3}).json()
    assert (answer["succeeded"], answer["reason"]) == (False, "blocked after 0.1 m")


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({}, "forward_m is 0 and turn_rad is 0; send one of them"),
        ({"forward_m": 0.2, "turn_rad": 0.2}, "send one of them"),
        ({"forward_m": 3}, "forward_m is 3; wanted less than or equal to 0.5"),
        ({"forward_m": -0.2}, "this robot never drives back"),
        ({"turn_rad": 0.05}, "this robot makes moves of 0.1 to 0.6 rad at a time"),
    ],
)
def test_a_move_beyond_the_limits_is_refused(
    client: TestClient, backend: Backend, asked: dict, said: str
) -> None:
    coarse = description()
    coarse.min_turn_rad = 0.1
    backend.bus.publish(ROBOT_DESCRIPTION, coarse)
    answer = client.post("/v1/robot/drive", json=asked)
    assert (answer.status_code, backend.driving.moves) == (400, [])
    assert said in answer.json()["detail"]


def test_a_key_without_the_robot_scope_cannot_drive(
    hub: MemoryHub, live: RobotMonitor, backend: Backend, tmp_path: Path
) -> None:
    file = tmp_path / "keys.toml"
    look, drive = (
        {"authorization": f"Bearer {add_key(file, scope, scope)}"} for scope in ("task", "robot")
    )
    fleet = RobotRegistry({"robot": RobotEndpoint(MemoryBus(hub), live)})
    client = TestClient(create_app(fleet, Settings.load(["--keys", str(file)])), "http://localhost")
    assert client.post("/v1/robot/drive", json={"turn_rad": 0.2}, headers=look).status_code == 403
    with (
        pytest.raises(WebSocketDenialResponse) as denied,
        client.websocket_connect(SOCKET, headers=look),
    ):
        pass
    assert denied.value.status_code == 403
    with client.websocket_connect(SOCKET, headers=drive) as socket:
        assert socket.receive_json()["state"] == "standing"
        file.write_text("")
        socket.send_json(AHEAD)
        assert socket.receive()["code"] == 1008
    assert backend.driving.moves == []


def test_an_idle_teleop_socket_is_closed(
    hub: MemoryHub, live: RobotMonitor, backend: Backend
) -> None:
    fleet = RobotRegistry({"robot": RobotEndpoint(MemoryBus(hub), live)})
    quick = Settings.load(["--teleop-idle-s", "0.05"])
    with (
        TestClient(create_app(fleet, quick), "http://localhost") as client,
        connect_driver(client) as one,
    ):
        assert one.receive_json()["state"] == "standing"
        assert one.receive()["code"] == 1001


@pytest.mark.parametrize("send", ["send_text", "send_bytes"])
def test_an_empty_message_is_refused_and_the_connection_stays_usable(
    client: TestClient, backend: Backend, send: str
) -> None:
    with connect_driver(client) as socket:
        getattr(socket, send)("" if send == "send_text" else b"")
        assert "the command is wrong" in receive_until(socket, is_in("refused"))["reason"]
        socket.send_json({})
        socket.send_json(AHEAD)
        wait_until(lambda: backend.driving.moves, 60, "it moves")


def test_a_task_that_starts_between_the_check_and_the_lease_has_the_robot(
    client: TestClient, hub: MemoryHub, backend: Backend
) -> None:
    grant = backend.driving.lease.grant

    def lease(request: pb.LeaseRequest) -> pb.LeaseReply:
        if request.release_token:
            backend.driving.lease.release(request.release_token)
            return pb.LeaseReply()
        if not backend.tasks:
            backend.submit(INSTRUCTION)
            backend.change_task("t1", "running")
        return pb.LeaseReply(token=grant(request.holder))

    MemoryBus(hub).serve(LEASE, lease)
    answer = client.post("/v1/robot/drive", json={"forward_m": 0.3})
    assert answer.status_code == 409
    assert "task t1 is running and has the robot" in answer.json()["detail"]
    assert not backend.driving.moves
    assert grant("planner")  # the lease was released at once
