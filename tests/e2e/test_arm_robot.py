"""Tests that the example driver with an arm carries out a whole task in `helios up`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helios_examples.arm_robot import FURNITURE, ArmRobot
from helios_examples.room import THINGS

from tests.e2e.own_robot_up import own_robot_up
from tests.support import LOOPBACK, wait_until

INSTRUCTION = "move the box from the table to the shelf"


@pytest.mark.long
@pytest.mark.timeout(400)
def test_the_box_is_picked_looked_at_and_put_on_the_shelf(tmp_path: Path) -> None:
    services = ("bridge", "detector", "map2d", "objectmap", "planner")
    robot = f"{ArmRobot.__module__}:{ArmRobot.__name__}"
    with own_robot_up(tmp_path, robot, services, "paint") as up:
        address = f"{up.address}/v1/tasks"
        id = LOOPBACK.post(address, json={"instruction": INSTRUCTION}, timeout=20).json()["id"]

        def task() -> dict[str, str]:
            return LOOPBACK.get(f"{address}/{id}", timeout=20).json()

        wait_until(lambda: task()["state"] in ("succeeded", "failed"), 240, "the task has ended")
        assert task()["state"] == "succeeded", task()
        decisions = LOOPBACK.get(f"{address}/{id}/decisions", timeout=20).json()["decisions"]
        assert any("sides in the hand show box" in d["why"] for d in decisions), decisions
        objects = LOOPBACK.get(f"{up.address}/v1/objects", timeout=20).json()["objects"]
    boxes = [o["center_m"] for o in objects if o["class"] == "box"]
    low_m, high_m = FURNITURE[1][0]
    on_shelf = [b for b in boxes if (low_m[:2] < b[:2]).all() and (b[:2] < high_m[:2]).all()]
    table_m = THINGS[0][0].mean(0)
    assert len(on_shelf) == 1, boxes
    assert all(np.linalg.norm(np.subtract(b, table_m)) > 1.0 for b in boxes), "none is left there"
