"""A jump of the wall clock does not change the time limit of a running task."""

from __future__ import annotations

import threading
import time
from dataclasses import replace
from unittest.mock import create_autospec

import pytest
from helios_planner.settings import Settings
from helios_planner.tasks.registry import TaskRegistry, TaskReporter
from helios_planner.tasks.run_control import PauseControl, TimeIsUp
from planner_tasks import a_task


class Clocks:
    """The clocks of a process, set by hand."""

    def __init__(self) -> None:
        self.monotonic_s, self.wall_s = 50.0, 1000.0


@pytest.fixture
def clocks(monkeypatch: pytest.MonkeyPatch) -> Clocks:
    clocks = Clocks()
    monkeypatch.setattr(time, "monotonic", lambda: clocks.monotonic_s)
    monkeypatch.setattr(time, "time", lambda: clocks.wall_s)
    return clocks


@pytest.mark.parametrize("jump_s", [3600.0, -3600.0])
def test_a_jump_neither_ends_a_task_nor_keeps_it_from_ending(clocks: Clocks, jump_s: float) -> None:
    hold = PauseControl(limit_s=20.0, ends_s=1020.0, cancelled=threading.Event())
    clocks.wall_s += jump_s
    hold.check()
    clocks.monotonic_s += 19.0
    hold.check()
    clocks.monotonic_s += 2.0
    with pytest.raises(TimeIsUp, match="20 s are used up"):
        hold.check()


@pytest.mark.parametrize("jump_s", [3600.0, -3600.0])
def test_a_jump_does_not_change_the_remaining_time(clocks: Clocks, jump_s: float) -> None:
    """The robot does an action a second, and the task's time limit is near."""
    registry = create_autospec(TaskRegistry, instance=True)
    task = replace(a_task(), max_steps=1000, started_s=1000.0, time_limit_s=100.0)
    reporter = TaskReporter(registry, task, Settings())
    clocks.wall_s += jump_s
    for step in range(1, 61):
        clocks.monotonic_s += 1.0
        reporter.on_steps(step)
    low_s, high_s = registry.change.call_args.kwargs["eta_s"]
    assert 0 < low_s <= high_s <= 40.0
