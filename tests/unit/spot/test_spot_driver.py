"""Tests Spot's driver with a fake Spot without faults: poses, units, images, actions."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from helios_core import proto as pb
from helios_core.errors import InvalidInput, Unavailable
from helios_core.geometry import Pinhole, is_rigid, lift_pixels, tilt_of, yaw_of
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.robot import Capture, Forward, Observe, Pick, Place, Tilt, Turn
from helios_core.topics import ESTIMATE_DEPTH
from helios_spot.depth_completion import DetectorDepth
from numpy.typing import NDArray

from tests.fake_spot.cameras import sources
from tests.fake_spot.scene import Shape
from tests.fake_spot.senses import Images
from tests.unit.spot.conftest import Staging
from tests.unit.spot.spot_stage import Stage

MUG_M = (2.16, 0.6, 0.76)


def off_surfaces_m(capture: Capture, shapes: dict[str, Shape]) -> NDArray[np.float64]:
    """Distance of each point in the image to the bounds of the nearest box or cylinder."""
    points = lift_pixels(capture.depth_m, capture.camera, capture.T_world_cam)
    points = points[capture.depth_m > 0]
    best = np.full(len(points), np.inf)
    for shape in shapes.values():
        low, high = shape.bounds
        outside = np.maximum(np.maximum(low - points, points - high), 0)
        best = np.minimum(best, np.linalg.norm(outside, axis=1))
    return best


# --- description ----------------------------------------------------------------------------------
def test_the_description_is_available_before_anything_moves(stage: Stage) -> None:
    driver = stage.driver()
    reported = driver.describe()
    assert reported.name == "Spot"
    assert reported.camera.width == 320  # from the robot's image source, not a constant
    assert reported.camera_forward_m == 0.5
    assert reported.can_move
    assert not stage.world.motors
    assert not stage.world.lease_owner
    assert driver.state().robot_boot_id == "fake-BD-00000001-fake-boot-1"
    assert driver.state().battery == 0.88


def test_the_base_pose_lies_on_the_floor_below_the_robot(stage: Stage) -> None:
    driver = stage.driver()
    stage.world.x, stage.world.y, stage.world.yaw = 0.7, -0.4, 1.1
    base = driver.state().T_world_base
    assert is_rigid(base)
    assert base[:3, 3] == pytest.approx([0.7, -0.4, 0.0], abs=1e-6)
    assert yaw_of(base) == pytest.approx(1.1, abs=1e-6)


def test_picking_needs_an_arm_and_a_hand_camera_that_the_grasp_service_accepts(
    staging: Staging,
) -> None:
    reported = staging().driver().describe()
    assert (reported.can_pick, reported.can_place) == (True, True)
    without = staging(without=frozenset({"manipulation"})).driver(camera="frontleft").describe()
    assert (without.can_pick, without.can_place) == (False, False)
    cameras = sources()
    no_hand = {name: source for name, source in cameras.items() if source.parent != "hand"}
    without = staging(cameras=no_hand).driver(camera="frontleft").describe()
    assert (without.can_pick, without.can_place) == (False, False)
    bent = replace(cameras["hand_color_image"], distortion=(0.02, -0.01, 0.003, 0.0))
    reported = staging(cameras={**cameras, bent.name: bent}).driver(camera="frontleft").describe()
    assert (reported.can_pick, reported.can_place) == (False, True)


# --- images ---------------------------------------------------------------------------------------
def test_every_pixel_of_the_hand_lies_on_a_surface_of_the_room(stage: Stage) -> None:
    driver = stage.driver()
    stage.act(driver, Turn(0.3))
    capture = driver.capture()
    assert capture.color.shape == (240, 320, 3)
    assert (capture.depth_m > 0).mean() > 0.5
    assert off_surfaces_m(capture, stage.world.shapes).max() < 0.01
    floor = lift_pixels(capture.depth_m, capture.camera, capture.T_world_cam)[..., 2]
    assert np.nanmin(floor) == pytest.approx(0.0, abs=0.01)


def test_an_image_has_the_pose_of_its_capture_time(stage: Stage) -> None:
    driver = stage.driver()
    before = driver._link.read()
    stage.world.x, stage.world.yaw = 0.4, 0.3
    capture = driver._cameras.capture(before)
    assert capture.T_world_base[:3, 3] == pytest.approx([0.4, 0.0, 0.0], abs=1e-6)
    assert yaw_of(capture.T_world_base) == pytest.approx(0.3, abs=1e-6)


def test_a_rotated_fisheye_gives_an_upright_pinhole_image_with_correct_depth(stage: Stage) -> None:
    driver = stage.driver(camera="frontleft")
    capture = driver.capture()
    reported = driver.describe()
    assert reported.camera == capture.camera
    assert capture.camera.height > capture.camera.width
    assert abs(capture.T_world_cam[2, 0]) < 0.05  # level
    assert reported.tilt_range_rad == pytest.approx((0.5, 0.5), abs=0.02)
    assert (capture.depth_m > 0).mean() > 0.2
    off_m = off_surfaces_m(capture, stage.world.shapes)
    assert np.quantile(off_m, 0.95) < 0.03  # depth is registered from a coarser camera beside it
    assert (capture.color[..., 0] == capture.color[..., 2]).all()  # grey


def test_the_arm_in_front_of_a_body_camera_is_masked(stage: Stage) -> None:
    driver = stage.driver(camera="frontleft", depth="sensor", min_depth_m=0.05)
    stage.world.T_flat_hand[:3, 3] = [0.75, 0.0, -0.1]  # low, across the view
    capture = driver.capture()
    assert off_surfaces_m(capture, stage.world.shapes).max() < 0.15  # no points float in the room
    raw = unmasked_points(stage, "frontleft_depth")
    assert raw.min() < 0.4  # the camera does see the arm


def unmasked_points(stage: Stage, name: str) -> NDArray[np.float32]:
    """The valid depth values of a source as the robot sends them."""
    images: Images = stage.fake.images
    source = images.sources[name]
    from tests.fake_spot.body import Arm
    from tests.fake_spot.scene import look

    T = stage.world.T_world_body
    shapes = stage.world.shapes | Arm(stage.world.T_flat_hand).shapes(T)
    depth = look(shapes, T @ source.T_parent_cam, source.rays).depth_m
    return depth[depth > 0]


def flat_estimate(color: NDArray[np.uint8], camera: Pinhole) -> NDArray[np.float32]:
    """An estimator for tests: everything is 2 m away."""
    return np.full((camera.height, camera.width), 2.0, np.float32)


def test_depth_comes_from_an_estimator_when_configured(stage: Stage) -> None:
    del stage.fake.images.sources["hand_depth_in_hand_color_frame"]
    with pytest.raises(InvalidInput, match="hand_depth_in_hand_color_frame"):
        stage.driver()
    driver = stage.driver(depth="estimate", depth_estimator=f"{__name__}:flat_estimate")
    depth_m = driver.capture().depth_m
    assert set(np.unique(depth_m)) <= {np.float32(0.0), np.float32(2.0)}
    assert (depth_m > 0).any()


def test_a_missing_estimator_name_is_an_invalid_setting(stage: Stage) -> None:
    with pytest.raises(InvalidInput, match="HELIOS_SPOT_DEPTH_ESTIMATOR"):
        stage.driver(depth="fill", depth_estimator="")


def test_the_detector_estimates_depth_and_the_arm_stays_masked(stage: Stage) -> None:
    hub = MemoryHub()
    asked: list[pb.DepthRequest] = []

    def answer(request: pb.DepthRequest) -> pb.DepthReply:
        asked.append(request)
        w, h = request.raw_color.width, request.raw_color.height
        reply = pb.DepthReply(focal_px=request.calibration.K[0] * 2, model="flat")
        reply.raw_depth.width, reply.raw_depth.height = w, h
        reply.raw_depth.step, reply.raw_depth.encoding = 2 * w, "16UC1"
        reply.raw_depth.data = np.full((h, w), 3000, "<u2").tobytes()
        return reply

    MemoryBus(hub).serve(ESTIMATE_DEPTH, answer)
    driver = stage.driver(bus=MemoryBus(hub), camera="frontleft", depth="estimate")
    stage.world.T_flat_hand[:3, 3] = [0.75, 0.0, -0.1]  # low, across the view
    capture = driver.capture()
    assert asked[0].calibration.K[0] == capture.camera.fx
    assert set(np.unique(capture.depth_m.round(3))) == {np.float32(0.0), np.float32(1.5)}
    with pytest.raises(Unavailable):
        stage.driver(bus=MemoryBus(MemoryHub()), depth="fill").capture()


@pytest.mark.parametrize(
    ("focal_px", "rows", "reported"),
    [
        (0.0, 4, "focal length of 0.0"),
        (math.inf, 4, "focal length of inf"),
        (math.nan, 4, "focal length of nan"),
        (300.0, 3, r"depth of \(3, 5\) for an image of \(4, 5\)"),
    ],
)
def test_depth_of_the_detector_needs_a_valid_focal_length_and_size(
    focal_px: float, rows: int, reported: str
) -> None:
    hub = MemoryHub()

    def answer(_: pb.DepthRequest) -> pb.DepthReply:
        reply = pb.DepthReply(focal_px=focal_px, model="flat")
        reply.raw_depth.width, reply.raw_depth.height = 5, rows
        reply.raw_depth.step, reply.raw_depth.encoding = 10, "16UC1"
        reply.raw_depth.data = np.full((rows, 5), 3000, "<u2").tobytes()
        return reply

    MemoryBus(hub).serve(ESTIMATE_DEPTH, answer)
    camera = Pinhole(fx=300.0, fy=300.0, cx=2.0, cy=1.5, width=5, height=4)
    with pytest.raises(InvalidInput, match=reported):
        DetectorDepth(MemoryBus(hub), 5.0)(np.zeros((4, 5, 3), np.uint8), camera)


# --- actions --------------------------------------------------------------------------------------
def test_the_first_action_makes_the_robot_stand_with_a_raised_hand(stage: Stage) -> None:
    driver = stage.driver()
    assert stage.act(driver, Observe()).succeeded
    assert stage.world.standing
    capture = driver.capture()
    assert tilt_of(capture.T_world_cam) == pytest.approx(0.52, abs=1e-3)
    assert capture.T_world_cam[2, 3] == pytest.approx(1.15, abs=0.05)


def test_walks_and_turns_have_the_requested_length_and_keep_the_speed_limit(
    staging: Staging,
) -> None:
    stage = staging(hurry=4.0)
    driver = stage.driver(speed_m_s=0.4, turn_rad_s=0.7)
    forward = stage.act(driver, Forward(0.6))
    assert forward.succeeded
    assert forward.moved_m == pytest.approx(0.6, abs=0.05)
    for angle_rad in (0.5, -0.3):
        turn = stage.act(driver, Turn(angle_rad))
        assert turn.turned_rad == pytest.approx(angle_rad, abs=0.06)
        assert turn.moved_m < 0.05
    assert stage.world.fastest == pytest.approx(0.4)
    assert stage.world.fastest_turn == pytest.approx(0.7)
    assert stage.act(driver, Observe()).steps == 4


def test_an_action_id_runs_once(stage: Stage) -> None:
    driver = stage.driver()
    first = driver.act(Forward(0.5), "one")
    assert driver.act(Forward(0.5), "one") == first
    assert math.hypot(stage.world.x, stage.world.y) == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize("tilt_rad", [-0.3, 0.0, 0.9])
def test_tilt_is_absolute_and_positive_is_down(stage: Stage, tilt_rad: float) -> None:
    driver = stage.driver()
    assert stage.act(driver, Tilt(tilt_rad)).succeeded
    assert tilt_of(driver.capture().T_world_cam) == pytest.approx(tilt_rad, abs=1e-3)
    assert driver.state().tilt_rad == pytest.approx(tilt_rad)
    stage.act(driver, Forward(0.3))
    assert tilt_of(driver.capture().T_world_cam) == pytest.approx(tilt_rad, abs=1e-3)


def test_pick_and_place_move_the_mug_to_the_given_height(stage: Stage) -> None:
    driver = stage.driver(arm_m_s=0.4, arm_rad_s=1.2)
    stage.world.x, stage.world.y = 1.3, 0.6
    assert stage.act(driver, Pick(MUG_M, "mug")).succeeded
    assert driver.state().held == "mug"
    stage.world.x, stage.world.y, stage.world.yaw = 0.6, -1.0, -math.pi / 2
    held = driver.capture()
    assert off_surfaces_m(held, stage.world.shapes).max() < 0.01  # the held mug is masked
    placed = stage.act(driver, Place((0.6, -1.8, 0.51)))
    assert placed.succeeded, placed.reason
    assert driver.state().held == ""
    stage.world.held = "mug"  # placed into the gripper by a person
    assert driver.state().held == "thing"
    stage.world.held = ""
    assert stage.world.things["mug"].center == pytest.approx((0.6, -1.8, 0.56), abs=0.02)
    assert stage.world.fastest_hand == pytest.approx(0.4)  # for look, gaze, reach and lift
    assert stage.world.fastest_wrist == pytest.approx(1.2)


def test_a_mug_is_also_grasped_with_a_body_camera(stage: Stage) -> None:
    driver = stage.driver(camera="frontleft")
    stage.world.x, stage.world.y = 1.3, 0.6
    assert stage.act(driver, Pick(MUG_M, "mug")).succeeded
    assert not stage.world.stowed  # the arm carries the mug
    stage.act(driver, Place((2.2, 0.5, 0.71)))
    assert stage.world.stowed  # out of the camera's view again
