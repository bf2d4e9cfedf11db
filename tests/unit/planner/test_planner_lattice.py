"""The lattice planner for box-shaped robots: they pass doors lengthwise and touch nothing."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from helios_core.robot import Action, ActionResult, Forward, Turn
from helios_planner.motion_planning.costmap import GroundMap, Pose2
from helios_planner.motion_planning.lattice_planner import Capsule, PoseReach, pose_reach
from helios_planner.motion_planning.path_planner import MotionRules, reach
from helios_planner.navigation.base_controller import (
    BaseController,
    Outcome,
    PoseBaseController,
    base_controller_for,
)
from helios_planner.settings import Settings
from hypothesis import example, given, settings
from hypothesis import strategies as st
from planner_eye import CELL_M, ROBOT
from planner_things import Box
from planner_world import FakeWorld

BOX_M = (1.1, 0.5)
SPOT = Capsule.around(*BOX_M)
NOWHERE = Pose2(0.0, 0.0, 0.0)
RULES = MotionRules(footprint_m=SPOT.reach_m, margin_m=0.05)


def two_rooms(door_m: float) -> GroundMap:
    """Make 7 x 4 m with a wall at x = 3.5 and a door in its middle."""
    occupancy = np.zeros((160, 280), np.int8)
    occupancy[[0, -1]], occupancy[:, [0, -1]] = 100, 100
    half = round(door_m / CELL_M / 2)
    occupancy[: 80 - half, 138:142], occupancy[80 + half :, 138:142] = 100, 100
    return GroundMap(occupancy, np.zeros(occupancy.shape, np.float32), CELL_M, (0.0, 0.0))


def box_points(pose: Pose2) -> np.ndarray:
    """Return points [n, 2] that cover the box at a pose."""
    x, y = np.meshgrid(np.linspace(-0.55, 0.55, 56), np.linspace(-0.25, 0.25, 26))
    c, s = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
    return np.stack([pose.x_m + c * x - s * y, pose.y_m + s * x + c * y], -1).reshape(-1, 2)


def touches(ground: GroundMap, pose: Pose2) -> bool:
    cells = ground.cells_of(box_points(pose))
    beyond = (cells < 0) | (cells >= np.array(ground.occupancy.shape))
    return bool(beyond.any() or (ground.occupancy[cells[:, 0], cells[:, 1]] > 0).any())


def after(pose: Pose2, move: Forward | Turn, share: float = 1.0) -> Pose2:
    if isinstance(move, Turn):
        return Pose2(pose.x_m, pose.y_m, pose.yaw_rad + share * move.angle_rad)
    away = share * move.distance_m
    return Pose2(
        pose.x_m + away * math.cos(pose.yaw_rad),
        pose.y_m + away * math.sin(pose.yaw_rad),
        pose.yaw_rad,
    )


@pytest.mark.parametrize(("door_m", "passes"), [(0.6, False), (0.8, True), (0.9, True)])
def test_a_door_is_passed_only_if_the_box_fits_lengthwise(door_m: float, passes: bool) -> None:
    ground = two_rooms(door_m)
    reached = pose_reach(ground, Pose2(1.5, 1.2, 2.0), SPOT, RULES)
    there = Pose2(5.5, 2.0, 0.0)
    assert (reached.best_near(there, 0.2) is not None) is passes
    disc = reach(ground, Pose2(1.5, 1.2, 2.0), MotionRules(SPOT.reach_m))
    assert not np.isfinite(disc.at(np.array([there.xy]))[0])


def test_a_box_fits_into_a_door_only_lengthwise() -> None:
    reached = pose_reach(two_rooms(0.9), Pose2(1.5, 2.0, 0.0), SPOT, RULES)
    assert reached.fits(Pose2(3.5, 2.0, 0.0))
    assert not reached.fits(Pose2(3.5, 2.0, math.pi / 2))


@pytest.mark.parametrize("cell_m", [0.0125, 0.025, 0.05])
def test_no_turn_is_planned_where_the_box_cannot_turn(cell_m: float) -> None:
    """The corridor is a little too narrow to turn in, at every cell size."""
    occupancy = np.zeros((round(1.35 / cell_m), round(4.0 / cell_m)), np.int8)
    occupancy[[0, -1]], occupancy[:, [0, -1]] = 100, 100
    ground = GroundMap(occupancy, np.zeros(occupancy.shape, np.float32), cell_m, (0.0, 0.0))
    reached = pose_reach(ground, Pose2(2.0, 0.675, 0.0), SPOT, RULES)
    across = reached.best_near(Pose2(2.5, 0.675, math.pi / 2), 0.2)
    assert across is not None  # the robot gets there, but faces along the corridor
    assert reached.next_move(reached.way_to(across), RULES) is not None
    headings = np.unique(np.argwhere(np.isfinite(reached.times))[:, 0])
    assert not {6, 7, 8, 9, 10} & set(headings.tolist()), (
        "of 32 from -180 degrees on, those that face a wall"
    )


@settings(max_examples=60, deadline=None)
@example(6.34375, 0.625, 0.5)  # the rear is as near to an obstacle as the front
@given(st.floats(0.6, 6.4), st.floats(0.6, 3.4), st.floats(-3.1, 3.1))
def test_a_backward_move_touches_nothing(x: float, y: float, yaw: float) -> None:
    ground, pose = two_rooms(0.9), Pose2(x, y, yaw)
    if touches(ground, pose):
        return
    free_m = pose_reach(ground, pose, SPOT, RULES).free_back_m(0.3, RULES)
    assert free_m == 0.0 or 0.1 - 1e-9 <= free_m <= 0.3
    for away in np.linspace(0, free_m, 12):
        assert not touches(ground, pose.ahead(-away))


def test_a_box_moves_back_only_if_there_is_room_behind_it() -> None:
    ground = two_rooms(0.9)
    free = [
        pose_reach(ground, Pose2(x, 2.0, 0.0), SPOT, RULES).free_back_m(0.3, RULES)
        for x in (2.0, 0.68)
    ]
    assert free == [0.3, 0.0]


def drive(
    ground: GroundMap, pose: Pose2, goal: Pose2, slip: Callable[[], Pose2] = lambda: NOWHERE
) -> Pose2:
    """Follow the path, planned again before every motion, until it ends or is lost. No intermediate
    pose may touch anything. slip: the error at the end of a motion, in m and rad."""
    lattice_xy = None
    for _ in range(160):
        reached = pose_reach(ground, pose, SPOT, RULES, lattice_xy=lattice_xy)
        end = reached.best_near(goal, 0.2)
        move = None if end is None else reached.next_move(reached.way_to(end), RULES)
        if move is None:
            if not reached.kept:
                return pose
            lattice_xy = None
            continue
        lattice_xy = reached.node_xy
        if isinstance(move, Turn):
            assert RULES.min_turn_rad - 1e-9 <= abs(move.angle_rad) <= RULES.max_turn_rad + 1e-9
        else:
            assert RULES.min_forward_m - 1e-9 <= move.distance_m <= RULES.max_forward_m
        assert not any(touches(ground, after(pose, move, s)) for s in np.linspace(0, 1, 12))
        pose, off = after(pose, move), slip()
        slipped = Pose2(pose.x_m + off.x_m, pose.y_m + off.y_m, pose.yaw_rad + off.yaw_rad)
        pose = pose if touches(ground, slipped) else slipped
    return pose


def test_a_box_passes_a_door_and_ends_with_the_wanted_heading() -> None:
    goal = Pose2(5.5, 2.6, math.pi / 2)
    end = drive(two_rooms(0.9), Pose2(1.5, 1.2, 2.0), goal)
    assert end.distance_m(goal.xy) < 0.2
    assert abs(end.yaw_rad % (2 * math.pi) - math.pi / 2) < math.radians(12)


def cluttered(seed: int) -> tuple[GroundMap, Pose2]:
    """Make two rooms with four obstacles in them, and a robot's pose."""
    rng = np.random.default_rng(seed)
    ground = two_rooms(0.9)
    for _ in range(4):
        r, c = rng.integers(4, 150), rng.integers(4, 270)
        h, w = rng.integers(2, 14, 2)
        ground.occupancy[r : r + h, c : c + w] = 100
    return ground, Pose2(1.2, 2.0, float(rng.uniform(-3, 3)))


