"""Tasks whose planner dies: they resume without repeating an action, or fail with the reason."""

from __future__ import annotations

import threading
import time
from dataclasses import replace
from pathlib import Path

import pytest
from helios_core import proto as pb
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import CANCEL, DECISIONS, PAUSE, RESUME, TASK
from helios_planner.instruction.parser import parse
from helios_planner.robot.rpc import number_of
from helios_planner.service import PlannerService
from helios_planner.task import State, Task
from helios_planner.tasks.messages import task_to_proto
from helios_planner.tasks.registry import TaskRegistry
from helios_planner.tasks.store import Entry, Store
from planner_bus import ended, hasty, submit, task
from planner_flat import GO, flat_with_mug
from planner_group import PlannerGroup
from planner_world import FakeWorld

from tests.support import wait_until


def kinds(world: FakeWorld) -> list[str]:
    return [type(a).__name__ for a in world.log]


def stop(group: PlannerGroup, gate: threading.Event) -> None:
    """Close the first planner in the middle of an action, which ends when the gate opens."""
    stopping = threading.Thread(target=group.planners[0].close)
    stopping.start()
    gate.set()
    stopping.join(10)


@pytest.mark.parametrize("answered", [True, False], ids=["done", "never sent"])
def test_a_task_whose_planner_dies_in_a_pick_resumes_and_picks_once(
    group: PlannerGroup, answered: bool
) -> None:
    peers = group.peers(flat_with_mug())
    mortal, bus = group.mortal(lambda r: r.action.HasField("pick"), answered)
    id = submit(bus).id
    wait_until(mortal.dead.is_set, 120, "it dies")
    before = bus.call(DECISIONS, pb.TaskRequest(id=id), 5).decisions
    steps = peers.world.steps
    mortal.close()
    bus = group.planner()
    done = ended(bus, id)
    assert (done.state, done.cause) == ("succeeded", ""), done.message
    assert (kinds(peers.world).count("Pick"), kinds(peers.world).count("Place")) == (1, 1)
    assert done.picks == 1
    assert peers.world.released is peers.world.things[3]
    assert done.steps >= steps
    reported = bus.call(DECISIONS, pb.TaskRequest(id=id), 5).decisions
    assert [d.index for d in reported] == list(range(len(reported)))
    assert reported[: len(before)] == before
    assert peers.contexts == [id], "a new search context would forget what was searched"


def test_a_paused_task_stays_paused_over_the_planners_death(group: PlannerGroup) -> None:
    peers = group.peers(flat_with_mug())
    mortal, bus = group.mortal(lambda _: True)
    id = submit(bus, GO).id
    wait_until(mortal.dead.is_set, 60, "its worker is dead")
    bus.call(PAUSE, pb.TaskRequest(id=id), 5)  # only the worker is dead: the planner still answers
    mortal.close()
    bus = group.planner()
    wait_until(lambda: "resume" in task(bus, id).message, 60, "it waits")
    assert task(bus, id).state == "paused"
    assert peers.world.steps == 1
    bus.call(CANCEL, pb.TaskRequest(id=id), 5)
    assert ended(bus, id).state == "cancelled"


def test_a_cancelled_task_does_not_go_on_after_the_planners_death(group: PlannerGroup) -> None:
    peers = group.peers(flat_with_mug())
    mortal, bus = group.mortal(lambda _: True)
    id = submit(bus, GO).id
    wait_until(mortal.dead.is_set, 60, "its worker is dead")
    bus.call(CANCEL, pb.TaskRequest(id=id), 5)  # only the worker is dead: the planner still answers
    mortal.close()
    assert task(group.planner(), id).state == "cancelled"
    assert peers.world.steps == 1


def test_a_task_fails_if_its_planner_was_away_for_too_long(group: PlannerGroup) -> None:
    peers = group.peers(flat_with_mug())
    mortal, bus = group.mortal(lambda r: r.action.HasField("turn"))
    id = submit(bus).id
    wait_until(mortal.dead.is_set, 60, "it dies")
    mortal.close()
    steps = peers.world.steps
    bus = group.planner(resume_within_s=0)
    done = task(bus, id)
    assert (done.state, done.cause) == ("failed", "system error")
    assert "away for too long" in done.message
    assert peers.world.steps == steps


def test_a_running_task_fails_and_is_not_resumed_after_the_planner_is_stopped(
    group: PlannerGroup,
) -> None:
    peers = group.peers(flat_with_mug())
    bus = group.planner()
    peers.gate = threading.Event()
    id = submit(bus, GO).id
    wait_until(peers.acting.is_set, 60, "it acts")
    stop(group, peers.gate)
    steps = peers.world.steps
    bus = group.planner()
    done = task(bus, id)
    assert (done.state, done.cause) == ("failed", "system error")
    assert "was stopped" in done.message
    assert peers.world.steps == steps


