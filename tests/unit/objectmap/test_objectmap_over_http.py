"""The object map of the real service, over HTTP."""

from __future__ import annotations

import io
from collections.abc import Iterator

import cv2
import numpy as np
import pytest
from fastapi.testclient import TestClient
from helios_core.codec import context_to_proto, observation_to_proto
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import CONTEXT, OBSERVATION
from helios_gateway.bus_listener import RobotMonitor
from helios_gateway.robot_registry import RobotEndpoint, RobotRegistry
from helios_gateway.settings import Settings
from helios_gateway.web_app import create_app
from helios_objectmap.service import ObjectMapService
from objectmap_scene import CONTEXT as SOUGHT
from objectmap_scene import ROOM, SETTINGS, looking_at, mug_at, observe

MUG_CENTER = np.array([1.2, 0.0, 0.8])
SCENE = (*ROOM, mug_at(1.2, 0.0))
# A camera 1.3 m high, 0.9 m from the mug, facing it; no frame was taken there.
POSE = "x_m=0.45&y_m=0&z_m=1.3&yaw_rad=0&down_rad=0.588"
DISTANCE_M = float(np.hypot(0.75, 0.5))


@pytest.fixture(scope="module")
def client() -> Iterator[TestClient]:
    hub = MemoryHub()
    ObjectMapService(MemoryBus(hub), SETTINGS, Health())
    bus = MemoryBus(hub)
    bus.publish(CONTEXT, context_to_proto(SOUGHT))
    for seq, (x, y) in enumerate([(0.0, 0.0), (0.1, 0.3), (0.2, -0.3)]):
        o = observe(SCENE, looking_at(x, y, tuple(MUG_CENTER)), seq=seq)
        bus.publish(OBSERVATION, observation_to_proto(o))
    settings = Settings.load(["--silent-after-s", "3600"])
    live = RobotMonitor(MemoryBus(hub), settings)
    app = create_app(RobotRegistry({"robot": RobotEndpoint(MemoryBus(hub), live)}), settings)
    with TestClient(app, "http://localhost") as client:
        yield client
    live.close()


def mug_of(client: TestClient) -> dict:
    (mug,) = client.get("/v1/objects?class=mug").json()["objects"]
    return mug


def picture(client: TestClient, layer: str) -> np.ndarray:
    """The middle of the rendered view, where the mug is."""
    answer = client.get(f"/v1/map/view.png?{POSE}&layer={layer}&class=mug")
    assert answer.status_code == 200, answer.text
    shown = cv2.imdecode(np.frombuffer(answer.content, np.uint8), cv2.IMREAD_UNCHANGED)
    assert shown is not None
    assert shown.shape[:2] == (480, 640)
    return shown[220:260, 300:340]


def test_all_four_layers_are_rendered_from_a_pose_without_a_frame(client):
    depth_m = picture(client, "depth") / 1000
    assert np.median(depth_m) == pytest.approx(DISTANCE_M, abs=0.08)
    for layer in ("color", "probability", "uncertainty"):
        assert np.median(picture(client, layer)) < 250, f"{layer} is white where the mug is"
    # viridis: a high probability is yellow, with much more green than blue (BGR)
    blue, green, _ = np.median(picture(client, "probability"), axis=(0, 1))
    assert green > blue + 30


@pytest.mark.parametrize("query", ["&class=piano", ""])
def test_a_view_without_a_known_class_is_refused_with_the_known_classes(client, query):
    answer = client.get(f"/v1/map/view.png?{POSE}&layer=probability{query}")
    assert answer.status_code == 400
    assert "mug, table" in answer.json()["detail"]


def test_a_mug_is_reported_with_its_history_points_box_and_gaussians(client):
    mug = mug_of(client)
    history = client.get(f"/v1/objects/{mug['id']}/detail").json()["history"]
    assert [m["views"] for m in history] == [1, 2, 3]
    assert history[-1]["score"] == pytest.approx(mug["score"])
    points = np.load(io.BytesIO(client.get(f"/v1/objects/{mug['id']}/points.npz").content))
    assert np.abs(points["points_m"] - MUG_CENTER).max() < 0.1
    assert np.abs(points["box_center_m"] - MUG_CENTER).max() < 0.05  # its far side was not seen
    assert 0.05 < points["box_size_m"][1] < 0.13
    gaussians = np.load(io.BytesIO(client.get(f"/v1/objects/{mug['id']}/gaussians.npz").content))
    assert set(gaussians["instance"].tolist()) == {mug["id"]}
    assert len(gaussians["instance"]) == mug["gaussians"]
    assert client.get("/v1/objects.ply").content.startswith(b"ply")
