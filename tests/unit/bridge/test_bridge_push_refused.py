"""Pushed frames that are refused with a reason; the next frame is still accepted."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import pytest
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from helios_core import proto as pb
from helios_core.codec.frames import pose_to_proto
from helios_core.errors import Conflict, InvalidInput
from helios_core.geometry import camera_on_base, se2_to_se3

from tests.unit.bridge.bridge_push_stage import T_WORLD_CAM, Rig, answered, pushed
from tests.unit.bridge.bridge_stage import LineRobot


def _no_depth(frame: pb.Frame) -> None:
    frame.ClearField("raw_depth")


def _no_color(frame: pb.Frame) -> None:
    frame.ClearField("raw_color")


def _other_size(frame: pb.Frame) -> None:
    frame.calibration.width = 17


def _no_pose(frame: pb.Frame) -> None:
    frame.ClearField("T_world_cam")


def _deep_color(frame: pb.Frame) -> None:
    deep = cv2.imencode(".png", np.zeros((12, 16, 3), np.uint16))[1].tobytes()
    frame.compressed_color.CopyFrom(CompressedImage(data=deep, format="png"))


def _long_name(frame: pb.Frame) -> None:
    frame.id.robot_boot_id = "x" * 1000


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (_no_depth, "no depth image"),
        (_no_color, "no colour image"),
        (_deep_color, "16 bit a channel"),
        (_other_size, "sizes disagree"),
        (_no_pose, "T_world_cam"),
        (_long_name, "robot_boot_id"),
    ],
)
def test_an_inconsistent_frame_is_refused_and_the_next_frame_is_accepted(
    spoil: Callable[[pb.Frame], None], said: str
) -> None:
    rig, frame = Rig(), pushed()
    spoil(frame)
    with pytest.raises(InvalidInput, match=said):
        rig.push(frame)
    assert rig.keyframes == []
    assert answered(rig.push(pushed()))


def posed(T_world_cam: np.ndarray, T_world_base: np.ndarray | None) -> pb.Frame:
    frame = pushed()
    frame.T_world_cam.CopyFrom(pose_to_proto(T_world_cam, 5))
    if T_world_base is not None:
        frame.T_world_base.CopyFrom(pose_to_proto(T_world_base, 5))
    return frame


def raised(T: np.ndarray, by_m: float) -> np.ndarray:
    out = T.copy()
    out[2, 3] += by_m
    return out


def leaning(degrees: float) -> np.ndarray:
    """A base that has rolled to its left."""
    c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    out = se2_to_se3(1.0, 2.0, 0.3)
    out[:3, :3] = out[:3, :3] @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    return out


ON_FLOOR = se2_to_se3(1.0, 2.0, 0.3)


@pytest.mark.parametrize(
    ("T_world_cam", "T_world_base", "said"),
    [
        (T_WORLD_CAM, leaning(180), "T_world_base leans by 180 degrees"),
        (T_WORLD_CAM, leaning(46), "upright"),
        (T_WORLD_CAM, raised(ON_FLOOR, 500), "T_world_base is at a height of 500.0 m"),
        (T_WORLD_CAM, raised(ON_FLOOR, -2.1), "height of -2.1 m"),
        (raised(T_WORLD_CAM, 500), None, "T_world_cam is at a height of 501.1 m"),
        (raised(T_WORLD_CAM, -3.2), None, "T_world_cam is at a height of -2.1 m"),
        (T_WORLD_CAM, se2_to_se3(40.0, 2.0, 0.3), "39.0 m from its base"),
    ],
)
def test_implausible_poses_are_refused(
    T_world_cam: np.ndarray, T_world_base: np.ndarray | None, said: str
) -> None:
    rig = Rig()
    with pytest.raises(InvalidInput, match=said):
        rig.push(posed(T_world_cam, T_world_base), classes=("mug",))
    assert rig.keyframes == []
    assert rig.contexts == []


@pytest.mark.parametrize(
    ("T_world_cam", "T_world_base"),
    [
        (T_WORLD_CAM, leaning(44)),  # on stairs
        (raised(T_WORLD_CAM, 1.9), raised(ON_FLOOR, 1.9)),  # a ramp, or a drifting localisation
        (raised(T_WORLD_CAM, 8.0), None),  # on a mast
        (T_WORLD_CAM @ np.diag([-1.0, -1.0, 1.0, 1.0]), None),  # a camera that hangs upside down
        (camera_on_base(ON_FLOOR, 1.1, np.pi / 2), None),  # straight down
        (T_WORLD_CAM, ON_FLOOR @ raised(np.eye(4), 0.5)),  # the body frame, not the base frame
    ],
)
def test_unusual_but_possible_poses_are_accepted(
    T_world_cam: np.ndarray, T_world_base: np.ndarray | None
) -> None:
    rig = Rig()
    assert answered(rig.push(posed(T_world_cam, T_world_base)))


@pytest.mark.parametrize("wait_s", [-1.0, float("nan"), float("inf"), 1e6])
def test_an_invalid_wait_time_is_refused(wait_s: float) -> None:
    with pytest.raises(InvalidInput, match="wait_s"):
        Rig().push(pushed(), wait_s=wait_s)


@pytest.mark.parametrize("classes", [("",), ("x" * 65,), tuple(f"c{i}" for i in range(65))])
def test_invalid_class_names_are_refused(classes: tuple[str, ...]) -> None:
    rig = Rig()
    with pytest.raises(InvalidInput, match="classes"):
        rig.push(pushed(), classes=classes)
    assert rig.contexts == []


def test_a_huge_claimed_image_size_allocates_no_memory() -> None:
    rig, frame = Rig(depth="estimated"), pushed()
    frame.ClearField("raw_depth")
    frame.calibration.width = frame.calibration.height = 2**32 - 1
    with pytest.raises(InvalidInput, match="smaller"):
        rig.push(frame)


def test_a_robot_with_its_own_camera_refuses_pushed_frames() -> None:
    rig = Rig(LineRobot())
    with pytest.raises(Conflict, match="--robot push"):
        rig.push(pushed())
