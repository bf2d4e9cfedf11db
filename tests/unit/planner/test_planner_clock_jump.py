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


@pytest.mark.parametrize("jump_s", [3600.0, -3600.0])
def test_a_jump_neither_ends_a_task_nor_keeps_it_from_ending(
    monkeypatch: pytest.MonkeyPatch, jump_s: float
) -> None:
    monotonic_s, wall_s = [50.0], [1000.0]
    monkeypatch.setattr(time, "monotonic", lambda: monotonic_s[0])
    monkeypatch.setattr(time, "time", lambda: wall_s[0])
    hold = PauseControl(limit_s=20.0, ends_s=1020.0, cancelled=threading.Event())
    wall_s[0] += jump_s
    hold.check()
    monotonic_s[0] += 19.0
    hold.check()
    monotonic_s[0] += 2.0
    with pytest.raises(TimeIsUp, match="20 s are used up"):
        hold.check()


@pytest.mark.parametrize("jump_s", [3600.0, -3600.0])
def test_a_jump_does_not_change_the_remaining_time(
    monkeypatch: pytest.MonkeyPatch, jump_s: float
) -> None:
    """The robot does an action a second, and the task's time limit is near."""
    monotonic_s, wall_s = [50.0], [1000.0]
    monkeypatch.setattr(time, "monotonic", lambda: monotonic_s[0])
    monkeypatch.setattr(time, "time", lambda: wall_s[0])
    registry = create_autospec(TaskRegistry, instance=True)
    task = replace(a_task(), max_steps=1000, started_s=1000.0, time_limit_s=100.0)
    reporter = TaskReporter(registry, task, Settings())
    wall_s[0] += jump_s
    for step in range(1, 61):
        monotonic_s[0] += 1.0
        reporter.on_steps(step)
    low_s, high_s = registry.change.call_args.kwargs["eta_s"]
    assert 0 < low_s <= high_s <= 40.0
