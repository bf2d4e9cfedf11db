"""The driver contract waits for a robot that is not there yet."""

from __future__ import annotations

from typing import cast

import pytest
from helios_contract import rig
from helios_core.errors import Unavailable
from helios_core.robot import RobotDriver


class Late:
    """A robot that describes itself from the n-th call on."""

    def __init__(self, calls: int) -> None:
        self.left = calls

    def describe(self) -> None:
        self.left -= 1
        if self.left > 0:
            raise Unavailable("no image has come yet")


def test_a_robot_that_is_found_late_is_waited_for() -> None:
    late = Late(3)
    made = rig.Rig(cast(RobotDriver, late))
    assert made.ready() is made
    assert late.left == 0


def test_a_robot_that_never_comes_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rig, "READY_WITHIN_S", 0.15)
    with pytest.raises(Unavailable, match="no image"):
        rig.Rig(cast(RobotDriver, Late(10**6))).ready()