def test_a_task_fails_if_the_robot_restarted_while_the_planner_was_away(
    group: PlannerGroup,
) -> None:
    peers = group.peers(flat_with_mug())
    mortal, bus = group.mortal(lambda r: r.action.HasField("tilt"))
    id = submit(bus).id
    wait_until(mortal.dead.is_set, 60, "it dies")
    mortal.close()
    peers.boot = "another"
    done = ended(group.planner(), id)
    assert (done.state, done.cause) == ("failed", "system error")
    assert "restarted" in done.message


def test_a_pause_survives_a_second_death_while_the_task_is_being_resumed(
    group: PlannerGroup,
) -> None:
    peers = group.peers(flat_with_mug())
    mortal, bus = group.mortal(lambda _: True)
    id = submit(bus, GO).id
    wait_until(mortal.dead.is_set, 60, "its worker is dead")
    bus.call(PAUSE, pb.TaskRequest(id=id), 5)
    mortal.close()
    nowhere = MemoryBus(MemoryHub())  # no bridge is there
    PlannerService(nowhere, hasty(group.state_dir / "robot"), Health())
    assert task(nowhere, id).state == "paused"
    bus = group.planner()
    wait_until(lambda: "resume" in task(bus, id).message, 60, "it waits")
    assert peers.world.steps == 1
    bus.call(RESUME, pb.TaskRequest(id=id), 5)
    assert ended(bus, id).state == "succeeded"


def test_a_task_that_waits_to_be_resumed_can_be_paused_and_cancelled(group: PlannerGroup) -> None:
    group.peers(flat_with_mug())
    mortal, bus = group.mortal(lambda _: True)
    id = submit(bus, GO).id
    wait_until(mortal.dead.is_set, 60, "its worker is dead")
    mortal.close()
    bus = MemoryBus(MemoryHub())  # no bridge is there
    PlannerService(bus, hasty(group.state_dir / "robot"), Health())
    assert task(bus, id).state == "running"
    assert bus.call(PAUSE, pb.TaskRequest(id=id), 5).state == "paused"
    assert bus.call(RESUME, pb.TaskRequest(id=id), 5).state == "running"
    cancelled = bus.call(CANCEL, pb.TaskRequest(id=id), 5)
    assert (cancelled.state, cancelled.message[:16]) == ("cancelled", "cancelled after ")


def test_clearing_the_stop_resumes_a_task_whose_planner_died_meanwhile(group: PlannerGroup) -> None:
    peers = group.peers(flat_with_mug())
    mortal, bus = group.mortal(lambda r: r.action.HasField("turn"))
    id = submit(bus, GO).id
    wait_until(mortal.dead.is_set, 60, "its worker is dead")
    peers.stopped = True
    mortal.close()
    bus = group.planner()
    wait_until(lambda: "is stopped" in task(bus, id).message, 60, "it says so")
    assert task(bus, id).state == "paused"
    peers.stopped = False
    assert ended(bus, id).state == "succeeded"


def test_the_duration_of_a_pause_does_not_count_as_absence_of_the_planner(
    tmp_path: Path,
) -> None:
    move, long_ago_s = parse("go to the sofa"), time.time() - 10_000
    store = Store(tmp_path)
    paused = Task("a", "go", move, State.PAUSED, 9, long_ago_s, started_s=long_ago_s, on_hold=True)
    store.put(task_to_proto(paused))
    assert store.mend((), ())
    store.close()
    store = Store(tmp_path)
    settings, bus = hasty(tmp_path), MemoryBus(MemoryHub())
    store.note_alive(time.time())
    task_registry = TaskRegistry(bus, settings, Health(), store)
    assert task_registry.restore() == ["a"]
    assert task_registry.known("a").state is State.PAUSED
    store.note_alive(long_ago_s)
    task_registry = TaskRegistry(bus, settings, Health(), store)
    assert task_registry.restore() == []
    assert task_registry.known("a").state is State.FAILED


@pytest.mark.parametrize(("ago_s", "waits"), [(-365 * 86400.0, True), (-1.0, False)])
def test_a_clock_that_was_set_back_starts_no_queued_task(
    tmp_path: Path, ago_s: float, waits: bool
) -> None:
    store = Store(tmp_path)
    queued = Task("a", "go", parse("go to the sofa"), State.QUEUED, 9, time.time())
    store.put(task_to_proto(queued))
    assert store.mend((), ())
    store.close()
    store = Store(tmp_path)
    store.note_alive(time.time() - ago_s)
    registry = TaskRegistry(MemoryBus(MemoryHub()), hasty(tmp_path), Health(), store)
    assert registry.restore() == ["a"]
    assert registry.known("a").on_hold is waits


