"""Monitor of the robot's set-up: it never holds up the thread that publishes keyframes."""

from __future__ import annotations

import threading
from dataclasses import replace
from typing import cast

import pytest
from helios_bridge.bridge_health import BridgeHealth
from helios_bridge.setup_monitor import SetupMonitor
from helios_core.geometry import Pinhole
from helios_core.robot import Capture
from helios_core.robot_checks.checks import RobotChecks
from helios_core.types import RobotDescription

from tests.support import wait_until

CAPTURE = cast(Capture, None)  # no check looks at it here
CAMERA = Pinhole(100.0, 100.0, 32.0, 24.0, 64, 48)


ROBOT = RobotDescription("r", 0.3, 1.4, CAMERA, 1.2, 0.0, 5.0)


def test_a_running_check_does_not_hold_up_the_next_keyframe(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    began, may_end = threading.Event(), threading.Event()

    def long_check(*_: object) -> None:
        began.set()
        may_end.wait(30)

    monkeypatch.setattr(RobotChecks, "add", long_check)
    monkeypatch.setattr("helios_bridge.setup_monitor.free_ahead_m", lambda *_: 0.5)
    monitor = SetupMonitor(ROBOT, cast(BridgeHealth, None))
    ending = threading.Event()
    checking = threading.Thread(target=monitor.run, args=(ending,))
    checking.start()
    try:
        monitor.add(CAPTURE, "world")
        assert began.wait(10)
        adding = threading.Thread(target=monitor.add, args=(CAPTURE, "world"), daemon=True)
        adding.start()
        wait_until(lambda: not adding.is_alive(), 60, "the keyframe is added")
    finally:
        may_end.set()
        ending.set()
        checking.join(10)
    assert monitor.results().free_ahead_m == 0.5


def test_the_checks_of_a_robot_that_moves_but_cannot_turn_say_what_is_left_out() -> None:
    monitor = SetupMonitor(
        replace(ROBOT, min_turn_rad=0.0, max_turn_rad=0.0), cast(BridgeHealth, None)
    )
    monitor.restart()
    words = {check.name: check.words for check in monitor.results().checks}
    for name in ("heading drift", "time offset"):
        assert words[name].startswith("left out: the robot offers no turns")
