"""A frame as a client sends it over HTTP or a socket, and a bridge that accepts every frame."""

from __future__ import annotations

import json
from typing import Any

import cv2
import numpy as np
import pytest
from fastapi.testclient import TestClient
from helios_core import proto as pb
from helios_core.geometry import camera_on_base, se2_to_se3
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import PUSH
from numpy.typing import NDArray

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
    """Accepts every frame and answers with `reply`, which holds the maps' acknowledgements."""

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


def send(socket: Any, meta: object = META, color: bytes = COLOR, depth: bytes = DEPTH) -> None:
    socket.send_text(meta if isinstance(meta, str) else json.dumps(meta))
    socket.send_bytes(color)
    socket.send_bytes(depth)