def restored(tmp_path: Path, *tasks: Task, unreadable: str = "") -> TaskRegistry:
    """Return the registry of a planner that finds these tasks, after one that just died.
    unreadable: id of a task whose journal is damaged."""
    store = Store(tmp_path)
    for stored in tasks:
        store.put(task_to_proto(stored))
    assert store.mend((), ())
    if unreadable:
        store.keep(unreadable, Entry())
        with store._db:
            store._db.execute("UPDATE journal SET memory = 'no JSON'")
    store.close()
    registry = TaskRegistry(MemoryBus(MemoryHub()), hasty(tmp_path), Health(), Store(tmp_path))
    registry.restore()
    return registry


def test_a_task_resumes_though_the_clock_was_stepped_back_after_another_ended(
    tmp_path: Path,
) -> None:
    move, now_s = parse("go to the sofa"), time.time()
    past = Task("past", "go", move, State.SUCCEEDED, 9, now_s, started_s=now_s + 3600)
    running = Task("running", "go", move, State.RUNNING, 9, now_s, started_s=now_s)
    assert restored(tmp_path, past, running).known("running").state is State.RUNNING


def test_a_task_with_an_unreadable_journal_fails_with_that_reason(tmp_path: Path) -> None:
    now_s = time.time()
    running = Task("a", "go", parse("go to the sofa"), State.RUNNING, 9, now_s, started_s=now_s)
    found = restored(tmp_path, running, unreadable="a").known("a")
    assert found.state is State.FAILED
    assert "cannot read its journal of the task" in found.message


def test_no_earlier_state_of_a_task_is_published_after_its_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its end comes while a change of it waits to be stored."""
    bus, store = MemoryBus(MemoryHub()), Store(tmp_path)
    task_registry = TaskRegistry(bus, hasty(tmp_path), Health(), store)
    go = Task("a", "go", parse("go to the sofa"), State.RUNNING, 9, time.time())
    task_registry.add(go)
    told: list[str] = []
    bus.subscribe(TASK, lambda message: told.append(message.state))
    told.clear()  # a retained one
    wait = task_registry._keep

    def ends_meanwhile(id: str, safe: bool = False) -> None:
        task_registry.end("a", State.SUCCEEDED, "done")
        wait(id, safe)

    monkeypatch.setattr(task_registry, "_keep", ends_meanwhile)
    changed = task_registry.change("a", message="a step further")
    assert told == ["succeeded"]
    assert changed.state is State.SUCCEEDED


def test_a_task_queued_when_the_planner_was_stopped_waits_to_be_resumed(
    group: PlannerGroup,
) -> None:
    peers = group.peers(flat_with_mug())
    bus = group.planner()
    peers.gate = threading.Event()
    submit(bus, GO)
    wait_until(peers.acting.is_set, 60, "it acts")
    queued = submit(bus, GO).id
    stop(group, peers.gate)
    steps = peers.world.steps
    bus = group.planner()
    third = submit(bus, "find the mug").id
    assert ended(bus, third).state == "succeeded"
    assert peers.world.steps > steps
    waiting = task(bus, queued)
    assert (waiting.state, waiting.on_hold) == ("queued", True)
    assert "was queued before" in waiting.message
    bus.call(RESUME, pb.TaskRequest(id=queued), 5)
    assert ended(bus, queued).state == "succeeded"


def test_a_task_fails_if_the_robot_has_done_an_action_that_the_journal_lacks(
    group: PlannerGroup,
) -> None:
    """The computer lost power before its last writes were on the disk."""
    peers = group.peers(flat_with_mug())
    mortal, bus = group.mortal(lambda _: len(peers.done) >= 7)
    id = submit(bus).id
    wait_until(mortal.dead.is_set, 120, "it dies")
    mortal.close()
    store = Store(group.state_dir / "robot")
    entry = store.entry(id)
    assert entry is not None
    assert entry.request is not None
    entry.request.action_id = f"{id}-3"
    store.keep(id, replace(entry, result=None))
    store.close()
    steps = peers.world.steps
    done = ended(group.planner(), id)
    assert (done.state, done.cause) == ("failed", "system error")
    assert f"has done action {id}-8 of this task" in done.message
    assert peers.world.steps == steps


@pytest.mark.parametrize(
    ("one", "later"), [("t-1", "t-2"), ("t-9", "t-10"), ("t-30", "t.1-1"), ("t.9-4", "t.10-1")]
)
def test_actions_of_a_task_are_in_order(one: str, later: str) -> None:
    assert number_of(one) < number_of(later)
