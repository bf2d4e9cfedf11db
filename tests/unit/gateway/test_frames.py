"""Frames over HTTP and WebSocket: what the bridge is asked, what is answered, what is refused."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from fastapi.testclient import TestClient
from helios_bridge.push import LONGEST_TURN_S
from helios_client.keys import add_key
from helios_core import proto as pb
from helios_core.codec import frame_from_proto
from helios_core.errors import Conflict, InvalidInput
from helios_core.geometry import camera_on_base, se2_to_se3
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import PUSH
from helios_gateway.app import create_app
from helios_gateway.fleet import Fleet, Served
from helios_gateway.frames import push_request, read_meta, taken
from helios_gateway.limits import MOST_LARGE
from helios_gateway.live import Live
from helios_gateway.routes_frames import MOST_SENDERS
from helios_gateway.settings import Settings
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from starlette.testclient import WebSocketDenialResponse

SOCKET = "ws://localhost/v1/frames/ws"
WIDTH, HEIGHT = 16, 12
T_WORLD_CAM = camera_on_base(se2_to_se3(1.0, 2.0, 0.5), 1.2, 0.3)
META = {"K": [14.0, 0, 7.5, 0, 14.0, 5.5, 0, 0, 1], "T_world_cam": T_WORLD_CAM.tolist()}


def png(pixels: NDArray[Any]) -> bytes:
    return cv2.imencode(".png", pixels)[1].tobytes()


COLOR = png(np.full((HEIGHT, WIDTH, 3), (10, 20, 30), np.uint8))  # blue, green, red
DEPTH = png(np.full((HEIGHT, WIDTH), 1500, np.uint16))
DEEP = png(np.full((HEIGHT, WIDTH, 3), 1500, np.uint16))


class Bridge:
    """Takes every frame; the maps answer as `reply` says."""

    def __init__(self, hub: MemoryHub) -> None:
        self.requests: list[pb.PushRequest] = []
        self.reply = pb.PushReply(
            id=pb.FrameId(robot_boot_id="boot", seq=7),
            acks=[pb.Ack(service="map2d", part="occupancy", accepted=True, version=3)],
        )
        MemoryBus(hub).serve(PUSH, self._push)

    def _push(self, request: pb.PushRequest) -> pb.PushReply:
        self.requests.append(request)
        return self.reply


@pytest.fixture
def bridge(hub: MemoryHub) -> Bridge:
    return Bridge(hub)


def post(client: TestClient, meta: object = META, depth: bytes | None = DEPTH, **more: Any):
    files: dict[str, Any] = {"color": ("c.png", COLOR)} | more
    if depth is not None:
        files["depth"] = ("d.png", depth)
    data = {"meta": meta if isinstance(meta, str) else json.dumps(meta)}
    return client.post("/v1/frames", data=data, files=files)


def test_a_frame_reaches_the_bridge_as_it_was_meant(client: TestClient, bridge: Bridge) -> None:
    told = {"stamp_ns": 5, "classes": ["mug"], "wait_s": 2, "world_epoch": 4, "robot_boot_id": "me"}
    answer = post(client, META | told)
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


def test_where_the_robot_stands_goes_on_if_it_is_told(client: TestClient, bridge: Bridge) -> None:
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
    hub: MemoryHub, live: Live, bridge: Bridge, tmp_path: Path, scope: str, may: bool
) -> None:
    file = tmp_path / "keys.toml"
    keys = {name: add_key(file, name, name) for name in ("read", "operate")}
    app = create_app(
        Fleet({"robot": Served(MemoryBus(hub), live)}), Settings.load(["--keys", str(file)])
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
    assert taken(pb.PushReply(acks=acks, unanswered=unanswered)).integrated is integrated


def test_depth_in_other_units_becomes_metres(client: TestClient, bridge: Bridge) -> None:
    post(client, META | {"depth_scale_m": 0.0002})
    (request,) = bridge.requests
    request.frame.T_world_base.CopyFrom(request.frame.T_world_cam)
    np.testing.assert_allclose(frame_from_proto(request.frame).depth_m, 0.3, atol=1e-6)


def test_a_frame_without_depth_goes_on_without_it(client: TestClient, bridge: Bridge) -> None:
    assert post(client, depth=None).status_code == 200
    assert bridge.requests[0].frame.WhichOneof("depth") is None


@pytest.mark.parametrize(
    ("meta", "said"),
    [
        ("{", "meta is wrong"),
        ("[]", "K and T_world_cam"),
        ({}, "K: Field required"),
        (META | {"K": [1, 2]}, "K: "),
        (META | {"K": [525.0, 0, 0, 0, 525.0, 0, 319.5, 239.5, 1]}, "row by row"),
        (META | {"K": [525.0, 3, 319.5, 0, 525.0, 239.5, 0, 0, 1]}, "without skew"),
        (META | {"T_world_cam": np.eye(3).tolist()}, "T_world_cam"),
        (META | {"T_world_cam": np.diag([1, 1, -1, 1]).tolist()}, "no rigid transform"),
        (META | {"T_world_base": np.zeros((4, 4)).tolist()}, "T_world_base is no rigid"),
        (META | {"wait_s": 1e9}, "wait_s"),
        (META | {"depth_scale_m": 0}, "depth_scale_m"),
        (META | {"stamp_ns": 2**70}, "stamp_ns"),
        (META | {"world_epoch": -1}, "world_epoch"),
        (META | {"intrinsics": []}, "intrinsics"),
    ],
)
def test_wrong_words_about_a_frame_are_refused_by_name(
    client: TestClient, bridge: Bridge, meta: object, said: str
) -> None:
    answer = post(client, meta)
    assert answer.status_code == 400
    assert answer.headers["content-type"] == "application/problem+json"
    assert said in answer.json()["detail"]
    assert bridge.requests == []


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"color": ("c.png", b"")}, "color is 0 bytes"),
        ({"color": ("c.png", b"no image at all")}, "no JPEG or PNG"),
        ({"color": ("c.png", DEPTH)}, "color is a PNG of 16 bit a channel; send 8 bit"),
        ({"color": ("c.png", DEEP)}, "color is a PNG of 16 bit a channel; send 8 bit"),
    ],
)
def test_what_is_no_image_is_refused(
    client: TestClient, bridge: Bridge, more: dict[str, Any], said: str
) -> None:
    answer = post(client, **more)
    assert answer.status_code == 400
    assert answer.headers["content-type"] == "application/problem+json"
    assert said in answer.json()["detail"]
    assert bridge.requests == []


def test_a_grey_image_of_8_bit_is_a_colour_image(client: TestClient, bridge: Bridge) -> None:
    grey = png(np.full((HEIGHT, WIDTH), 90, np.uint8))
    assert post(client, color=("c.png", grey)).status_code == 200


def test_a_missing_part_is_named(client: TestClient, bridge: Bridge) -> None:
    answer = client.post("/v1/frames", data={"meta": json.dumps(META)})
    assert answer.status_code == 400
    assert "color" in answer.json()["detail"]
    answer = client.post("/v1/frames", json=META)
    assert answer.status_code == 400


def test_a_robot_that_takes_no_frames_says_so(client: TestClient, hub: MemoryHub) -> None:
    assert post(client).status_code == 503

    def refuse(_: pb.PushRequest) -> pb.PushReply:
        raise Conflict("the robot 'Spot' has a camera of its own")

    MemoryBus(hub).serve(PUSH, refuse)
    answer = post(client)
    assert answer.status_code == 409
    assert "camera of its own" in answer.json()["detail"]


def test_a_body_above_the_limit_is_refused_and_one_above_that_of_others_taken(
    client: TestClient, bridge: Bridge
) -> None:
    large = png(np.random.default_rng(0).integers(0, 255, (300, 400, 3), np.uint8))
    assert len(large) > 65536
    assert post(client, depth=None, color=("c.png", large)).status_code == 200
    answer = post(client, color=("c.png", bytes(17_000_000)))
    assert answer.status_code == 413
    assert "16000000" in answer.json()["detail"]


def test_more_frames_at_once_than_are_held_are_told_to_wait(
    client: TestClient, bridge: Bridge, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("helios_gateway.limits.MOST_LARGE", 0)
    answer = post(client)
    assert answer.status_code == 503
    assert answer.headers["retry-after"] == "1"
    assert MOST_LARGE > 1


@given(st.one_of(st.binary(max_size=300), st.binary(max_size=300).map(lambda b: COLOR[:40] + b)))
@settings(deadline=None, max_examples=100)
def test_no_bytes_as_images_are_more_than_a_typed_error(data: bytes) -> None:
    for scale in (0.001, 0.0002):
        meta = read_meta(json.dumps(META | {"depth_scale_m": scale}))
        for color, depth in ((data, DEPTH), (COLOR, data)):
            with contextlib.suppress(InvalidInput):
                request = push_request(meta, color, depth)
                request.frame.T_world_base.CopyFrom(request.frame.T_world_cam)
                frame_from_proto(request.frame)


def send(socket: Any, meta: object = META, color: bytes = COLOR, depth: bytes = DEPTH) -> None:
    socket.send_text(meta if isinstance(meta, str) else json.dumps(meta))
    socket.send_bytes(color)
    socket.send_bytes(depth)


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
def test_a_wrong_frame_is_answered_by_a_problem_and_the_socket_goes_on(
    client: TestClient, bridge: Bridge, spoil: Callable[[Any], None], said: str
) -> None:
    with client.websocket_connect(SOCKET) as socket:
        spoil(socket)
        problem = socket.receive_json()
        assert problem["status"] == 400
        assert said in problem["detail"]
        send(socket)
        assert socket.receive_json()["integrated"]


def test_a_frame_cut_short_by_the_next_is_told_and_the_next_taken(
    client: TestClient, bridge: Bridge
) -> None:
    with client.websocket_connect(SOCKET) as socket:
        socket.send_text(json.dumps(META))
        socket.send_bytes(COLOR)
        send(socket)
        assert "depth was due" in socket.receive_json()["detail"]
        assert socket.receive_json()["integrated"]


def test_so_many_sockets_and_no_more_until_one_is_closed(
    client: TestClient, bridge: Bridge
) -> None:
    open_ones = [client.websocket_connect(SOCKET) for _ in range(MOST_SENDERS)]
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
