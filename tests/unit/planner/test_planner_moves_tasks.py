"""Tasks that only move the robot, over the bus: queued, observed, cancelled, resumed."""

from __future__ import annotations

import threading
from dataclasses import replace
from pathlib import Path

import pytest
from helios_core import proto as pb
from helios_core.errors import InvalidInput
from helios_core.memory_bus import MemoryBus
from helios_core.robot import Forward
from helios_core.topics import CANCEL, DECISIONS, PAUSE, RESUME
from helios_planner.tasks.messages import task_from_proto, task_to_proto
from helios_planner.tasks.store import Store
from planner_bus import Start, ended, submit, task
from planner_flat import flat
from planner_group import PlannerGroup

from tests.support import wait_until

GO = "go to 8.3, 6.3 facing 45 degrees"


def test_a_go_task_reports_its_point_its_phase_and_its_reasons(start: Start) -> None:
    _, bus, peers = start(flat())
    queued = submit(bus, GO)
    assert (queued.kind, queued.point.x_m, queued.point.y_m) == ("go_to_point", 8.3, 6.3)
    assert abs(queued.point.yaw_rad - 0.785) < 1e-3
    done = ended(bus, queued.id)
    assert (done.state, done.phase, done.progress) == ("succeeded", "go", 1.0), done.message
    assert done.message.startswith("stands at (8.")
    assert done.steps == peers.world.steps
    assert peers.world.pose().distance_m((8.3, 6.3)) < 0.12
    reported = bus.call(DECISIONS, pb.TaskRequest(id=done.id), 5).decisions
    assert [d.index for d in reported] == list(range(len(reported)))
    assert all(d.phase == "go" and "known ground ends" in d.why for d in reported)


@pytest.mark.parametrize("text", [GO, "explore the home", "come back"])
def test_a_task_that_only_moves_the_robot_needs_no_detector(start: Start, text: str) -> None:
    """The search context is empty; the task waits for nothing that depends on the detector."""
    _, bus, peers = start(flat(), names=("mug",))
    peers.silent = {"detections", "value", "objects"}
    id = submit(bus, text).id
    done = ended(bus, id)
    assert done.state == "succeeded", done.message
    assert (peers.context.id, len(peers.context.classes), len(peers.context.prompts)) == (id, 0, 0)


def test_an_exploration_succeeds_when_its_time_is_over(start: Start) -> None:
    _, bus, peers = start(flat())
    peers.gate = threading.Event()
    id = submit(bus, "explore for 5 seconds").id
    assert task(bus, id).time_limit_s == 5
    wait_until(peers.acting.is_set, 60, "it acts")
    threading.Timer(5.2, peers.gate.set).start()
    done = ended(bus, id)
    assert done.state == "succeeded"
    assert "the task's 5 s are used up" in done.message


def test_a_requested_time_limit_overrides_the_one_in_the_instruction(start: Start) -> None:
    _, bus, _ = start(flat())
    assert submit(bus, "explore for two minutes", time_limit_s=30).time_limit_s == 30
    assert submit(bus, "explore for two minutes").time_limit_s == 120


def test_a_go_is_paused_resumed_and_cancelled(start: Start) -> None:
    _, bus, peers = start(flat())
    peers.gate = threading.Event()
    id = submit(bus, GO).id
    wait_until(peers.acting.is_set, 60, "it acts")
    bus.call(PAUSE, pb.TaskRequest(id=id), 5)
    peers.gate.set()
    wait_until(lambda: task(bus, id).state == "paused", 60, "it is paused")
    peers.gate.clear()
    peers.acting.clear()
    bus.call(RESUME, pb.TaskRequest(id=id), 5)
    wait_until(peers.acting.is_set, 60, "it goes on")
    bus.call(CANCEL, pb.TaskRequest(id=id), 5)
    peers.gate.set()
    assert ended(bus, id).state == "cancelled"


def test_a_point_out_of_reach_has_its_own_cause(start: Start) -> None:
    _, bus, _ = start(flat())
    done = ended(bus, submit(bus, "go to 2.2, 6.6").id)
    assert (done.state, done.cause) == ("failed", "goal unreachable")
    assert "is inside an obstacle; the nearest place" in done.message


@pytest.mark.parametrize(
    ("lacks", "said"), [({"can_move": False}, "cannot move"), ({"max_turn_rad": 0}, "cannot turn")]
)
def test_a_task_that_moves_a_robot_that_cannot_move_or_turn_is_refused(
    start: Start, lacks: dict[str, float], said: str
) -> None:
    world = flat()
    world.description = replace(world.description, **lacks)
    _, bus, _ = start(world)
    with pytest.raises(InvalidInput, match=said):
        submit(bus, "explore")


@pytest.mark.parametrize("text", [GO, "go to 8, 3", "explore the home"])
@pytest.mark.parametrize("answered", [True, False])
def test_a_task_whose_planner_dies_on_the_way_is_completed_by_the_next_planner(
    group: PlannerGroup, text: str, answered: bool
) -> None:
    world = flat()
    peers = group.peers(world)
    moves = 0

    def dies_at(request: pb.ActionRequest) -> bool:
        nonlocal moves
        moves += request.action.HasField("forward")
        return moves == 3

    mortal, asked = group.mortal(dies_at, answered)
    id = submit(asked, text).id
    assert mortal.dead.wait(60)
    bus: MemoryBus = group.planner()
    done = ended(bus, id)
    assert done.state == "succeeded", done.message
    assert done.point == task(bus, id).point
    assert peers.contexts == [id]
    assert world.contacts == 0
    forward = [a for a in world.log if isinstance(a, Forward)]
    assert len(forward) >= 3


def test_a_point_survives_a_restart_of_the_planner(tmp_path: Path) -> None:
    point = pb.GoalPoint(x_m=1.5, y_m=-2.0)
    kept = pb.Task(id="a", state="queued", kind="go_to_point", point=point, created_s=1)
    store = Store(tmp_path)
    store.put(kept)
    [read] = store.tasks()
    store.close()
    again = task_to_proto(task_from_proto(read))
    assert again.point == point
    assert not again.point.HasField("yaw_rad")
