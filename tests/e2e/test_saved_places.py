"""A second start elsewhere, with poses of another origin: the stored map's place is found again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.helios_up import Up, helios_up
from tests.support import LOOPBACK, wait_until

pytestmark = [pytest.mark.timeout(600), pytest.mark.long]

FLAGS = ("--robot", "sim", "--seed", "3")
ELSEWHERE = {"HELIOS_WORLD_START_SEED": "9", "HELIOS_WORLD_POSE_ORIGIN": "start"}
OVER = ("succeeded", "failed", "cancelled")


def get(up: Up, path: str) -> Any:
    return LOOPBACK.get(f"{up.address}/v1{path}", timeout=20).raise_for_status().json()


def find_the_sofa(up: Up) -> dict[str, Any]:
    body = {"instruction": "find the sofa"}
    id = LOOPBACK.post(f"{up.address}/v1/tasks", json=body, timeout=20).json()["id"]
    wait_until(lambda: get(up, f"/tasks/{id}")["state"] in OVER, 240, "the task has ended")
    return get(up, f"/tasks/{id}")


def test_a_stored_object_is_unknown_until_the_robot_has_found_its_place(tmp_path: Path) -> None:
    state = tmp_path / "state"
    state.mkdir()
    with helios_up(state, *FLAGS) as first:
        wait_until(first.ready, 180, "all services are ready")
        assert find_the_sofa(first)["state"] == "succeeded"
        [sofa, *_] = [o for o in get(first, "/objects")["objects"] if o["class"] == "sofa"]
    with helios_up(state, *FLAGS, environment=ELSEWHERE) as second:
        wait_until(second.ready, 180, "all services are ready")
        wait_until(lambda: get(second, "/objects")["stored"], 60, "the map is stored")
        before = get(second, "/objects")
        stored = [o for o in before["stored"] if o["class"] == "sofa"]
        assert {o["relocalisation"] for o in stored} == {"unknown"}
        assert all(o["center_m"] == [None, None, None] for o in stored)
        assert not [o for o in before["objects"] if o["class"] == "sofa"]
        assert find_the_sofa(second)["state"] == "succeeded"
        after = get(second, "/objects")
        [found, *_] = [o for o in after["objects"] if o["class"] == "sofa"]
        assert found["relocalisation"] == "relocalised"
        assert not after["stored"]
        assert found["size_m"][2] == pytest.approx(sofa["size_m"][2], abs=0.15)
        seen = get(second, "/seen?prompt=sofa")
        assert any(o["id"] == found["id"] for o in seen["objects"])