THERE = Pose2(5.8, 2.0, 0.0)


@settings(max_examples=6, deadline=None)
@given(st.integers(0, 10_000))
def test_no_pose_on_a_path_touches_anything(seed: int) -> None:
    """Holds wherever the robot gets to, also when it slips."""
    ground, start = cluttered(seed)
    if pose_reach(ground, start, SPOT, RULES).least_slack_m < 0:
        return
    rng = np.random.default_rng(seed)
    drive(ground, start, THERE, lambda: Pose2(*rng.normal(0, 0.008, 3)))


@pytest.mark.parametrize("seed", [2, 3, 9, 33, 145])
def test_a_path_is_not_lost_when_it_is_planned_again(seed: int) -> None:
    """A gap fits the first lattice but not one planned halfway (9, 33), or it needs a heading that
    a largest plus a smallest turn overshoot (145)."""
    ground, start = cluttered(seed)
    assert drive(ground, start, THERE).distance_m(THERE.xy) < 0.25


class BoxWorld(FakeWorld):
    """A fake world with a robot of that box."""

    description = replace(ROBOT, footprint_radius_m=SPOT.reach_m, footprint_box_m=BOX_M)

    def _touches(self, pose: Pose2) -> bool:
        points = box_points(pose)
        rows, columns = (points[:, 1] / CELL_M).astype(int), (points[:, 0] / CELL_M).astype(int)
        return bool((self.truth_top[rows, columns] > 0).any())

    def _do(self, action: Action) -> ActionResult:
        if not isinstance(action, Forward | Turn):
            return super()._do(action)
        for share in np.linspace(0, 1, 12):
            if self._touches(after(self._pose, action, float(share))):
                self.contacts += 1
                return ActionResult(False, "touched something", collided=True)
        before, self._pose = self._pose, after(self._pose, action)
        moved_m = before.distance_m(self._pose.xy)
        return ActionResult(True, moved_m=moved_m, turned_rad=getattr(action, "angle_rad", 0.0))


