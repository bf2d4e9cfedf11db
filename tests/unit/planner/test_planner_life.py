"""The life of a task: pause, time limit, tasks in parallel, removal of old tasks."""

from __future__ import annotations

import threading
from typing import NoReturn

import pytest
from helios_core import proto as pb
from helios_core.errors import Conflict, InvalidInput, Unavailable
from helios_core.topics import CANCEL, DECISIONS, LIST_TASKS, PAUSE, RESUME, TASK
from planner_bus import ended, submit, task
from planner_flat import GO, flat_with_mug
from planner_group import PlannerGroup

from tests.support import wait_until


def test_a_paused_task_begins_no_action_until_it_is_resumed(group: PlannerGroup) -> None:
    peers = group.peers(flat_with_mug())
    bus = group.planner(max_steps=3)
    peers.gate = threading.Event()
    id = submit(bus, GO).id
    wait_until(peers.acting.is_set, 60, "it acts")
    bus.call(PAUSE, pb.TaskRequest(id=id), 5)
    peers.gate.set()
    wait_until(lambda: task(bus, id).state == "paused", 60, "it is paused")
    assert task(bus, id).message == "paused; resume or cancel it"
    assert peers.world.steps == 1
    bus.call(RESUME, pb.TaskRequest(id=id), 5)
    assert ended(bus, id).steps == 3


def test_a_paused_task_can_be_cancelled(group: PlannerGroup) -> None:
    peers = group.peers(flat_with_mug())
    bus = group.planner()
    peers.gate = threading.Event()
    id = submit(bus, GO).id
    wait_until(peers.acting.is_set, 60, "it acts")
    bus.call(PAUSE, pb.TaskRequest(id=id), 5)
    peers.gate.set()
    wait_until(lambda: task(bus, id).state == "paused", 60, "it is paused")
    bus.call(CANCEL, pb.TaskRequest(id=id), 5)
    assert ended(bus, id).state == "cancelled"
    assert peers.world.steps == 1


def test_a_queued_task_that_is_paused_is_not_begun_until_it_is_resumed(group: PlannerGroup) -> None:
    peers = group.peers(flat_with_mug())
    bus = group.planner()
    peers.gate = threading.Event()
    first, second, third = (submit(bus, GO).id for _ in range(3))
    wait_until(peers.acting.is_set, 60, "it acts")
    paused = bus.call(PAUSE, pb.TaskRequest(id=second), 5)
    assert (paused.state, paused.on_hold) == ("queued", True)
    assert "resume" in paused.message
    peers.gate.set()
    ended(bus, third)
    assert task(bus, second).state == "queued"
    resumed = bus.call(RESUME, pb.TaskRequest(id=second), 5)
    assert "waits for its turn" in resumed.message
    assert ended(bus, second).state == "succeeded"
    assert task(bus, first).ended_s < task(bus, third).ended_s < task(bus, second).started_s


def test_ended_and_unknown_tasks_are_neither_paused_nor_resumed(group: PlannerGroup) -> None:
    group.peers(flat_with_mug())
    bus = group.planner()
    id = submit(bus, GO).id
    ended(bus, id)
    for method in (PAUSE, RESUME):
        with pytest.raises(Conflict, match="is succeeded"):
            bus.call(method, pb.TaskRequest(id=id), 5)
        with pytest.raises(InvalidInput, match="there is no task"):
            bus.call(method, pb.TaskRequest(id="nobody" * 1000), 5)


def test_a_task_ends_when_its_time_is_over(group: PlannerGroup) -> None:
    group.peers(flat_with_mug())
    bus = group.planner()
    id = submit(bus, GO, time_limit_s=0.2).id
    assert task(bus, id).time_limit_s == pytest.approx(0.2)
    done = ended(bus, id)
    assert (done.state, done.cause) == ("failed", "step budget")
    assert done.message == "the task's 0.2 s are used up"


def test_an_invalid_time_limit_is_refused(group: PlannerGroup) -> None:
    group.peers(flat_with_mug())
    bus = group.planner()
    for wrong in (-1.0, float("nan"), float("inf")):
        with pytest.raises(InvalidInput, match="wanted seconds"):
            submit(bus, GO, time_limit_s=wrong)
    assert not bus.call(LIST_TASKS, pb.Empty(), 5).tasks


def test_two_tasks_on_one_robot_are_done_one_after_the_other(group: PlannerGroup) -> None:
    group.peers(flat_with_mug())
    bus = group.planner(max_steps=3)
    ran: list[tuple[str, str]] = []
    bus.subscribe(TASK, lambda t: ran.append((t.id, t.state)))
    first, second = submit(bus, GO).id, submit(bus, GO).id
    assert ended(bus, second).cause == "step budget"
    began = ran.index((second, "running"))
    assert (first, "failed") in ran[:began]


def test_tasks_of_different_robots_run_in_parallel(group: PlannerGroup) -> None:
    """One robot is held in its action; the task of the other one runs and ends."""
    still, other = group.peers(flat_with_mug(), "one"), group.peers(flat_with_mug(), "two")
    one, two = group.planner("one", max_steps=5), group.planner("two", max_steps=5)
    still.gate = threading.Event()
    held = submit(one, GO).id
    wait_until(still.acting.is_set, 60, "it acts")
    assert ended(two, submit(two, GO).id).cause == "step budget"
    assert other.world.steps == 5
    assert (task(one, held).state, still.world.steps) == ("running", 0)
    still.gate.set()
    assert ended(one, held).steps == 5


def test_a_task_that_cannot_be_set_up_leaves_nothing_in_the_service(
    group: PlannerGroup, monkeypatch: pytest.MonkeyPatch
) -> None:
    group.peers(flat_with_mug())
    bus = group.planner()

    def unusable(*_: object) -> NoReturn:
        raise Unavailable("tasks.sqlite cannot be read")

    monkeypatch.setattr("helios_planner.service.TaskExecutor", unusable)
    assert "cannot be read" in ended(bus, submit(bus, GO).id).message
    planner = group.planners[-1]
    assert (planner._holds, planner._cancels) == ({}, {})


def test_a_late_cancel_leaves_nothing_of_an_ended_task(group: PlannerGroup) -> None:
    group.peers(flat_with_mug())
    bus = group.planner()
    id = submit(bus, GO).id
    state = ended(bus, id).state
    task_registry = group.planners[-1]._registry
    for late in (id, "forgotten"):
        task_registry.cancel(late)
    assert task_registry._cancelled == set()
    assert task(bus, id).state == state == "succeeded"


def test_only_the_newest_ended_tasks_are_kept(group: PlannerGroup) -> None:
    group.peers(flat_with_mug())
    bus = group.planner(keep_tasks=1, max_steps=1)
    ids = []
    for _ in range(3):
        ids.append(submit(bus, GO).id)
        ended(bus, ids[-1])
    assert [t.id for t in bus.call(LIST_TASKS, pb.Empty(), 5).tasks] == ids[1:]
    with pytest.raises(InvalidInput):
        bus.call(DECISIONS, pb.TaskRequest(id=ids[0]), 5)
