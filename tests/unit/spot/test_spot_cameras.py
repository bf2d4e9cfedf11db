"""Tests lenses, upright images, depth registration, depth estimates and the robot's own pixels."""

from __future__ import annotations

import math
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from helios_core.depth_registration import registered
from helios_core.errors import InvalidInput, Unavailable
from helios_core.geometry import Pinhole, camera_on_base, invert, lift_pixels, project
from helios_spot.cameras import (
    Lens,
    mounted,
    roll_to_upright,
    straight_color,
    straight_depth,
)
from helios_spot.depth_completion import estimated, filled, load_estimator
from helios_spot.posed_images import decode_color, decode_depth
from helios_spot.self_mask import Capsule, robot_capsules, robot_pixels
from hypothesis import given, settings
from hypothesis import strategies as st

CAMERA = Pinhole(100.0, 100.0, 79.5, 59.5, 160, 120)
BLANK = np.zeros((120, 160, 3), np.uint8)


def about_axis(angle_rad: float) -> np.ndarray:
    out = np.eye(4)
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    out[:2, :2] = [[c, -s], [s, c]]
    return out


def pixel_in(lens: Lens, point_cam: np.ndarray) -> np.ndarray:
    """The pixel of a point in the camera frame, seen through a lens."""
    D = np.array(lens.distortion or (0.0,) * 4)
    see = cv2.fisheye.projectPoints if lens.fisheye else cv2.projectPoints
    uv, _ = see(point_cam.reshape(1, 1, 3), np.zeros(3), np.zeros(3), lens.camera.matrix, D)
    return np.asarray(uv).reshape(2)


# --- upright pinholes -----------------------------------------------------------------------------
@given(st.floats(-3.0, 3.0), st.floats(-1.2, 1.2))
def test_rotating_by_the_roll_makes_a_camera_upright(roll_rad: float, tilt_rad: float) -> None:
    T_world_cam = camera_on_base(np.eye(4), 1.0, tilt_rad) @ about_axis(roll_rad)
    upright = T_world_cam @ about_axis(roll_to_upright(T_world_cam))
    assert upright[2, 0] == pytest.approx(0.0, abs=1e-9)  # its x axis is level
    assert upright[2, 1] < 0  # its y axis points down
    assert math.cos(roll_to_upright(T_world_cam) + roll_rad) == pytest.approx(1.0, abs=1e-6)


def test_images_of_an_upright_pinhole_are_unchanged() -> None:
    mount = mounted(Lens(CAMERA), 0.0)
    depth = np.ones((120, 160), np.float32)
    assert straight_color(mount, BLANK) is BLANK
    assert straight_depth(mount, depth) is depth
    assert mount.camera == CAMERA


@pytest.mark.parametrize(
    "lens",
    [
        Lens(CAMERA),
        Lens(CAMERA, distortion=(0.05, -0.02, 0.001, -0.001, 0.0)),
        Lens(CAMERA, fisheye=True, distortion=(0.02, -0.01, 0.003, 0.0)),
    ],
    ids=["pinhole", "brown-conrady", "kannala-brandt"],
)
@pytest.mark.parametrize("roll_deg", [-102, -78, 0, 90, 180])
def test_a_point_appears_in_the_upright_image_at_its_projection(lens: Lens, roll_deg: int) -> None:
    mount = mounted(lens, math.radians(roll_deg))
    sideways = roll_deg in (-102, -78, 90)
    assert (mount.camera.width > mount.camera.height) is not sideways
    point_cam = np.array([0.1, -0.15, 1.3])
    color, depth = BLANK.copy(), np.zeros((120, 160), np.float32)
    u, v = np.rint(pixel_in(lens, point_cam)).astype(int)
    color[v - 2 : v + 3, u - 2 : u + 3] = 255
    depth[v - 2 : v + 3, u - 2 : u + 3] = point_cam[2]
    seen, z_m = straight_color(mount, color), straight_depth(mount, depth)
    rows, columns = np.nonzero(seen[..., 0] > 128)
    expected, _ = project(point_cam[None], mount.camera, mount.T_cam_upright)
    assert [columns.mean(), rows.mean()] == pytest.approx(list(expected[0]), abs=1.5)
    assert z_m[round(rows.mean()), round(columns.mean())] == pytest.approx(1.3)


