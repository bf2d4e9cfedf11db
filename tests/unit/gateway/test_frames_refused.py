"""Frames over HTTP that are refused: for a field, for their size or by the kind of robot."""

from __future__ import annotations

import contextlib
import json
from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient
from helios_core import proto as pb
from helios_core.codec import frame_from_proto
from helios_core.errors import Conflict, InvalidInput
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import PUSH
from helios_gateway.request_limits import MOST_LARGE
from helios_gateway.uploaded_frames import push_request, read_meta
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.unit.bridge.bridge_push_stage import Rig, pushed
from tests.unit.gateway.gateway_frames import (
    COLOR,
    DEEP,
    DEPTH,
    HEIGHT,
    META,
    WIDTH,
    Bridge,
    png,
    post,
)


@pytest.mark.parametrize(
    ("meta", "said"),
    [
        ("{", "meta is wrong"),
        ("[]", "K and T_world_cam"),
        ({}, "K is missing; send it"),
        (META | {"K": [1, 2]}, "K is [1, 2]; list should have at least 9 items"),
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
def test_invalid_frame_metadata_is_refused_with_the_field_name(
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
def test_an_invalid_colour_image_is_refused(
    client: TestClient, bridge: Bridge, more: dict[str, Any], said: str
) -> None:
    answer = post(client, **more)
    assert answer.status_code == 400
    assert answer.headers["content-type"] == "application/problem+json"
    assert said in answer.json()["detail"]
    assert bridge.requests == []


def test_an_8_bit_grey_image_is_accepted_as_colour(client: TestClient, bridge: Bridge) -> None:
    grey = png(np.full((HEIGHT, WIDTH), 90, np.uint8))
    assert post(client, color=("c.png", grey)).status_code == 200


def test_a_missing_part_is_named(client: TestClient, bridge: Bridge) -> None:
    answer = client.post("/v1/frames", data={"meta": json.dumps(META)})
    assert answer.status_code == 400
    assert "color" in answer.json()["detail"]
    answer = client.post("/v1/frames", json=META)
    assert answer.status_code == 400


def test_a_robot_with_its_own_camera_refuses_frames(client: TestClient, hub: MemoryHub) -> None:
    assert post(client).status_code == 503

    def refuse(_: pb.PushRequest) -> pb.PushReply:
        raise Conflict("the robot 'Spot' has a camera of its own")

    MemoryBus(hub).serve(PUSH, refuse)
    answer = post(client)
    assert answer.status_code == 409
    assert "camera of its own" in answer.json()["detail"]


def test_a_frame_may_exceed_the_general_body_limit_but_not_its_own(
    client: TestClient, bridge: Bridge
) -> None:
    large = png(np.random.default_rng(0).integers(0, 255, (300, 400, 3), np.uint8))
    assert len(large) > 65536
    assert post(client, depth=None, color=("c.png", large)).status_code == 200
    answer = post(client, color=("c.png", bytes(17_000_000)))
    assert answer.status_code == 413
    assert "16000000" in answer.json()["detail"]


def test_too_many_concurrent_frames_get_status_503_with_retry_after(
    client: TestClient, bridge: Bridge, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("helios_gateway.request_limits.MOST_LARGE", 0)
    answer = post(client)
    assert answer.status_code == 503
    assert answer.headers["retry-after"] == "1"
    assert MOST_LARGE > 1


@given(st.one_of(st.binary(max_size=300), st.binary(max_size=300).map(lambda b: COLOR[:40] + b)))
@settings(deadline=None, max_examples=100)
def test_arbitrary_image_bytes_raise_at_most_a_typed_error(data: bytes) -> None:
    for scale in (0.001, 0.0002):
        meta = read_meta(json.dumps(META | {"depth_scale_m": scale}))
        for color, depth in ((data, DEPTH), (COLOR, data)):
            with contextlib.suppress(InvalidInput):
                request = push_request(meta, color, depth)
                request.frame.T_world_base.CopyFrom(request.frame.T_world_cam)
                frame_from_proto(request.frame)


@pytest.mark.parametrize(
    ("classes", "said"),
    [
        (("mug", "x" * 65, "cup"), f"called '{'x' * 64}…', which has 65 letters; send names of 1"),
        (("mug", " ", "cup"), "called '', which has 0 letters; send names of 1 to 64"),
        (tuple(f"c{k}" for k in range(65)), "65 classes came; send at most 64"),
    ],
)
def test_a_refused_class_name_is_told(classes: tuple[str, ...], said: str) -> None:
    with pytest.raises(InvalidInput, match=said):
        Rig().push(pushed(), classes=classes)
