"""Tests waypoints, frames and hand poses without a robot."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helios_core.codec import description_from_proto, description_to_proto
from helios_core.errors import Internal
from helios_core.geometry import (
    Pinhole,
    camera_on_base,
    invert,
    is_rigid,
    project,
    se2_to_se3,
    tilt_of,
    yaw_of,
)
from helios_core.robot import Forward, Turn
from helios_core.types import RobotDescription
from helios_planner.motion_planning.base_placement import GazePoint, tilt_towards
from helios_planner.motion_planning.costmap import Pose2
from helios_spot.arm_poses import (
    ARM_M,
    FINGERTIPS_M,
    HELD_BELOW_M,
    WRIST_BEHIND_HAND_M,
    looking_pose,
    placing_poses,
)
from helios_spot.frame_transforms import (
    NOMINAL_BODY_HEIGHT_M,
    base_below_body,
    ground_height_m,
    pose,
    to_vision,
    world_from_vision,
)
from helios_spot.waypoints import Waypoint, between, goal_of, reached, time_allowed_s
from hypothesis import given
from hypothesis import strategies as st

from tests.fake_spot import pb

COORDINATE = st.floats(-20, 20)
ANGLE = st.floats(-math.pi, math.pi)
PLACES = st.builds(Waypoint, COORDINATE, COORDINATE, ANGLE)


def tree(edges: dict[str, tuple[str, np.ndarray]]) -> object:
    """A FrameTreeSnapshot with the body as its root."""
    out = pb.geometry.FrameTreeSnapshot()
    out.child_to_parent_edge_map["body"].parent_frame_name = ""
    for child, (parent, T) in edges.items():
        edge = out.child_to_parent_edge_map[child]
        edge.parent_frame_name = parent
        edge.parent_tform_child.CopyFrom(pb.math_helpers.SE3Pose.from_matrix(T).to_proto())
    return out


@given(PLACES, st.floats(0.1, 1.0))
def test_forward_ends_at_its_distance_ahead_with_the_same_heading(
    start: Waypoint, distance_m: float
) -> None:
    goal = goal_of(Forward(distance_m), start)
    assert between(start, goal) == pytest.approx((distance_m, 0.0), abs=1e-9)
    ahead = invert(se2_to_se3(start.x_m, start.y_m, start.yaw_rad)) @ [goal.x_m, goal.y_m, 0, 1]
    assert ahead[:2] == pytest.approx([distance_m, 0.0], abs=1e-9)


@given(PLACES, st.floats(-0.52, 0.52))
def test_turn_keeps_the_position_and_turns_by_its_angle(start: Waypoint, angle_rad: float) -> None:
    goal = goal_of(Turn(angle_rad), start)
    moved_m, turned_rad = between(start, goal)
    assert moved_m == 0.0
    assert turned_rad == pytest.approx(angle_rad, abs=1e-9)
    assert abs(goal.yaw_rad) <= math.pi


@pytest.mark.parametrize(
    ("off", "is_there"),
    [
        (Waypoint(0.04, 0.0, 0.04), True),
        (Waypoint(0.06, 0.0, 0.0), False),
        (Waypoint(0.0, 0.0, 0.06), False),
        (Waypoint(0.0, 0.0, -0.06), False),
    ],
)
def test_a_goal_is_reached_in_position_and_heading(off: Waypoint, is_there: bool) -> None:
    assert reached(Waypoint(0.0, 0.0, 0.0), off) is is_there


@given(PLACES)
def test_a_waypoint_survives_conversion_to_a_transform(place: Waypoint) -> None:
    again = Waypoint.of(se2_to_se3(place.x_m, place.y_m, place.yaw_rad))
    assert between(place, again) == pytest.approx((0, 0), abs=1e-9)
    assert reached(place, again)


@given(PLACES, PLACES)
def test_the_allowed_time_exceeds_the_travel_time(a: Waypoint, b: Waypoint) -> None:
    far_m, far_rad = between(a, b)
    assert time_allowed_s(a, b, 0.5, 0.8) > far_m / 0.5 + abs(far_rad) / 0.8


@given(COORDINATE, COORDINATE, ANGLE, st.floats(-0.3, 0.3), st.floats(-1, 1))
def test_the_base_is_the_projection_of_the_body_onto_the_floor(
    x_m: float, y_m: float, yaw_rad: float, pitch_rad: float, ground_m: float
) -> None:
    c, s = math.cos(pitch_rad), math.sin(pitch_rad)
    pitch = np.eye(4)
    pitch[:3, :3] = [[c, 0, s], [0, 1, 0], [-s, 0, c]]
    T_vision_body = se2_to_se3(x_m, y_m, yaw_rad) @ pitch
    T_vision_body[2, 3] = ground_m + 0.52
    base = base_below_body(world_from_vision(ground_m) @ T_vision_body)
    assert base[:3, 3] == pytest.approx([x_m, y_m, 0.0])
    assert math.cos(yaw_of(base) - yaw_rad) == pytest.approx(1.0)


def test_the_ground_height_comes_from_the_ground_plane_or_else_the_standing_body() -> None:
    T_body_vision = invert(se2_to_se3(1.0, 2.0, 0.5))
    T_body_vision[2, 3] = -0.3  # the body is 0.3 above vision's origin
    ground = np.eye(4)
    ground[2, 3] = -0.5
    with_plane = tree({"vision": ("body", T_body_vision), "gpe": ("body", ground)})
    assert ground_height_m(with_plane) == pytest.approx(-0.2)
    without = tree({"vision": ("body", T_body_vision)})
    assert ground_height_m(without) == pytest.approx(0.3 - NOMINAL_BODY_HEIGHT_M)


def test_poses_are_chained_through_the_tree_and_a_missing_frame_is_named() -> None:
    T_hand_cam = camera_on_base(np.eye(4), 0.02, 0.3)
    T_body_hand = se2_to_se3(0.5, 0.1, 0.2)
    snapshot = tree({"hand": ("body", T_body_hand), "camera": ("hand", T_hand_cam)})
    np.testing.assert_allclose(
        pose(snapshot, "body", "camera"), T_body_hand @ T_hand_cam, atol=1e-6
    )
    with pytest.raises(Internal, match=r"'vision'.*camera"):
        pose(snapshot, "vision", "camera")


def test_world_and_vision_points_differ_by_the_ground_height() -> None:
    point = to_vision((1.0, 2.0, 0.7), ground_m=-0.2)
    np.testing.assert_allclose(point, [1.0, 2.0, 0.5])
    np.testing.assert_allclose(world_from_vision(-0.2) @ [*point, 1.0], [1.0, 2.0, 0.7, 1.0])


@given(st.floats(-0.4, 1.4))
def test_the_hand_camera_is_tilted_down_by_the_tilt_angle(tilt_rad: float) -> None:
    T = looking_pose(0.5, 0.6, tilt_rad)
    assert is_rigid(T)
    optical = np.array([[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1.0]])
    assert tilt_of(T @ optical) == pytest.approx(tilt_rad, abs=1e-9)


@given(st.floats(0.3, 0.7), st.floats(-0.4, 0.4), st.floats(-0.4, 0.2))
def test_placing_lowers_the_held_object_straight_down_to_the_point(
    x_m: float, y_m: float, z_m: float
) -> None:
    point = np.array([x_m, y_m, z_m])
    above, release = placing_poses(point, np.zeros(3), clearance_m=0.12)
    assert is_rigid(above)
    assert is_rigid(release)
    tips = release[:3, 3] + FINGERTIPS_M * release[:3, 0]
    np.testing.assert_allclose(tips - [0, 0, HELD_BELOW_M], point, atol=1e-9)
    np.testing.assert_allclose((above - release)[:3, 3], [0, 0, 0.12], atol=1e-9)
    assert release[2, 0] < 0  # the hand points down


def test_the_hand_approaches_as_steeply_as_the_arm_length_allows() -> None:
    near, far = np.array([0.5, 0.0, 0.0]), np.array([0.78, 0.0, 0.0])
    for point in (near, far):
        for T in placing_poses(point, np.zeros(3), 0.12):
            wrist = T[:3, 3] - WRIST_BEHIND_HAND_M * T[:3, 0]
            assert np.linalg.norm(wrist) <= ARM_M
    steep, flat = (placing_poses(p, np.zeros(3), 0.12)[1][2, 0] for p in (near, far))
    assert steep < flat < 0


def test_the_planner_computes_the_tilt_from_the_camera_position() -> None:
    camera = Pinhole(100.0, 100.0, 79.5, 59.5, 160, 120)
    robot = RobotDescription(
        "Spot", 0.55, 1.25, camera, 1.15, 1.0, 4.0, camera_forward_m=0.5, tilt_range_rad=(-0.4, 1.4)
    )
    thing = np.array([1.2, 0.0, 0.75])
    tilt_rad = tilt_towards(1.2, 0.75, robot)
    T_world_cam = GazePoint(Pose2(0.0, 0.0, 0.0), tilt_rad, 0.0).T_world_cam(robot)
    uv, _ = project(thing[None], camera, T_world_cam)
    np.testing.assert_allclose(uv[0], [camera.cx, camera.cy], atol=1e-6)
    again = description_from_proto(description_to_proto(robot))
    assert again.camera_forward_m == 0.5
