"""Tests the example driver in `helios up --robot package:Class`: it maps, drives and stops."""

from __future__ import annotations

import io
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from helios_core import proto as pb
from helios_core.codec import frame_from_proto, transform_from_proto
from helios_core.errors import Conflict
from helios_core.topics import ACT, GET_STATE, KEYFRAME, LEASE, MAP2D_ACK
from helios_core.zenoh_bus import ZenohBus
from helios_examples import room_robot

from tests.e2e.own_robot_up import OwnUp, own_robot_up
from tests.support import LOOPBACK, wait_until

MOST_LINES = 80


@pytest.fixture(scope="module")
def up(tmp_path_factory: pytest.TempPathFactory) -> Iterator[OwnUp]:
    folder = tmp_path_factory.mktemp("own")
    needed = ("bridge", "detector", "map2d", "objectmap", "planner")
    with own_robot_up(folder, "helios_examples.room_robot:RoomRobot", needed, "paint") as up:
        yield up


@pytest.fixture
def bus(up: OwnUp) -> Iterator[ZenohBus]:
    bus = ZenohBus(up.router)
    yield bus
    bus.close()


def act(bus: ZenohBus, id: str, action: pb.Action) -> pb.ActionResult:
    token = bus.call(LEASE, pb.LeaseRequest(holder="a test", take=True), 5).token
    request = pb.ActionRequest(action_id=id, lease_token=token, time_remaining_s=20, action=action)
    return bus.call(ACT, request, 25)


def test_the_example_driver_is_as_short_as_the_docs_say() -> None:
    assert len(Path(room_robot.__file__).read_text().splitlines()) <= MOST_LINES


def test_the_example_program_of_the_docs_drives_the_robot_and_receives_the_map(
    up: OwnUp, tmp_path: Path
) -> None:
    page = (Path(__file__).resolve().parents[2] / "docs/how-to/drive-from-python.md").read_text()
    [program] = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    assert len(program.splitlines()) <= 40, "short enough to read"
    (tmp_path / "drive.py").write_text(program)
    done = subprocess.run(
        [sys.executable, "drive.py", up.router],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    *steps, known = done.stdout.splitlines()
    assert [line.split()[:2] for line in steps] == 4 * [
        ["forward", "True"],
        *3 * [["turn", "True"]],
    ]
    assert all(line.endswith(" m True") for line in steps), done.stdout
    assert float(known.split()[0]) > 5


def test_a_forward_action_succeeds_and_the_map_integrates_its_keyframe(
    up: OwnUp, bus: ZenohBus
) -> None:
    keyframes: list[pb.Frame] = []
    acks: list[pb.Ack] = []
    bus.subscribe(KEYFRAME, keyframes.append)
    bus.subscribe(MAP2D_ACK, acks.append)
    numbers = iter(range(100))

    def heard() -> bool:  # keyframes arrive once the router knows the subscriber
        act(bus, f"look {next(numbers)}", pb.Action(observe=pb.Action.Observe()))
        return bool(keyframes) and bool(acks)

    wait_until(heard, 60, "keyframes and answers are heard")
    start = transform_from_proto(bus.call(GET_STATE, pb.Empty(), 10).T_world_base)
    result = act(bus, "drive", pb.Action(forward=pb.Action.Forward(distance_m=0.5)))
    assert result.succeeded
    assert result.moved_m == pytest.approx(0.5, abs=0.02)

    def answers() -> list[pb.Ack]:
        return [a for a in acks if a.id == result.keyframe and a.part == "occupancy"]

    wait_until(answers, 60, "the map has answered the drive's keyframe")
    assert answers()[0].accepted, answers()[0].reason

    def drives() -> list[pb.Frame]:
        return [k for k in keyframes if k.id == result.keyframe]

    wait_until(drives, 60, "the drive's keyframe is heard here, too")
    (frame,) = drives()
    goal_m = (start @ [0.5, 0.0, 0.0, 1.0])[:2]  # 0.5 m ahead, wherever other tests left the robot
    np.testing.assert_allclose(frame_from_proto(frame).T_world_base[:2, 3], goal_m, atol=0.02)


def test_the_map_shows_the_table_and_the_free_floor(up: OwnUp, bus: ZenohBus) -> None:
    act(bus, "look again", pb.Action(observe=pb.Action.Observe()))

    def at(grid: dict[str, np.ndarray], x_m: float, y_m: float) -> int:
        (x0, y0), cell_m = grid["origin_m"], float(grid["cell_m"])
        return int(grid["occupancy"][int((y_m - y0) / cell_m), int((x_m - x0) / cell_m)])

    def mapped() -> bool:
        answer = LOOPBACK.get(f"{up.address}/v1/map/occupancy.npz", timeout=60)
        if answer.status_code != 200:
            return False
        with np.load(io.BytesIO(answer.content)) as file:
            grid = {name: file[name] for name in file.files}
        return at(grid, 1.45, 0.3) == 100 and at(grid, 1.25, 0.0) == 0

    wait_until(mapped, 60, "the table is occupied and the floor before it free")


def test_stop_now_over_http_blocks_actions_until_it_is_cleared(up: OwnUp, bus: ZenohBus) -> None:
    stopped = LOOPBACK.post(f"{up.address}/v1/robot/stop", json={"reason": "a cat"}, timeout=60)
    assert stopped.status_code == 200
    with pytest.raises(Conflict, match="a cat"):
        act(bus, "after the stop", pb.Action(turn=pb.Action.Turn(angle_rad=0.2)))
    assert LOOPBACK.post(f"{up.address}/v1/robot/clear-stop", timeout=60).status_code == 200
    assert act(bus, "after that", pb.Action(turn=pb.Action.Turn(angle_rad=0.2))).succeeded


@pytest.mark.long
@pytest.mark.timeout(300)
def test_the_planner_drives_the_example_robot_and_finds_an_object(up: OwnUp) -> None:
    """The shelf stands behind the robot, which has to turn and to look from several places."""
    address = f"{up.address}/v1/tasks"
    task = LOOPBACK.post(address, json={"instruction": "find the shelf"}, timeout=20).json()

    def ended() -> bool:
        return LOOPBACK.get(f"{address}/{task['id']}", timeout=20).json()["state"] in (
            "succeeded",
            "failed",
            "cancelled",
        )

    wait_until(ended, 240, "the task has ended")
    task = LOOPBACK.get(f"{address}/{task['id']}", timeout=20).json()
    assert task["state"] == "succeeded", task
    objects = LOOPBACK.get(f"{up.address}/v1/objects", timeout=20).json()["objects"]
    (shelf,) = [o for o in objects if o["class"] == "shelf"]
    assert np.linalg.norm(np.subtract(shelf["center_m"][:2], (-2.0, 1.5))) < 0.5, objects
