"""Tests when a released object is at rest: 50 consecutive control steps of 1/30 s."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helios_sim.gripper import Graspable, Gripper, RestState

DT_S = 0.01
ENOUGH = 167  # steps: 50 / 30 s
LONGEST = 600  # steps: 6 s
MUG = Graspable("mug_0", 0, 0, 0, (), (0.05, 0.05, 0.05))
SOFA, FLOOR = 7, 8


@dataclass(frozen=True)
class PhysicsStep:
    """One physics step: the object's speeds, and the bodies that it touches with heights."""

    linear_m_s: float = 0.0
    angular_rad_s: float = 0.0
    on: tuple[tuple[int, float], ...] = ((SOFA, 0.4),)


STILL = PhysicsStep()
MOVES = PhysicsStep(linear_m_s=0.0051)
TURNS = PhysicsStep(angular_rad_s=0.051)
FALLS = PhysicsStep(on=())
JUMPS = PhysicsStep(linear_m_s=0.2)


def settled(moments: Sequence[PhysicsStep]) -> RestState:
    """The gripper's result for a sequence of steps; the last step repeats forever."""
    data = SimpleNamespace(
        qpos=np.array([0.0, 0, 0, 1, 0, 0, 0]),
        qvel=np.zeros(6),
        body_awake=[True],
        xpos=np.zeros((1, 3)),
    )
    count, turned_rad = 0, 0.0

    def step() -> None:
        nonlocal count, turned_rad
        now = moments[min(count, len(moments) - 1)]
        data.qvel[:] = [0, 0, now.linear_m_s, now.angular_rad_s, 0, 0]
        turned_rad += now.angular_rad_s * DT_S
        data.qpos[2] += now.linear_m_s * DT_S
        data.qpos[3:5] = np.cos(turned_rad / 2), np.sin(turned_rad / 2)
        hand.touched_by = lambda _: dict(now.on)
        count += 1

    model = SimpleNamespace(opt=SimpleNamespace(timestep=DT_S))
    hand: Any = SimpleNamespace(_data=data, _model=model, step=step)
    rest = Gripper.settle(hand, MUG)
    assert count <= LONGEST
    return rest


@pytest.mark.parametrize("restless", [MOVES, TURNS, FALLS])
def test_an_object_is_at_rest_after_fifty_consecutive_still_control_steps(
    restless: PhysicsStep,
) -> None:
    assert settled([STILL] * ENOUGH + [restless]).at_rest
    assert not settled([STILL] * (ENOUGH - 1) + [restless]).at_rest
    assert settled([restless] * (LONGEST - ENOUGH) + [STILL]).at_rest
    assert not settled([restless] * (LONGEST - ENOUGH // 2) + [STILL]).at_rest


@pytest.mark.parametrize("restless", [JUMPS, FALLS])
def test_an_object_that_leaves_its_place_again_and_again_is_not_at_rest(
    restless: PhysicsStep,
) -> None:
    assert not settled(([STILL] * (ENOUGH - 1) + [restless]) * 4).at_rest


def test_an_object_that_trembles_in_its_place_is_at_rest() -> None:
    there = PhysicsStep(linear_m_s=0.04, angular_rad_s=0.5)
    back = PhysicsStep(linear_m_s=-0.04, angular_rad_s=-0.5)
    rest = settled([there, back] * LONGEST)
    assert (rest.at_rest, rest.on) == (True, {SOFA: 0.4})
    assert not settled([there, there, back] * LONGEST).at_rest  # it wanders off
    assert not settled([there, replace(back, on=())] * LONGEST).at_rest  # it bounces


def test_an_object_slower_than_the_limits_is_at_rest() -> None:
    assert settled([PhysicsStep(linear_m_s=0.0049, angular_rad_s=0.049)]).at_rest


def test_only_a_body_in_contact_throughout_supports_the_object() -> None:
    """A body in brief contact counts only as touched."""
    both = replace(STILL, on=((SOFA, 0.4), (FLOOR, 0.0)))
    rest = settled([both, *[STILL] * (ENOUGH - 1)])
    assert (rest.at_rest, rest.on, rest.touched_any_time) == (True, {SOFA: 0.4}, {SOFA, FLOOR})
    late = settled([*[STILL] * (ENOUGH - 1), both])
    assert (late.at_rest, late.on, late.touched_any_time) == (True, {SOFA: 0.4}, {SOFA, FLOOR})


def test_the_contact_height_is_that_of_the_last_step() -> None:
    sinking = [replace(STILL, on=((SOFA, 0.5),)), STILL]
    assert settled(sinking).on == {SOFA: 0.4}
