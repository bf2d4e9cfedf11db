"""An acknowledged pause: no action begins after it, however the two coincide."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import cast
from unittest.mock import create_autospec

import pytest
from helios_core import proto as pb
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import ACT, GET_STATE
from helios_planner.task import TimeIsUp
from helios_planner.tasks.registry import TaskReporter
from helios_planner.tasks.run_control import Journal, PauseControl, TaskCalls
from helios_planner.tasks.store import Entry, Store

from tests.support import wait_until


class PausedLate(PauseControl):
    """Pauses the task once, just after the check that it is not paused."""

    late = True

    def wait(self, tell: Callable[[bool], None]) -> None:
        super().wait(tell)
        if self.late:
            self.late = False
            self.pause()


class CallRecorder:
    """Records the journal entries, the pauses, and the actions requested of the robot."""

    def __init__(self, hold: PauseControl) -> None:
        self.kept: list[Entry] = []
        self.held: list[bool] = []
        self.acted: list[str] = []
        self.writing: Callable[[], None] = lambda: None
        hub = MemoryHub()
        self._robot = MemoryBus(hub)
        self._robot.serve(ACT, self._act)
        self._robot.serve(GET_STATE, lambda _: pb.RobotState(held="mug"))
        store = create_autospec(Store, instance=True, fault="")
        store.keep.side_effect = self._keep
        reporter = create_autospec(TaskReporter, instance=True)
        reporter.on_hold.side_effect = self.held.append
        journal = Journal(store, "task", Entry())
        self.bus = TaskCalls(MemoryBus(hub), journal, hold, reporter, keep_within_s=1.0)

    def _keep(self, task_id: str, entry: Entry) -> bool:
        self.writing()
        self.kept.append(entry)
        return True

    def act_once(self) -> threading.Thread:
        """Ask for one action in a thread."""
        ask = pb.ActionRequest(action_id="task-1")
        thread = threading.Thread(target=lambda: self.bus.call(ACT, ask, 5), daemon=True)
        thread.start()
        return thread

    def _act(self, request: pb.ActionRequest) -> pb.ActionResult:
        self.acted.append(request.action_id)
        return pb.ActionResult(action_id=request.action_id, succeeded=True)


def hold_of(kind: type[PauseControl]) -> PauseControl:
    return kind(0.0, 0.0, threading.Event())


def test_a_pause_just_before_an_action_blocks_the_action_and_its_journal_entry() -> None:
    hold = hold_of(PausedLate)
    notes = CallRecorder(hold)
    thread = notes.act_once()
    wait_until(lambda: notes.held == [True] or notes.acted, 60, "the task stands, or acts")
    assert not notes.acted
    assert not notes.kept
    hold.resume()
    thread.join(10)
    assert notes.acted == ["task-1"]
    assert notes.held == [True, False]


def test_a_pause_is_acknowledged_after_an_action_that_began_before_it() -> None:
    hold = hold_of(PauseControl)
    notes = CallRecorder(hold)
    writes, go_on, answered = threading.Event(), threading.Event(), threading.Event()

    def writing() -> None:
        writes.set()
        go_on.wait(10)

    notes.writing = writing
    thread = notes.act_once()
    assert writes.wait(10)

    def pause() -> None:
        hold.pause()
        assert notes.kept, "the action was begun after the answer"
        answered.set()

    threading.Thread(target=pause, daemon=True).start()
    go_on.set()
    assert answered.wait(10)
    thread.join(10)
    assert notes.acted == ["task-1"]
    second = notes.act_once()
    wait_until(lambda: notes.held == [True], 60, "the next action waits")
    assert len(notes.acted) == 1
    hold.resume()
    second.join(10)


def test_once_a_task_is_over_its_reads_have_no_time_limit_but_its_actions_have() -> None:
    notes = CallRecorder(PauseControl(1.0, 0.0, threading.Event()))  # its time is over
    with pytest.raises(TimeIsUp):
        notes.bus.call(GET_STATE, pb.Empty(), 5)
    notes.bus.task_over = True
    assert notes.bus.call(GET_STATE, pb.Empty(), 5).held == "mug"
    with pytest.raises(TimeIsUp):
        notes.bus.call(ACT, pb.ActionRequest(action_id="task-1"), 5)
    assert notes.acted == []


@pytest.mark.parametrize("kept", [True, False])
def test_begin_returns_whether_the_journal_entry_was_written(kept: bool) -> None:
    hold = hold_of(PauseControl)
    assert hold.begin(lambda: kept) is kept
    hold.pause()
    assert hold.begin(lambda: cast(bool, pytest.fail("it began while paused"))) is None
