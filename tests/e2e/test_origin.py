"""Tests a restart of `helios up`: maps are restored if the robot reports the same origin id, and
reported as unused if it does not."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.e2e.own_robot_up import OwnUp
from tests.helios_up import helios_up
from tests.support import LOOPBACK, wait_until

NEEDED = ("bridge", "detector", "map2d", "objectmap", "planner")
ROBOT = "helios_examples.room_robot:RoomRobot"
ELSEWHERE = """
from dataclasses import replace
from helios_examples.room_robot import RoomRobot

class Elsewhere(RoomRobot):
    def state(self):
        return replace(super().state(), origin_id="another room")
"""

pytestmark = pytest.mark.timeout(420)


@contextmanager
def up(folder: Path, robot: str) -> Iterator[OwnUp]:
    """Run `helios up` with the state of the run before; enters when all services are ready."""
    own = {"XDG_STATE_HOME": str(folder / "home"), "PYTHONPATH": str(folder)}
    flags = ("--robot", robot, "--detector", "paint")
    with helios_up(folder / "state", *flags, kind=OwnUp, environment=own) as running:
        wait_until(lambda: running.are_ready(*NEEDED), 120, "all is ready")
        yield running


def get(running: OwnUp, path: str) -> Any:
    answer = LOOPBACK.get(f"{running.address}/v1{path}", timeout=20)
    return answer.json() if answer.status_code == 200 else None


def objects(running: OwnUp) -> dict[int, str]:
    return {o["id"]: o["class"] for o in get(running, "/objects")["objects"]}


def explored_m2(running: OwnUp) -> float:
    return (get(running, "/map") or {"explored_m2": 0.0})["explored_m2"]


def find_the_box(running: OwnUp) -> str:
    body = {"instruction": "find the box"}
    id = LOOPBACK.post(f"{running.address}/v1/tasks", json=body, timeout=20).json()["id"]
    over = ("succeeded", "failed", "cancelled")
    wait_until(lambda: get(running, f"/tasks/{id}")["state"] in over, 200, "the task has ended")
    return get(running, f"/tasks/{id}")["state"]


@pytest.mark.long
def test_maps_are_restored_only_after_a_start_with_the_same_origin_id(tmp_path: Path) -> None:
    with up(tmp_path, ROBOT) as first:
        assert find_the_box(first) == "succeeded"
        known, seen_m2 = objects(first), get(first, "/map")["occupied_m2"]
        assert "box" in known.values()
        assert seen_m2 > 0
    with up(tmp_path, ROBOT) as second:
        assert objects(second) == known
        wait_until(lambda: get(second, "/map"), 60, "the 2D map is there")
        assert get(second, "/map")["occupied_m2"] >= 0.9 * seen_m2
        reason = second.services()["objectmap"]["reason"]
        assert reason.startswith("the map was restored as it was written at "), reason
        listed = subprocess.run(
            [sys.executable, "-m", "helios_client", "objects", "--class", "Box",
             "--port", str(second.port)],
            capture_output=True, text=True, check=True, timeout=60,
        ).stdout  # fmt: skip
        assert "box" in listed
        assert find_the_box(second) == "succeeded"
        assert set(known) <= set(objects(second))
        assert second.services()["objectmap"]["reason"].startswith("no error model")
        reset = LOOPBACK.post(f"{second.address}/v1/map/reset?only=occupancy", timeout=60)
        assert reset.status_code == 200, reset.text
        assert get(second, "/map") is None
        assert set(known) <= set(objects(second))
    (tmp_path / "elsewhere.py").write_text(ELSEWHERE)
    with up(tmp_path, "elsewhere:Elsewhere") as third:
        wait_until(lambda: not objects(third), 60, "another world holds nothing of it")
        wait_until(
            lambda: (
                "has other coordinates than the robot has now"
                in third.services()["objectmap"]["reason"]
            ),
            60,
            "the object map says why it holds nothing",
        )
        assert "restored" not in third.services()["objectmap"]["reason"]
