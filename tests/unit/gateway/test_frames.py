"""Frames over HTTP: what the bridge is asked, what is answered, who may send them."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from fastapi.testclient import TestClient
from helios_bridge.pushed_frames import LONGEST_TURN_S
from helios_client.commands.api_keys import add_key
from helios_core import proto as pb
from helios_core.codec import frame_from_proto
from helios_core.geometry import se2_to_se3
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_gateway.bus_listener import RobotMonitor
from helios_gateway.request_limits import MOST_LARGE
from helios_gateway.robot_registry import RobotEndpoint, RobotRegistry
from helios_gateway.routes.frames import MOST_SENDERS
from helios_gateway.settings import Settings
from helios_gateway.uploaded_frames import push_response
from helios_gateway.web_app import create_app
from starlette.testclient import WebSocketDenialResponse

from tests.unit.gateway.gateway_frames import (
    HEIGHT,
    META,
    SOCKET,
    T_WORLD_CAM,
    WIDTH,
    Bridge,
    post,
    send,
)


def test_a_frame_reaches_the_bridge_as_it_was_meant(client: TestClient, bridge: Bridge) -> None:
    reported = {
        "stamp_ns": 5,
        "classes": ["mug"],
        "wait_s": 2,
        "world_epoch": 4,
        "robot_boot_id": "me",
    }
    answer = post(client, META | reported)
    assert answer.status_code == 200
    (request,) = bridge.requests
    assert (list(request.classes), request.wait_s) == (["mug"], 2.0)
    request.frame.T_world_base.CopyFrom(request.frame.T_world_cam)
    frame = frame_from_proto(request.frame)
    assert (frame.stamp_ns, frame.keyframe) == (5, True)
    assert (frame.id.robot_boot_id, frame.id.world_epoch) == ("me", 4)
    assert frame.color[0, 0].tolist() == [30, 20, 10]
    np.testing.assert_allclose(frame.depth_m, 1.5, atol=1e-6)
    np.testing.assert_allclose(frame.T_world_cam, T_WORLD_CAM, atol=1e-9)
    assert (frame.camera.fx, frame.camera.cy, frame.camera.width) == (14.0, 5.5, WIDTH)


def test_where_the_robot_stands_goes_on_if_it_is_reported(
    client: TestClient, bridge: Bridge
) -> None:
    post(client)
    assert not bridge.requests[0].frame.HasField("T_world_base")
    T_world_base = se2_to_se3(1.0, 2.0, 0.5)
    post(client, META | {"T_world_base": T_world_base.tolist()})
    frame = frame_from_proto(bridge.requests[1].frame)
    np.testing.assert_allclose(frame.T_world_base, T_world_base, atol=1e-9)


def test_a_file_says_what_it_is_whatever_its_name(client: TestClient, bridge: Bridge) -> None:
    jpeg = cv2.imencode(".jpg", np.zeros((HEIGHT, WIDTH, 3), np.uint8))[1].tobytes()
    post(client, color=("c.png", jpeg))
    frame = bridge.requests[0].frame
    assert (frame.compressed_color.format, frame.compressed_depth.format) == ("jpeg", "png")


def test_the_bridge_is_waited_for_as_long_as_it_may_take(
    client: TestClient, bridge: Bridge, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Frames before this one, then the maps."""
    waited: list[float] = []
    call = MemoryBus.call
    monkeypatch.setattr(
        MemoryBus, "call", lambda self, method, request, timeout_s:
        (waited.append(timeout_s), call(self, method, request, timeout_s))[1],
    )  # fmt: skip
    post(client, META | {"wait_s": 40})
    assert waited == [pytest.approx(40 + LONGEST_TURN_S, abs=10)]
    assert waited[0] > 40 + LONGEST_TURN_S


def test_places_are_given_back(client: TestClient, bridge: Bridge) -> None:
    for _ in range(MOST_LARGE + 1):
        assert post(client).status_code == 200
    for _ in range(MOST_SENDERS + 1):
        with client.websocket_connect(SOCKET) as socket:
            send(socket)
            assert socket.receive_json()["integrated"]


@pytest.mark.parametrize(("scope", "may"), [("", False), ("read", False), ("operate", True)])
def test_frames_need_a_key_that_may_operate(
    hub: MemoryHub, live: RobotMonitor, bridge: Bridge, tmp_path: Path, scope: str, may: bool
) -> None:
    file = tmp_path / "keys.toml"
    keys = {name: add_key(file, name, name) for name in ("read", "operate")}
    app = create_app(
        RobotRegistry({"robot": RobotEndpoint(MemoryBus(hub), live)}),
        Settings.load(["--keys", str(file)]),
    )
    header = {"authorization": f"Bearer {keys[scope]}"} if scope else {}
    client = TestClient(app, "http://localhost", headers=header)
    refused = 403 if scope else 401
    assert post(client).status_code == (200 if may else refused)
    if may:
        with client.websocket_connect(SOCKET) as socket:
            send(socket)
            assert socket.receive_json()["integrated"]
    else:
        with (
            pytest.raises(WebSocketDenialResponse) as denied,
            client.websocket_connect(SOCKET),
        ):
            pass
        assert denied.value.status_code == refused
    assert len(bridge.requests) == (2 if may else 0)


def test_the_answer_says_which_map_took_it(client: TestClient, bridge: Bridge) -> None:
    assert post(client).json() == {
        "id": "boot/0/7",
        "integrated": True,
        "maps": [
            {"map": "map2d/occupancy", "accepted": True, "reason": "", "version": 3,
             "update_ms": 0.0},
        ],
        "unanswered": [],
    }  # fmt: skip


def test_a_refusal_and_a_missing_answer_are_no_integration(
    client: TestClient, bridge: Bridge
) -> None:
    bridge.reply.acks[0].accepted, bridge.reply.acks[0].reason = False, "another world epoch"
    answer = post(client).json()
    assert not answer["integrated"]
    assert answer["maps"][0]["reason"] == "another world epoch"
    bridge.reply.ClearField("acks")
    bridge.reply.unanswered.append("map2d/occupancy")
    answer = post(client).json()
    assert not answer["integrated"]
    assert answer["unanswered"] == ["map2d/occupancy"]


YES, NO = pb.Ack(accepted=True), pb.Ack(reason="no")


@pytest.mark.parametrize(
    ("acks", "unanswered", "integrated"),
    [
        ([YES, YES], [], True),
        ([YES, NO], [], False),
        ([YES], ["map2d/value"], False),
        ([], [], False),  # nobody was waited for
    ],
)
def test_integrated_means_that_every_map_has_taken_it(
    acks: list[pb.Ack], unanswered: list[str], integrated: bool
) -> None:
    assert push_response(pb.PushReply(acks=acks, unanswered=unanswered)).integrated is integrated


def test_depth_in_other_units_becomes_metres(client: TestClient, bridge: Bridge) -> None:
    post(client, META | {"depth_scale_m": 0.0002})
    (request,) = bridge.requests
    request.frame.T_world_base.CopyFrom(request.frame.T_world_cam)
    np.testing.assert_allclose(frame_from_proto(request.frame).depth_m, 0.3, atol=1e-6)


def test_a_frame_without_depth_goes_on_without_it(client: TestClient, bridge: Bridge) -> None:
    assert post(client, depth=None).status_code == 200
    assert bridge.requests[0].frame.WhichOneof("depth") is None
