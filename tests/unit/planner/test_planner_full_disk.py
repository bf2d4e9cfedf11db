"""A full disk: no task starts while tasks cannot be stored, and no ended task moves the robot."""

from __future__ import annotations

import shutil
import threading
from pathlib import Path

import pytest
from helios_core import proto as pb
from helios_core.errors import Unavailable
from helios_core.topics import CANCEL, DECISION, DECISIONS, PAUSE, RESUME, TASK
from helios_planner import service
from helios_planner.task import State
from helios_planner.tasks.registry import NOT_KEPT
from planner_bus import ended, submit, task
from planner_disk import refuse, refusing
from planner_flat import GO, flat_with_mug
from planner_group import PlannerGroup

from tests.support import wait_until

pytestmark = pytest.mark.timeout(180)


@pytest.fixture(autouse=True)
def short_mend_period(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(service, "MEND_S", 0.05)
    monkeypatch.setattr(service, "ALIVE_EVERY_S", 0.05)


def group_after_restart(group: PlannerGroup, tmp_path: Path) -> PlannerGroup:
    """Return a group whose planners start with a copy of the present planner's files."""
    later = PlannerGroup(tmp_path / "later")
    later.hub = group.hub
    shutil.copytree(group.state_dir / "robot", later.state_dir / "robot")
    group.planners[-1].close()
    return later


def test_the_planner_is_degraded_and_refuses_tasks_while_they_cannot_be_stored(
    group: PlannerGroup,
) -> None:
    group.peers(flat_with_mug())
    bus = group.planner()
    wait_until(lambda: group.healths[-1].state[0] == "ready", 60, "it is ready")
    with refusing(group.planners[-1]):
        wait_until(lambda: group.healths[-1].state[0] == "degraded", 60, "it notices by itself")
        said = group.healths[-1].state[1]
        assert "tasks cannot be kept in" in said
        assert "make that folder writable" in said
        with pytest.raises(Unavailable, match="no task is taken now: tasks cannot be kept"):
            submit(bus, GO)
        assert not bus.call(service.LIST_TASKS, pb.Empty(), 5).tasks
    wait_until(lambda: group.healths[-1].state[0] == "ready", 60, "it recovers by itself")
    assert ended(bus, submit(bus, GO).id).state == "succeeded"


def test_a_task_whose_submission_cannot_be_stored_is_not_listed(group: PlannerGroup) -> None:
    group.peers(flat_with_mug())
    bus = group.planner()
    group.planners[-1]._ending.set()  # the thread "alive" does not notice first
    with refusing(group.planners[-1]), pytest.raises(Unavailable, match="no task is taken"):
        submit(bus, GO)
    assert not bus.call(service.LIST_TASKS, pb.Empty(), 5).tasks


def test_decisions_of_a_full_disk_are_kept_once_there_is_room(
    group: PlannerGroup, monkeypatch: pytest.MonkeyPatch
) -> None:
    group.peers(flat_with_mug())
    bus = group.planner()
    store, told = group.planners[-1]._store, list[int]()
    add = store.add

    def add_or_be_full(decision: pb.Decision) -> bool:
        if decision.index == 2:
            refuse(store)
        return add(decision)

    monkeypatch.setattr(store, "add", add_or_be_full)
    bus.subscribe(DECISION, lambda decision: told.append(decision.index))
    id = submit(bus).id
    wait_until(lambda: 2 in told, 60, "it decides, and stands as nothing can be written")
    refuse(store, refuses=False)
    assert ended(bus, id).state == "succeeded"
    numbers = [d.index for d in bus.call(DECISIONS, pb.TaskRequest(id=id), 5).decisions]
    assert numbers == list(range(len(numbers)))
    assert set(told) <= set(numbers)


def test_no_action_starts_before_its_journal_entry_is_written(
    group: PlannerGroup,
) -> None:
    peers = group.peers(flat_with_mug())
    bus = group.planner()
    peers.gate = threading.Event()
    id = submit(bus).id
    wait_until(peers.acting.is_set, 60, "it acts")
    reported: list[str] = []
    bus.subscribe(TASK, lambda t: reported.append(t.message))
    with refusing(group.planners[-1]):
        peers.gate.set()
        wait_until(lambda: "waits for its journal" in task(bus, id).message, 60, "it says so")
        assert "tasks cannot be kept in" in task(bus, id).message
        assert peers.world.steps == 1  # the action that was running
    assert ended(bus, id).state == "succeeded"
    assert any("waits for its journal" in m for m in reported)


def test_a_task_whose_journal_cannot_be_written_for_long_fails_with_the_reason(
    group: PlannerGroup,
) -> None:
    peers = group.peers(flat_with_mug())
    bus = group.planner(keep_within_s=0.3)
    peers.gate = threading.Event()
    id = submit(bus).id
    wait_until(peers.acting.is_set, 60, "it acts")
    with refusing(group.planners[-1]):
        peers.gate.set()
        done = ended(bus, id)
        assert (done.state, done.cause) == ("failed", "system error")
        assert "could not be written down: tasks cannot be kept" in done.message
        assert NOT_KEPT in done.message
        assert peers.world.steps == 1
    wait_until(lambda: NOT_KEPT not in task(bus, id).message, 60, "it is kept after all")
    group.planners[-1].close()
    assert task(group.planner(), id).state == "failed"


def test_the_end_of_a_task_is_reported_only_once_it_is_stored(group: PlannerGroup) -> None:
    peers = group.peers(flat_with_mug())
    bus = group.planner()
    peers.gate = threading.Event()
    id = submit(bus, GO).id
    wait_until(peers.acting.is_set, 60, "it acts")
    with refusing(group.planners[-1]):
        bus.call(CANCEL, pb.TaskRequest(id=id), 5)
        peers.gate.set()
        wait_until(lambda: "told as cancelled once" in task(bus, id).message, 60, "it waits")
        assert task(bus, id).state == "running"
        with pytest.raises(service.Conflict, match="has ended"):
            bus.call(PAUSE, pb.TaskRequest(id=id), 5)
    done = ended(bus, id)
    assert done.state == "cancelled"
    assert done.message.startswith("cancelled; the robot stands")
    assert peers.world.steps == 1


def test_a_task_that_ended_on_a_full_disk_does_not_move_the_robot_after_a_restart(
    group: PlannerGroup, tmp_path: Path
) -> None:
    """Found by hand: the task was reported as succeeded, and after a restart the robot moved."""
    peers = group.peers(flat_with_mug())
    bus = group.planner()
    peers.gate = threading.Event()
    id = submit(bus, GO).id
    wait_until(peers.acting.is_set, 60, "it acts")
    refuse(group.planners[-1]._store)
    bus.call(CANCEL, pb.TaskRequest(id=id), 5)
    peers.gate.set()
    wait_until(lambda: "told as cancelled once" in task(bus, id).message, 60, "it has ended")
    steps = peers.world.steps
    later = group_after_restart(group, tmp_path)
    bus = later.planner()
    found = task(bus, id)
    assert (found.state, found.cause) == ("failed", "system error")
    assert "could not write down how its tasks went" in found.message
    again = submit(bus, GO).id
    assert ended(bus, again).state == "succeeded"  # the planner works
    assert task(bus, id).state == "failed"
    assert peers.world.steps > steps
    later.close()


def test_a_task_queued_on_a_full_disk_waits_to_be_resumed_after_a_restart(
    group: PlannerGroup, tmp_path: Path
) -> None:
    peers = group.peers(flat_with_mug())
    bus = group.planner()
    peers.gate = threading.Event()
    submit(bus, GO)
    wait_until(peers.acting.is_set, 60, "it acts")
    queued = submit(bus, GO).id
    refuse(group.planners[-1]._store)
    bus.call(CANCEL, pb.TaskRequest(id=queued), 5)
    wait_until(lambda: group.healths[-1].state[0] == "degraded", 60, "it is told")
    later = group_after_restart(group, tmp_path)
    bus = later.planner()
    assert (task(bus, queued).state, task(bus, queued).on_hold) == ("queued", True)
    later.close()


def test_only_the_newer_of_two_running_tasks_is_resumed(group: PlannerGroup) -> None:
    group.peers(flat_with_mug())
    mortal, bus = group.mortal(lambda _: True)
    id = submit(bus, GO).id
    wait_until(mortal.dead.is_set, 60, "its worker is dead")
    running = task(bus, id)
    mortal.close()
    stale = pb.Task()
    stale.CopyFrom(running)
    stale.id, stale.started_s = "older", running.started_s - 50
    bus = group.planner()
    group.planners[-1]._store.put(stale)
    group.planners[-1]._store.put(running)
    steps_of = group.planner()
    assert "began another task later" in task(steps_of, "older").message
    assert task(steps_of, "older").state == "failed"


def test_a_pause_works_on_a_full_disk_and_a_resumed_task_waits_for_room(
    group: PlannerGroup,
) -> None:
    peers = group.peers(flat_with_mug())
    bus = group.planner()
    peers.gate = threading.Event()
    id = submit(bus, GO).id
    wait_until(peers.acting.is_set, 60, "it acts")
    with refusing(group.planners[-1]):
        assert bus.call(PAUSE, pb.TaskRequest(id=id), 5).on_hold
        peers.gate.set()
        wait_until(lambda: task(bus, id).state == "paused", 60, "it stands")
        bus.call(RESUME, pb.TaskRequest(id=id), 5)
        wait_until(lambda: "waits for its journal" in task(bus, id).message, 60, "it says so")
        assert peers.world.steps == 1
    assert ended(bus, id).state == "succeeded"


def test_tasks_are_reported_while_the_disk_does_not_answer(group: PlannerGroup) -> None:
    """Reading the state of a task needs no lock that a write holds."""
    group.peers(flat_with_mug())
    bus = group.planner()
    id = submit(bus, GO).id
    ended(bus, id)
    planner = group.planners[-1]
    with planner._registry._writing, planner._store._lock:  # as during a slow write
        assert task(bus, id).state == "succeeded"
        assert len(bus.call(service.LIST_TASKS, pb.Empty(), 5).tasks) == 1


def test_a_late_pause_does_not_change_an_ended_task(group: PlannerGroup) -> None:
    group.peers(flat_with_mug())
    bus = group.planner()
    id = submit(bus, GO).id
    ended(bus, id)
    task_registry = group.planners[-1]._registry
    assert task_registry.change(id, on_hold=True, state=State.PAUSED).state is State.SUCCEEDED
    group.planners[-1].close()
    assert task(group.planner(), id).state == "succeeded"
