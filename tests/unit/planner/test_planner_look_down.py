"""The robot looks down at unknown ground at its feet before it gives up a goal."""

from __future__ import annotations

import pytest
from helios_core.robot import Tilt
from helios_planner.motion_planning.costmap import Pose2
from helios_planner.navigation import base_controller as legs_module
from helios_planner.navigation.base_controller import BaseController, Outcome, base_controller_for
from helios_planner.settings import Settings
from planner_eye import CELL_M
from planner_flat import flat
from planner_world import FakeWorld
from test_planner_lattice import BoxWorld


@pytest.mark.parametrize("kind", [FakeWorld, BoxWorld])
def test_the_robot_looks_down_at_unknown_ground_that_is_too_near_to_see_while_driving(
    kind: type[FakeWorld],
) -> None:
    """A band of unknown ground lies between the robot and its goal, nearer than its camera sees."""
    world = kind((7, 4), [], [], Pose2(2.0, 2.0, 0.0))
    world._known[:] = True
    world._known[:, round(2.75 / CELL_M) : round(2.9 / CELL_M)] = False
    base = base_controller_for(world, Settings())
    base.tilt(base.settings.travel_tilt_rad)
    assert not base._wedged()
    assert base.go_to(Pose2(4.5, 2.0, 0.0), "test") is Outcome.ARRIVED
    down_rad = max(a.angle_rad for a in world.log if isinstance(a, Tilt))
    assert down_rad > base.settings.travel_tilt_rad + 0.1


def test_a_robot_surrounded_by_unseen_ground_is_not_wedged() -> None:
    world = flat(start=Pose2(2.0, 3.0, 0.0))
    world._known[:] = True
    row, column = round(3.0 / CELL_M), round(2.0 / CELL_M)
    near = round(0.9 / CELL_M)  # its camera sees the ground from 1 m on
    world._known[row - near : row + near, column - near : column + near] = False
    base = BaseController(world, Settings())
    base.tilt(base.settings.travel_tilt_rad)
    assert base._wedged()
    assert base.go_to(Pose2(3.5, 3.0, 0.0), "test") is Outcome.ARRIVED
    assert base.monitor.wedged == 0


def test_the_robot_looks_down_at_its_feet_before_it_gives_up_a_goal_without_a_motion(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    base = BaseController(flat(start=Pose2(1.5, 3.0, 0.0)), Settings())
    base.look_around()
    looks = [True, False]  # whether there was anything to see

    def without_motion(*_: object) -> None:
        return None

    monkeypatch.setattr(legs_module, "next_primitive", without_motion)
    monkeypatch.setattr(base, "look_down_around", lambda: looks.pop(0))
    assert base.go_to(Pose2(3.5, 3.0, 0.0), "test") is Outcome.UNREACHABLE
    assert looks == [False]  # once is enough