# --- images as they come --------------------------------------------------------------------------
def raw(data: bytes) -> SimpleNamespace:
    """A raw image of 4x3 pixels."""
    return SimpleNamespace(data=data, format=2, FORMAT_RAW=2, rows=3, cols=4)


@pytest.mark.parametrize("channels", [1, 3, 4])
def test_a_raw_colour_image_has_1_3_or_4_channels(channels: int) -> None:
    pixels = np.arange(12 * channels, dtype=np.uint8).reshape(3, 4, channels)
    got = decode_color(raw(pixels.tobytes()), "left_fisheye_image")
    assert got.shape == (3, 4, 3)
    np.testing.assert_array_equal(got[..., 0], pixels[..., 0])
    np.testing.assert_array_equal(got[..., 2], pixels[..., min(2, channels - 1)])


@pytest.mark.parametrize("size", [0, 5, 12 * 2, 12 * 3 + 1, 12 * 5])
def test_a_raw_colour_image_of_another_size_is_refused_with_its_name_and_bytes(size: int) -> None:
    said = f"'left_fisheye_image' of 4x3 pixels as {size} bytes, wanted 12, 36 or 48"
    with pytest.raises(Unavailable, match=said):
        decode_color(raw(bytes(size)), "left_fisheye_image")


@pytest.mark.parametrize("size", [0, 23, 25, 36])
def test_a_depth_image_of_another_size_is_refused_with_its_name_and_bytes(size: int) -> None:
    source = SimpleNamespace(name="hand_depth", depth_scale=1000.0)
    response = SimpleNamespace(source=source, shot=SimpleNamespace(image=raw(bytes(size))))
    with pytest.raises(Unavailable, match=f"'hand_depth' of 4x3 pixels as {size} bytes, wanted 24"):
        decode_depth(response)
    response.shot.image = raw(bytes(24))
    assert decode_depth(response).shape == (3, 4)
    source.depth_scale = 0.0
    with pytest.raises(Unavailable, match="'hand_depth' with a scale of 0 units a metre"):
        decode_depth(response)


# --- registration ---------------------------------------------------------------------------------
def test_registered_depth_lies_on_the_same_world_points() -> None:
    coarse = Pinhole(60.0, 60.0, 39.5, 29.5, 80, 60)
    T_color_depth = np.eye(4)
    T_color_depth[:3, 3] = [0.06, 0.0, 0.01]
    wall_m = 2.0
    depth = np.full((60, 80), wall_m, np.float32)
    on_color = registered(depth, coarse, T_color_depth, CAMERA)
    seen = on_color > 0
    assert seen[20:100, 25:135].all()  # a coarse pixel covers several fine ones
    points = lift_pixels(on_color, CAMERA, invert(T_color_depth))[seen]
    np.testing.assert_allclose(points[:, 2], wall_m, atol=1e-3)


def test_the_nearer_of_two_depths_on_a_pixel_wins() -> None:
    depth = np.zeros((120, 160), np.float32)
    depth[60, 95], depth[60, 80] = 4.0, 1.0
    T = np.eye(4)
    T[0, 3] = 0.2  # moves the far point by 5 pixels and the near one by 20, onto the same
    assert registered(depth, CAMERA, T, CAMERA)[60, 100] == pytest.approx(1.0)
    np.testing.assert_allclose(registered(depth, CAMERA, np.eye(4), CAMERA), depth)


def test_points_behind_the_camera_or_without_depth_give_no_depth() -> None:
    T = np.eye(4)
    T[2, 3] = -5.0
    assert not registered(np.ones((120, 160), np.float32), CAMERA, T, CAMERA).any()
    assert not registered(np.zeros((120, 160), np.float32), CAMERA, np.eye(4), CAMERA).any()


# --- estimated depth ------------------------------------------------------------------------------
@given(st.floats(0.6, 1.8), st.floats(0.05, 0.8))
@settings(max_examples=20)
def test_depth_holes_are_filled_at_the_scale_of_the_sensor(scale: float, missing: float) -> None:
    truth = np.linspace(0.5, 3.0, 120 * 160, dtype=np.float32).reshape(120, 160)
    sensor = truth.copy()
    sensor[: int(120 * missing)] = 0
    depth = filled(sensor, (truth / scale).astype(np.float32))
    np.testing.assert_allclose(depth, truth, rtol=1e-4)


