"""Both maps as the real services save them, loaded through the gateway into other processes."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from fastapi.testclient import TestClient
from helios_client.http.requests import arrays
from helios_core import proto as pb
from helios_core.health import Health
from helios_core.topics import RESERVE
from helios_gateway.bus_listener import RobotMonitor
from helios_gateway.robot_registry import RobotEndpoint, RobotRegistry
from helios_gateway.settings import Settings as GatewaySettings
from helios_gateway.web_app import create_app
from helios_objectmap.service import ObjectMapService
from helios_objectmap.settings import ObjectMapSettings
from map2d_rig import Rig
from numpy.typing import NDArray

from tests.support import wait_until

ZIP = {"content-type": "application/zip"}


@contextmanager
def gateway_client(rig: Rig) -> Iterator[TestClient]:
    """A client of a gateway with the rig's 2D map, an object map and an idle planner."""
    ObjectMapService(rig.bus, ObjectMapSettings.load([]), Health())
    rig.bus.serve(RESERVE, lambda _: pb.ReserveReply(token="r"))
    rig.scorer.serve(rig.bus)
    settings = GatewaySettings.load([])
    live = RobotMonitor(rig.bus, settings)
    yield TestClient(
        create_app(RobotRegistry({"robot": RobotEndpoint(rig.bus, live)}), settings),
        "http://localhost",
    )
    live.close()


def occupancy(door: TestClient) -> NDArray:
    answer = door.get(f"/v1{arrays('occupancy').path}")
    assert answer.status_code == 200, answer.text
    return np.load(io.BytesIO(answer.content))["occupancy"]


def test_a_map_file_transfers_both_maps_to_new_processes() -> None:
    first, second = Rig(), Rig()
    with gateway_client(first) as door, gateway_client(second) as other:
        empty = door.get("/v1/map.zip")
        assert empty.status_code == 503
        assert "no keyframe" in empty.json()["detail"]
        first.search("first")
        for frame in first.walk.look_around(2.0, 1.5):
            first.keyframe(frame)
            first.observe(frame, "first", {"pick": 0.4, "place": 0.2})
        wait_until(lambda: door.get("/v1/map.zip").status_code == 200, 60, "there is a map")
        second.keyframe(second.walk.look_around(2.0, 1.5)[0])  # the other robot has one keyframe
        wait_until(lambda: other.get("/v1/map").status_code == 200, 60, "it has a map of its own")
        loaded = other.put("/v1/map.zip", content=door.get("/v1/map.zip").content, headers=ZIP)
        assert loaded.status_code == 200, loaded.text
        assert loaded.json()["known_m2"] > 1
        np.testing.assert_array_equal(occupancy(other), occupancy(door))
        asked = "/v1/seen?prompt=a mug"
        assert other.get(asked).json()["views"] == door.get(asked).json()["views"] != []
