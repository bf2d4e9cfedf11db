"""Frames over HTTP: the request to the bridge, the answer, and the scope that they need."""

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


def test_a_frame_reaches_the_bridge_with_its_images_pose_and_ids(
    client: TestClient, bridge: Bridge
) -> None:
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


def test_the_base_pose_is_forwarded_only_if_it_is_sent(client: TestClient, bridge: Bridge) -> None:
    post(client)
    assert not bridge.requests[0].frame.HasField("T_world_base")
    T_world_base = se2_to_se3(1.0, 2.0, 0.5)
    post(client, META | {"T_world_base": T_world_base.tolist()})
    frame = frame_from_proto(bridge.requests[1].frame)
    np.testing.assert_allclose(frame.T_world_base, T_world_base, atol=1e-9)


def test_the_image_format_comes_from_the_content_and_not_the_file_name(
    client: TestClient, bridge: Bridge
) -> None:
    jpeg = cv2.imencode(".jpg", np.zeros((HEIGHT, WIDTH, 3), np.uint8))[1].tobytes()
    post(client, color=("c.png", jpeg))
    frame = bridge.requests[0].frame
    assert (frame.compressed_color.format, frame.compressed_depth.format) == ("jpeg", "png")


def test_the_call_timeout_covers_the_turn_and_the_wait_for_the_maps(
    client: TestClient, bridge: Bridge, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The bridge first handles the frames before this one, then waits for the maps."""
    waited: list[float] = []
    call = MemoryBus.call
    monkeypatch.setattr(
        MemoryBus,
        "call",
        lambda self, method, request, timeout_s: (
            waited.append(timeout_s),
            call(self, method, request, timeout_s),
        )[1],
    )
    post(client, META | {"wait_s": 40})
    assert waited == [pytest.approx(40 + LONGEST_TURN_S, abs=10)]
    assert waited[0] > 40 + LONGEST_TURN_S


def test_request_and_socket_slots_are_released(client: TestClient, bridge: Bridge) -> None:
    for _ in range(MOST_LARGE + 1):
        assert post(client).status_code == 200
    for _ in range(MOST_SENDERS + 1):
        with client.websocket_connect(SOCKET) as socket:
            send(socket)
            assert socket.receive_json()["integrated"]


@pytest.mark.parametrize(
    ("scope", "may"), [("", False), ("read", False), ("task", False), ("robot", True)]
)
def test_sending_frames_needs_the_robot_scope(
    hub: MemoryHub, live: RobotMonitor, bridge: Bridge, tmp_path: Path, scope: str, may: bool
) -> None:
    file = tmp_path / "keys.toml"
    keys = {name: add_key(file, name, name) for name in ("read", "task", "robot")}
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


def test_the_answer_lists_which_map_accepted_the_frame(client: TestClient, bridge: Bridge) -> None:
    assert post(client).json() == {
        "id": "boot/0/7",
        "integrated": True,
        "maps": [
            {
                "map": "map2d/occupancy",
                "accepted": True,
                "reason": "",
                "version": 3,
                "update_ms": 0.0,
            },
        ],
        "unanswered": [],
    }


def test_a_refused_or_unanswered_frame_is_not_integrated(
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
        ([], [], False),  # the bridge waited for no map
    ],
)
def test_integrated_is_true_only_if_every_map_accepted_the_frame(
    acks: list[pb.Ack], unanswered: list[str], integrated: bool
) -> None:
    assert push_response(pb.PushReply(acks=acks, unanswered=unanswered)).integrated is integrated


def test_depth_in_other_units_becomes_metres(client: TestClient, bridge: Bridge) -> None:
    post(client, META | {"depth_scale_m": 0.0002})
    (request,) = bridge.requests
    request.frame.T_world_base.CopyFrom(request.frame.T_world_cam)
    np.testing.assert_allclose(frame_from_proto(request.frame).depth_m, 0.3, atol=1e-6)


def test_a_frame_without_depth_is_forwarded_without_depth(
    client: TestClient, bridge: Bridge
) -> None:
    assert post(client, depth=None).status_code == 200
    assert bridge.requests[0].frame.WhichOneof("depth") is None