def test_an_estimate_that_does_not_fit_the_sensor_depth_is_not_used() -> None:
    sensor = np.full((120, 160), 1.0, np.float32)
    sensor[:40] = 0
    np.testing.assert_array_equal(filled(sensor, sensor * 0 + 5.0), sensor)


def test_estimators_are_loaded_by_name_and_refused_with_a_reason() -> None:
    assert load_estimator("numpy:ones", None, 1.0) is np.ones
    refused = {
        "": "DEPTH_ESTIMATOR",
        "detector": "without a bus",
        "nothing:here": "cannot be loaded",
        "math:pi": "no callable",
        "numpy": "package:callable",
    }
    for wrong, why in refused.items():
        with pytest.raises(InvalidInput, match=why):
            load_estimator(wrong, None, 1.0)


def test_a_faulty_estimator_raises_a_typed_error() -> None:
    with pytest.raises(Unavailable, match="one depth a pixel"):
        estimated(lambda *_: np.ones((3, 3), np.float32), BLANK, CAMERA)

    def broken(*_: object) -> np.ndarray:
        raise RuntimeError("no memory")

    with pytest.raises(Unavailable, match="RuntimeError: no memory"):
        estimated(broken, BLANK, CAMERA)
    holes = np.full((120, 160), np.nan, np.float32)
    assert not estimated(lambda *_: holes, BLANK, CAMERA).any()


# --- the robot's own pixels -----------------------------------------------------------------------
def points_of(capsule: Capsule) -> np.ndarray:
    rng = np.random.default_rng(0)
    t = rng.uniform(0, 1, (400, 1))
    away = rng.normal(size=(400, 3))
    away *= 0.98 * capsule.radius_m / np.linalg.norm(away, axis=1, keepdims=True)
    return capsule.a_m + t * (capsule.b_m - capsule.a_m) + away


@pytest.mark.parametrize("ahead_m", [0.6, 1.0, 2.0])
def test_every_point_of_the_arm_is_masked_and_distant_points_are_not(ahead_m: float) -> None:
    arm = Capsule(np.array([ahead_m, -0.1, 0.1]), np.array([ahead_m + 0.2, 0.15, 0.0]), 0.08)
    T_body_cam = camera_on_base(np.eye(4), 0.1, 0.0)
    mask = robot_pixels([arm], T_body_cam, CAMERA)
    uv, z = project(points_of(arm), CAMERA, T_body_cam)
    u, v = np.rint(uv).astype(int).T
    inside = (z > 0) & (u >= 0) & (u < 160) & (v >= 0) & (v < 120)
    assert mask[v[inside], u[inside]].all()
    far = project(
        np.array([[3.0, 1.5, 0.1], [3.0, -1.5, 0.1], [3.0, 0.0, 1.2]]), CAMERA, T_body_cam
    )
    for column, row in np.rint(far[0]).astype(int):
        assert not mask[row, column]


def test_a_capsule_around_the_camera_masks_nothing() -> None:
    hand = Capsule(np.array([0.4, 0, 0.6]), np.array([0.6, 0, 0.6]), 0.1)
    T_body_cam = camera_on_base(np.eye(4), 0.62, 0.3, 0.55)
    assert not robot_pixels([hand], T_body_cam, CAMERA).any()
    assert not robot_pixels([], T_body_cam, CAMERA).any()


def test_an_arm_adds_capsules_to_the_body_and_a_held_object_adds_one_more() -> None:
    body = robot_capsules({}, None, None, False)
    T_hand = np.eye(4)
    T_hand[:3, 3] = [0.6, 0, 0.5]
    T_wrist = np.eye(4)
    T_wrist[:3, 3] = [0.4, 0, 0.5]
    joints = {"arm0.sh0": 0.0, "arm0.sh1": -1.2}
    arm = robot_capsules(joints, T_wrist, T_hand, False)
    assert len(body) < len(arm) < len(robot_capsules(joints, T_wrist, T_hand, True))
    # Without joints the arm is one straight capsule.
    assert len(robot_capsules({}, T_wrist, T_hand, False)) < len(arm)
