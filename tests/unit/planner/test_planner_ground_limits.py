"""Robots and cells of every size, at every edge of small maps: results are defined and not NaN."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helios_core.geometry import Pinhole
from helios_core.robot import Forward, Turn
from helios_core.types import ObjectInstance, RobotDescription
from helios_planner.motion_planning.base_placement import (
    AheadRules,
    GazeRules,
    PlaceRules,
    edge_spot,
    gaze_points,
    highest_ahead,
    place_spots,
    stand_for,
    top_at_m,
)
from helios_planner.motion_planning.costmap import GroundMap, Pose2, blind_m, unknown_near
from helios_planner.motion_planning.lattice_planner import Capsule, pose_reach
from helios_planner.motion_planning.path_planner import (
    MotionRules,
    Reach,
    free_ahead_m,
    next_primitive,
    reach,
    straightened,
)
from helios_planner.navigation.base_controller import near_ground_unknown
from helios_planner.search.base import next_place
from hypothesis import assume, given, settings
from hypothesis import strategies as st

CAMERA = Pinhole(fx=120.0, fy=120.0, cx=80.0, cy=60.0, width=160, height=120)

footprints_m = st.floats(0.1, 0.6)
yaws = st.floats(-math.pi, math.pi)


def described(footprint_m: float) -> RobotDescription:
    return RobotDescription(
        name="any",
        camera=CAMERA,
        footprint_radius_m=footprint_m,
        height_m=1.4,
        camera_height_m=1.3,
        camera_forward_m=0.1,
        reach_m=0.9,
        max_depth_m=5.0,
    )


@st.composite
def grounds(draw: st.DrawFn, least: int = 1) -> GroundMap:
    """Draw a map of `least` to 40 cells a side: free, unknown and occupied cells in any mixture."""
    rows, columns = draw(st.integers(least, 40)), draw(st.integers(least, 40))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    shares = draw(st.sampled_from([(1, 0, 0), (0, 1, 0), (0, 0, 1), (6, 1, 1), (20, 0, 1)]))
    occupancy = rng.choice(
        np.array([0, -1, 100], np.int8), (rows, columns), p=np.array(shares) / sum(shares)
    )
    if draw(st.booleans()) and rows:
        occupancy[0] = occupancy[-1] = 100
    top_m = np.where(occupancy > 0, rng.uniform(0.05, 2.0, occupancy.shape), 0).astype(np.float32)
    origin_m = draw(st.tuples(st.floats(-20, 20), st.floats(-20, 20)))
    return GroundMap(occupancy, top_m, draw(st.floats(0.02, 0.1)), origin_m)


@st.composite
def points_on(draw: st.DrawFn, ground: GroundMap, off_m: float) -> tuple[float, float]:
    """Draw a point on the map, on its edges and corners too, or up to `off_m` off it."""

    def along(cells: int, origin_m: float) -> float:
        length_m = cells * ground.cell_m
        ends = st.sampled_from([0.0, length_m, length_m / 2, length_m - 1e-6])
        return origin_m + draw(ends | st.floats(-off_m, length_m + off_m))

    rows, columns = ground.occupancy.shape
    return along(columns, ground.origin_m[0]), along(rows, ground.origin_m[1])


@st.composite
def scenes(draw: st.DrawFn) -> tuple[GroundMap, Pose2]:
    ground = draw(grounds())
    return ground, Pose2(*draw(points_on(ground, 1.5)), draw(yaws))


@st.composite
def instances(draw: st.DrawFn, ground: GroundMap) -> ObjectInstance:
    """Draw an instance on the map or off it, of any size, with an outline or without."""
    x_m, y_m = draw(points_on(ground, 3.0))
    size_m = np.array(draw(st.tuples(*[st.floats(0.0, 2.0)] * 3)))
    corners = draw(st.sampled_from([0, 1, 3, 7]))
    angles = np.linspace(0, 2 * np.pi, corners, endpoint=False)
    hull = np.stack([x_m + size_m[0] * np.cos(angles), y_m + size_m[1] * np.sin(angles)], -1)
    return ObjectInstance(
        1, "thing", np.array([x_m, y_m, draw(st.floats(0.0, 2.0))]), size_m, 0.4, 0.5, 0.1, 3, 9,
        {}, 0.5, hull.reshape(-1, 2), draw(st.floats(0.0, 2.0)),
    )  # fmt: skip


def finite(*values: float) -> bool:
    return all(math.isfinite(v) for v in values)


def check(reached: Reach, robot: Pose2) -> None:
    """Check that the arrays fit the map and hold no NaN, and that the robot is on the map."""
    shape = reached.ground.occupancy.shape
    assert reached.clearance.shape == reached.required_m.shape == reached.arrival.shape == shape
    for field in (reached.clearance, reached.required_m, reached.slack):
        assert np.isfinite(field).all()
    assert not np.isnan(reached.arrival).any()
    assert (reached.arrival >= 0).all()
    assert reached.ground.inside(reached.ground.cells_of(np.array([robot.xy])))[0]


@settings(max_examples=300, deadline=None)
@given(st.data())
def test_reach_of_a_disc_is_well_defined_at_any_pose(data: st.DataObject) -> None:
    ground, robot = data.draw(scenes())
    rules = MotionRules(data.draw(footprints_m), data.draw(st.sampled_from([0.0, 0.02, 0.05])))
    discs = np.array([[*data.draw(points_on(ground, 3.0)), data.draw(st.floats(0.01, 0.8))]])
    reached = reach(ground, robot, rules, marks_m=discs, trusted_m=discs[::-1])
    check(reached, robot)
    goal = data.draw(points_on(ground, 4.0))
    place = reached.nearest(goal, data.draw(st.floats(0.05, 2.0)))
    corners = np.empty((0, 2))
    if place is not None:
        corners = straightened(reached.route_to(place), reached)
        assert len(corners)
        assert np.isfinite(corners).all()
    assert not np.isnan(reached.at(np.array([goal, robot.xy]))).any()
    reached.route_to(goal)
    move = next_primitive(corners, reached, rules)
    if isinstance(move, Forward):
        assert rules.min_forward_m <= move.distance_m <= rules.max_forward_m
    if isinstance(move, Turn):
        assert 0 < abs(move.angle_rad) <= 2 * rules.max_turn_rad
    assert 0 <= free_ahead_m(reached, 1.0, rules) <= 1.0
    assert 0 <= reached.free_back_m(0.3, rules) <= 0.3
    place = next_place(reached, [goal], 1.0)
    assert place is None or finite(*place)


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_reach_of_a_box_is_well_defined_at_any_pose(data: st.DataObject) -> None:
    ground, robot = data.draw(scenes())
    width_m = data.draw(st.floats(0.1, 0.6))
    capsule = Capsule.around(data.draw(st.floats(width_m, 1.2)), width_m)
    rules = MotionRules(capsule.reach_m, data.draw(st.sampled_from([0.0, 0.05])))
    kept = data.draw(st.none() | st.just(robot.xy) | points_on(ground, 2.0))
    reached = pose_reach(ground, robot, capsule, rules, lattice_xy=kept)
    check(reached, robot)
    assert not np.isnan(reached.times).any()
    goal = Pose2(*data.draw(points_on(ground, 4.0)), data.draw(yaws))
    assert reached.fits(goal) in (True, False)
    end = reached.best_near(goal, data.draw(st.floats(0.05, 2.0)))
    if end is not None:
        way = reached.way_to(end)
        assert np.isfinite(reached.route_along(way)).all()
        reached.next_move(way, rules)
    assert finite(reached.free_turn_rad(1.0), reached.free_ahead_m(1.0, rules))
    assert 0 <= reached.free_back_m(0.3, rules) <= 0.3


@settings(max_examples=200, deadline=None)
@given(st.data())
def test_gaze_points_stands_and_places_are_finite_for_objects_anywhere(data: st.DataObject) -> None:
    ground, robot = data.draw(scenes())
    description = described(data.draw(footprints_m))
    thing = data.draw(instances(ground))
    reached = reach(ground, robot, MotionRules(description.footprint_radius_m))
    for gaze in gaze_points(thing, reached, description, GazeRules((0.4, 0.8, 1.2), 0.3)):
        assert finite(gaze.pose.x_m, gaze.pose.y_m, gaze.pose.yaw_rad, gaze.tilt_rad, gaze.arrival)
    stand = stand_for(thing.center_m, reached, description, 0.9, [robot.xy])
    assert stand is None or finite(stand.x_m, stand.y_m, stand.yaw_rad)
    for spot in place_spots(thing, reached, 0.9, PlaceRules(0.05, 0.05), [robot.xy]):
        assert finite(*spot.point_m, spot.stand.x_m, spot.stand.y_m, spot.inset_m)
    assert finite(*edge_spot(thing, robot, 0.1))
    for seen in (ground, reached.ground):
        top = highest_ahead(thing, seen, robot, AheadRules(0.9))
        assert top is None or finite(*top)
        assert top_at_m(seen, robot.xy, 0.1) >= 0


@settings(max_examples=200, deadline=None)
@given(st.data())
def test_unknown_ground_can_be_queried_at_any_point(data: st.DataObject) -> None:
    """Includes maps without cells."""
    ground = data.draw(grounds(least=0))
    point = data.draw(points_on(ground, 30.0))
    radius_m = data.draw(st.floats(0.05, 1.5))
    x_m, y_m = unknown_near(ground, point, radius_m)
    assert math.hypot(x_m - point[0], y_m - point[1]) <= (radius_m + 2 * ground.cell_m) * 2**0.5
    pose = Pose2(*data.draw(points_on(ground, 2.0)), 0.0)
    assert near_ground_unknown(ground, pose, data.draw(footprints_m)) in (True, False)


@given(footprints_m, st.floats(0.1, 1.9), st.floats(-1.5, 1.5), st.floats(0.0, 1.5))
def test_the_width_of_the_blind_zone_is_never_negative(
    footprint_m: float, height_m: float, low_rad: float, range_rad: float
) -> None:
    assume(low_rad + range_rad < math.pi / 2)
    robot = RobotDescription(
        name="any",
        camera=CAMERA,
        footprint_radius_m=footprint_m,
        height_m=2.0,
        camera_height_m=height_m,
        reach_m=0.9,
        max_depth_m=5.0,
        tilt_range_rad=(low_rad, low_rad + range_rad),
    )
    assert blind_m(robot) >= 0  # inf: the camera never sees the floor


@pytest.mark.parametrize("footprint_m", [0.1, 0.2, 0.25, 0.27, 0.3, 0.35, 0.6])
@pytest.mark.parametrize("side", [(0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (-1, -1)])
def test_a_robot_next_to_a_wall_can_leave_its_place(
    footprint_m: float, side: tuple[int, int]
) -> None:
    """Regression: the planner failed here for every radius below 0.28 m."""
    occupancy = np.zeros((160, 200), np.int8)  # 5 x 4 m of free floor in walls
    occupancy[:2] = occupancy[-2:] = 100
    occupancy[:, :2] = occupancy[:, -2:] = 100
    ground = GroundMap(occupancy, np.zeros(occupancy.shape, np.float32), 0.025, (-2.5, -2.0))
    for gap_m in np.arange(0.0, 0.12, 0.01):
        off_m = footprint_m + float(gap_m)
        robot = Pose2(side[0] * (2.45 - off_m), side[1] * (1.95 - off_m), 0.3)
        reached = reach(ground, robot, MotionRules(footprint_m))
        assert np.isfinite(reached.at(np.array([[0.0, 0.0]]))).all()
