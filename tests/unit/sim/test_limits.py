"""Tests which actions the robot refuses to begin."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from helios_core.robot import Action, Forward, Observe, Pick, Place, Tilt, Turn
from helios_sim.action_limits import limit_violation
from helios_sim.robot_model import description

ROBOT = description()
LOW_TILT, HIGH_TILT = ROBOT.tilt_range_rad
NOWHERE = (math.nan, math.inf, -math.inf)


@pytest.mark.parametrize(
    "action",
    [
        Forward(ROBOT.min_forward_m),
        Forward(ROBOT.max_forward_m),
        Forward(-ROBOT.max_back_m),
        Forward(-ROBOT.min_forward_m),
        Turn(ROBOT.max_turn_rad),
        Turn(-ROBOT.min_turn_rad),
        Tilt(LOW_TILT),
        Tilt(HIGH_TILT),
        Observe(),
        Pick((99.0, 0.0, 0.5), "mug"),
        Place((0.0, -99.0, 0.5)),
    ],
)
def test_an_action_within_the_limits_is_accepted(action: Action) -> None:
    """Also a pick or place too far away: it counts as an attempt."""
    assert limit_violation(action, ROBOT) == ""


@pytest.mark.parametrize(
    "action",
    [
        Forward(ROBOT.min_forward_m - 1e-3),
        Forward(ROBOT.max_forward_m + 1e-3),
        Forward(-0.5),
        Forward(-ROBOT.max_back_m - 1e-3),
        Forward(-ROBOT.min_forward_m + 1e-3),
        Forward(0.0),
        Turn(ROBOT.max_turn_rad + 1e-3),
        Turn(ROBOT.min_turn_rad / 2),
        Turn(0.0),
        Tilt(LOW_TILT - 1e-3),
        Tilt(HIGH_TILT + 1e-3),
    ],
)
def test_an_action_beyond_the_limits_is_refused(action: Action) -> None:
    assert "outside" in limit_violation(action, ROBOT)


def test_moving_back_is_refused_for_a_robot_that_cannot_move_back() -> None:
    assert "back 0.1 m" in limit_violation(Forward(-0.1), replace(ROBOT, max_back_m=0.0))


@pytest.mark.parametrize("x", NOWHERE)
def test_a_value_that_is_not_finite_is_refused(x: float) -> None:
    """NaN exceeds no limit: a pick at NaN would take an arbitrary object."""
    for action in (Forward(x), Turn(x), Tilt(x)):
        assert limit_violation(action, ROBOT)
    for point in ((x, 0.0, 0.0), (0.0, x, 0.0), (0.0, 0.0, x)):
        assert "finite" in limit_violation(Pick(point, "mug"), ROBOT)
        assert "finite" in limit_violation(Place(point), ROBOT)
