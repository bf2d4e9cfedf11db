"""Order of the task queue: interrupted tasks first, then by priority, then by submission."""

from __future__ import annotations

import threading
from functools import partial
from types import SimpleNamespace
from typing import Any, cast

import pytest
from helios_core import proto as pb
from helios_core.errors import Conflict, InvalidInput
from helios_core.topics import CANCEL, LIST_TASKS, RESERVE, SUBMIT, TASK
from helios_planner.instruction.parser import parse
from helios_planner.service import PlannerService
from helios_planner.task import State, Task
from planner_bus import Start, ended, submit, task
from planner_flat import MOVE

from tests.support import wait_until


def test_a_queued_task_waits_and_can_be_cancelled(start: Start) -> None:
    _, bus, peers = start()
    peers.gate = threading.Event()
    first = submit(bus, "find the mug").id
    wait_until(peers.acting.is_set, 60, "it acts")
    second = submit(bus).id
    assert task(bus, second).state == "queued"
    assert bus.call(CANCEL, pb.TaskRequest(id=second), 5).state == "cancelled"
    bus.call(CANCEL, pb.TaskRequest(id=first), 5)
    peers.gate.set()
    assert ended(bus, first).state == "cancelled"


def test_a_task_beyond_the_most_that_wait_is_refused_until_one_is_gone(start: Start) -> None:
    planner, bus, peers = start(max_waiting=2)
    peers.gate = threading.Event()
    submit(bus, "find the mug")
    wait_until(peers.acting.is_set, 60, "it acts")
    waiting = [submit(bus).id for _ in range(2)]
    assert planner._health.metrics()["tasks_waiting"] == 2
    with pytest.raises(Conflict, match="2 tasks wait already"):
        submit(bus)
    bus.call(CANCEL, pb.TaskRequest(id=waiting[0]), 5)
    assert planner._health.metrics()["tasks_waiting"] == 1
    assert submit(bus).state == "queued"
    peers.gate.set()


def test_a_task_that_is_cancelled_while_it_is_stored_ends(
    start: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    planner, bus, _ = start()
    add = planner._registry.add

    def add_then_cancel(new: Task) -> pb.Task:
        added = add(new)
        bus.call(CANCEL, pb.TaskRequest(id=new.id), 5)
        return added

    monkeypatch.setattr(planner._registry, "add", add_then_cancel)
    asked = pb.SubmitRequest(instruction=MOVE, on_hold=True)
    answer = bus.call(SUBMIT, asked, 5)
    assert (answer.state, answer.message) == ("cancelled", "cancelled before it began")
    assert task(bus, answer.id).state == "cancelled"
    assert planner._health.metrics()["tasks_waiting"] == 0
    assert bus.call(RESERVE, pb.ReserveRequest(why="a test", for_s=1.0), 5).token


def test_a_task_has_a_place_in_the_queue_while_it_is_stored(
    start: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    planner, bus, _ = start(max_waiting=1)
    add = planner._registry.add

    def add_beside_another(new: Task) -> pb.Task:
        with pytest.raises(Conflict, match="1 tasks wait already"):
            planner.submit(pb.SubmitRequest(instruction=MOVE))
        return add(new)

    monkeypatch.setattr(planner._registry, "add", add_beside_another)
    id = submit(bus).id
    bus.call(CANCEL, pb.TaskRequest(id=id), 5)
    assert ended(bus, id).state == "cancelled"


def test_the_queue_is_ordered_by_priority_and_then_by_submission(start: Start) -> None:
    _, bus, peers = start()
    begun: list[str] = []
    bus.subscribe(TASK, lambda t: begun.append(t.id) if t.state == "running" else None)
    peers.gate = threading.Event()
    first = submit(bus, "find the mug").id
    wait_until(peers.acting.is_set, 60, "it acts")
    asked = [pb.SubmitRequest(instruction="go to the counter", priority=p) for p in (0, -5, 7, 0)]
    ids = [bus.call(SUBMIT, request, 5).id for request in asked]
    reported = bus.call(LIST_TASKS, pb.Empty(), 5).tasks
    assert {t.id: t.priority for t in reported} == {
        first: 0,
        **dict(zip(ids, (0, -5, 7, 0), strict=True)),
    }
    peers.gate.set()
    ended(bus, ids[1])
    assert list(dict.fromkeys(begun)) == [first, ids[2], ids[0], ids[3], ids[1]]


def test_an_interrupted_task_comes_before_queued_tasks_of_higher_priority() -> None:
    move = parse(MOVE)
    tasks = {
        name: Task(name, MOVE, move, state, 100, 0.0, priority=priority)
        for name, state, priority in (
            ("first", State.QUEUED, 0),
            ("urgent", State.QUEUED, 9),
            ("cut off", State.RUNNING, 0),
            ("held", State.PAUSED, -1),
        )
    }
    service = SimpleNamespace(_registry=SimpleNamespace(known=tasks.__getitem__))
    order = sorted(tasks, key=partial(PlannerService._rank, cast(Any, service)), reverse=True)
    assert order == ["cut off", "held", "urgent", "first"]


def test_a_priority_out_of_range_is_refused(start: Start) -> None:
    _, bus, _ = start()
    with pytest.raises(InvalidInput, match="-100 to 100"):
        bus.call(SUBMIT, pb.SubmitRequest(instruction=MOVE, priority=101), 5)