def test_a_box_drives_through_an_unknown_home_without_contact() -> None:
    walls = [Box(3.4, 0, 3.5, 1.5, 2.5), Box(3.4, 2.4, 3.5, 4, 2.5)]
    world = BoxWorld((7, 4), walls, [], Pose2(1.5, 2.0, 0.4))
    base = base_controller_for(world, Settings())
    assert isinstance(base, PoseBaseController)
    base.look_around()
    assert base.go_to(Pose2(2.6, 1.95, 0.0), "test") is Outcome.ARRIVED
    assert base.go_to(Pose2(5.2, 2.0, 0.0), "test") is Outcome.ARRIVED
    assert world.contacts == 0
    assert isinstance(base.reach(), PoseReach)


def test_a_box_that_never_comes_nearer_gives_the_goal_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a slippery floor the robot ends each move where it began, and sees nothing new."""
    world = BoxWorld((7, 4), [], [], Pose2(1.5, 2.0, 0.0))
    world._known[:] = True
    monkeypatch.setattr(world, "look", lambda: None)
    monkeypatch.setattr(world, "_do", lambda _: ActionResult(True, moved_m=0.2))
    assert (
        base_controller_for(world, Settings()).go_to(Pose2(3.5, 2.0, 0.0), "test")
        is Outcome.UNREACHABLE
    )
    assert 80 <= world.steps <= 80 + 20 * 2 + 1  # one tilts the head


def test_a_disc_robot_keeps_its_own_base_controller() -> None:
    world = FakeWorld((7, 4), [], [], Pose2(1.5, 2.0, 0.4))
    assert type(base_controller_for(world, Settings())) is BaseController
