"""The moves of `helios doctor --robot` on robots that cannot make them."""

from __future__ import annotations

from typing import Any, cast

import pytest
from helios_client.commands.doctor_robot import check_robot
from helios_client.sdk import Helios

SO_FAR = {"checks": []}


class Robot:
    """The two calls that need no motion; any other one is an AttributeError."""

    def __init__(self, description: dict[str, Any]) -> None:
        self._description = description

    def robot(self) -> dict[str, Any]:
        return {"description": self._description}

    def robot_checks(self) -> dict[str, Any]:
        return SO_FAR


@pytest.mark.parametrize(
    ("can_move", "lacks"), [(False, "offers no motion"), (True, "offers no turns")]
)
def test_a_robot_that_cannot_move_or_turn_keeps_its_results_without_a_move(
    can_move: bool, lacks: str
) -> None:
    robot = Robot({"can_move": can_move, "max_turn_rad": 0.0, "max_forward_m": 0.5})
    told: list[str] = []
    found = check_robot(cast(Helios, robot), drive=True, tell=told.append)
    assert found == (SO_FAR, "")
    assert len(told) == 1
    assert lacks in told[0]
