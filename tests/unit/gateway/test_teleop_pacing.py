"""The short move that is due for a held teleop command."""

from __future__ import annotations

import math

import pytest
from helios_core.robot import Forward, Turn
from helios_gateway.teleop.pacing import STAND, Command, LatestCommand, MoveLimits, Pacer
from hypothesis import given
from hypothesis import strategies as st

MOVES = MoveLimits(step_m=0.1, back_m=0.0, step_rad=0.1, speed_m_s=0.3, turn_rad_s=0.6)
SHARES = st.floats(-1, 1) | st.just(0.0)


def test_a_command_expires_after_its_hold_time() -> None:
    latest = LatestCommand(0.3)
    assert latest.now(0.0) == STAND
    latest.take(Command(1.0, 0.0), 5.0)
    assert latest.now(5.3) == Command(1.0, 0.0)
    assert latest.now(5.31) == STAND


def test_the_first_move_is_due_at_once_and_the_next_at_the_speed_limit() -> None:
    pacer, ahead = Pacer(MOVES), Command(forward=1.0)
    first = pacer.due(ahead, 0.0)
    assert first is not None
    assert first.action == Forward(0.1)
    assert pacer.due(ahead, 0.33) is None
    assert pacer.due(ahead, 0.34) is not None


def test_a_partial_command_moves_at_that_share_of_the_speed() -> None:
    pacer = Pacer(MOVES)
    assert pacer.due(Command(turn=-0.5), 0.0) is not None
    assert pacer.due(Command(turn=-0.5), 0.32) is None
    due = pacer.due(Command(turn=-0.5), 0.34)
    assert due is not None
    assert due.action == Turn(-0.1)


def test_forward_moves_and_turns_alternate() -> None:
    pacer, both = Pacer(MOVES), Command(1.0, 1.0)
    axes = [due.axis for k in range(200) if (due := pacer.due(both, 0.01 * k))]
    assert axes[:2] == ["forward", "turn"]
    assert axes.count("forward") == pytest.approx(6, abs=1)
    assert axes.count("turn") == pytest.approx(12, abs=1)


@given(st.lists(st.tuples(SHARES, SHARES, st.floats(0, 0.5)), max_size=60))
def test_no_sequence_of_commands_exceeds_the_speed_limits(
    presses: list[tuple[float, float, float]],
) -> None:
    pacer, now_s, driven_m, turned_rad = Pacer(MOVES), 0.0, 0.0, 0.0
    for forward, turn, wait_s in presses:
        now_s += wait_s
        due = pacer.due(Command(forward, turn), now_s)
        if due is not None and isinstance(due.action, Forward):
            driven_m += abs(due.action.distance_m)
        elif due is not None and isinstance(due.action, Turn):
            turned_rad += abs(due.action.angle_rad)
    assert driven_m <= MOVES.step_m + MOVES.speed_m_s * now_s + 1e-9
    assert turned_rad <= MOVES.step_rad + MOVES.turn_rad_s * now_s + 1e-9


def test_a_failed_move_is_not_retried_before_the_command_is_released() -> None:
    pacer, ahead = Pacer(MOVES), Command(forward=1.0)
    due = pacer.due(ahead, 0.0)
    assert due is not None
    pacer.failed(due, "blocked after 0.02 m")
    assert pacer.due(ahead, 9.0) is None
    assert pacer.stuck(ahead)
    assert pacer.blocked == "blocked after 0.02 m"
    assert pacer.due(Command(forward=1.0, turn=1.0), 9.1) is not None  # a turn is another axis
    assert not pacer.stuck(Command(forward=1.0, turn=1.0))
    assert pacer.due(STAND, 9.2) is None
    assert pacer.due(ahead, 9.3) is not None


def test_a_move_that_the_robot_cannot_make_is_reported() -> None:
    pacer = Pacer(MOVES)
    assert pacer.due(Command(forward=-1.0), 0.0) is None
    assert "cannot drive back" in pacer.blocked


@given(st.floats(0, 2), st.floats(0, 2), st.floats(0, 2))
def test_a_step_is_within_the_robots_own_limits(low: float, high: float, back: float) -> None:
    from helios_gateway.message_conversion import robot_description

    from tests.gateway_home import description

    reported = description()
    reported.min_forward_m, reported.max_forward_m, reported.max_back_m = low, low + high, back
    reported.min_turn_rad, reported.max_turn_rad = low, low + high
    moves = MoveLimits.of(robot_description(reported), 0.3, 0.6)
    assert moves.step_m <= reported.max_forward_m
    assert moves.back_m <= back
    assert moves.step_m >= min(low, reported.max_forward_m)
    assert math.isclose(moves.step_rad, min(max(math.radians(5), low), reported.max_turn_rad))
