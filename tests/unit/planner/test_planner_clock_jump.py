"""A jump of the wall clock does not change the time limit of a running task."""

from __future__ import annotations

import threading
import time

import pytest
from helios_planner.tasks.run_control import PauseControl, TimeIsUp


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
