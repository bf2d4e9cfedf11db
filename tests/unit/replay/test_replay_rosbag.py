"""ROS 2 bags: images, calibration and camera poses."""

from __future__ import annotations

import logging
import math
import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from helios_core.errors import InvalidInput
from helios_core.geometry import R_BODY_CAM, camera_on_base, quaternion_from_rotation, se2_to_se3
from helios_replay import ReplayDriver
from helios_replay.format_detection import open_source
from helios_replay.replay_source import PlaybackRange
from helios_replay.ros_images import Lens, depth_of
from helios_replay.ros_poses import slerp

pytest.importorskip("rosbags", reason="the extra `ros` is not installed")
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_HUMBLE)
HEIGHT, WIDTH, HEIGHT_M = 48, 64, 1.2
SHOTS = 4


def make(name: str, **fields: Any) -> Any:
    """A message by its type's name."""
    return STORE.types[name](**fields)


def header(ns: int, frame: str) -> Any:
    stamp = make("builtin_interfaces/msg/Time", sec=ns // 10**9, nanosec=ns % 10**9)
    return make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def vector(kind: str, T: np.ndarray) -> Any:
    return make(f"geometry_msgs/msg/{kind}", **dict(zip("xyz", T[:3, 3], strict=True)))


def transform(ns: int, parent: str, child: str, T: np.ndarray) -> Any:
    x, y, z, w = quaternion_from_rotation(T[:3, :3])
    return make(
        "geometry_msgs/msg/TransformStamped",
        header=header(ns, parent),
        child_frame_id=child,
        transform=make(
            "geometry_msgs/msg/Transform",
            translation=vector("Vector3", T),
            rotation=make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w),
        ),
    )


def pose(ns: int, T: np.ndarray) -> Any:
    x, y, z, w = quaternion_from_rotation(T[:3, :3])
    return make(
        "geometry_msgs/msg/PoseStamped",
        header=header(ns, "map"),
        pose=make(
            "geometry_msgs/msg/Pose",
            position=vector("Point", T),
            orientation=make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w),
        ),
    )


def image(ns: int, pixels: np.ndarray, encoding: str) -> Any:
    return make(
        "sensor_msgs/msg/Image",
        header=header(ns, "optical"),
        height=HEIGHT,
        width=WIDTH,
        encoding=encoding,
        is_bigendian=0,
        step=pixels.nbytes // HEIGHT,
        data=np.frombuffer(pixels.tobytes(), np.uint8),
    )


def compressed(ns: int, data: bytes, form: str) -> Any:
    return make(
        "sensor_msgs/msg/CompressedImage",
        header=header(ns, "optical"),
        format=form,
        data=np.frombuffer(data, np.uint8),
    )


def info(ns: int, distortion: list[float]) -> Any:
    region = make(
        "sensor_msgs/msg/RegionOfInterest",
        x_offset=0,
        y_offset=0,
        height=0,
        width=0,
        do_rectify=False,
    )
    return make(
        "sensor_msgs/msg/CameraInfo", header=header(ns, "optical"), height=HEIGHT, width=WIDTH,
        distortion_model="plumb_bob", d=np.array(distortion),
        k=np.array([60, 0, 32, 0, 60, 24, 0, 0, 1], float), r=np.eye(3).ravel(),
        p=np.zeros(12), binning_x=0, binning_y=0, roi=region,
    )  # fmt: skip


def stamp(k: int) -> int:
    return 5_000_000_000 + k * 100_000_000


def base(k: float) -> np.ndarray:
    return se2_to_se3(0.2 * k, 0.1, 0.1 * k)


def inverse_depth(depth_m: np.ndarray, a: float, b: float) -> np.ndarray:
    """As `compressed_depth_image_transport` stores 32FC1: a / depth + b, a corner without depth."""
    out = (a / depth_m + b).astype(np.uint16)
    out[0, 0] = 0
    return out


def write_bag(
    path: Path, *, packed: bool = False, pose_topic: bool = False, tf: bool = True,
    distortion: list[float] | None = None, plugin: StoragePlugin = StoragePlugin.SQLITE3,
    second_camera: bool = False, inverse: tuple[float, float] | None = None,
    second_parent: bool = False, shots: int = SHOTS, poses: int | None = None,
) -> Path:  # fmt: skip
    """Four shots while the base drives an arc; tf at 50 ms before and after each image.

    inverse: (a, b) of inverse depth, with packed depth of type 32FC1. poses: the number of poses
    on the pose topic. second_parent: tf has a second parent frame for the camera.
    """
    depth_mm = np.full((HEIGHT, WIDTH), 2000, np.uint16)
    blue = np.full((HEIGHT, WIDTH, 3), (250, 10, 10), np.uint8)
    T_base_cam = camera_on_base(np.eye(4), HEIGHT_M, 0.0)
    with Writer(path, version=9, storage_plugin=plugin) as writer:
        topics: dict[str, Any] = {}

        def write(topic: str, ns: int, message: Any) -> None:
            kind = message.__msgtype__
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, kind, typestore=STORE)
            writer.write(topics[topic], ns, STORE.serialize_cdr(message, kind))

        if tf:
            static = transform(stamp(0), "base_link", "optical", T_base_cam)
            write("/tf_static", stamp(0), make("tf2_msgs/msg/TFMessage", transforms=[static]))
        if second_parent:
            other = transform(stamp(0), "gripper", "optical", np.eye(4))
            write("/tf", stamp(0), make("tf2_msgs/msg/TFMessage", transforms=[other]))
        for k in range(shots):
            ns = stamp(k)
            write("/cam/color/camera_info", ns, info(ns, distortion or [0.0] * 5))
            if tf:
                for half in (-0.5, 0.5):
                    at = ns + round(half * 1e8)
                    moved = transform(at, "map", "base_link", base(k + half))
                    write("/tf", at, make("tf2_msgs/msg/TFMessage", transforms=[moved]))
            if pose_topic and k < (shots if poses is None else poses):
                write("/slam/pose", ns, pose(ns, base(k) @ T_base_cam))
            if packed:
                jpeg = cv2.imencode(".jpg", blue)[1].tobytes()
                head, stored, form = bytes(12), depth_mm, "16UC1; compressedDepth"
                if inverse is not None:
                    head, form = struct.pack("<iff", 0, *inverse), "32FC1; compressedDepth png"
                    stored = inverse_depth(depth_mm / 1000, *inverse)
                png = head + cv2.imencode(".png", stored)[1].tobytes()
                write("/cam/color/compressed", ns, compressed(ns, jpeg, "bgr8; jpeg"))
                write(
                    "/cam/depth/compressedDepth",
                    ns + 3_000_000,
                    compressed(ns + 3_000_000, png, form),
                )
            else:
                write("/cam/color/image_raw", ns, image(ns, blue, "bgr8"))
                write(
                    "/cam/depth/image_raw", ns + 3_000_000, image(ns + 3_000_000, depth_mm, "16UC1")
                )
            if second_camera:
                write("/rear/color/image_raw", ns, image(ns, blue, "bgr8"))
    return path


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("plugin", list(StoragePlugin))
def test_a_bag_gives_images_calibration_and_poses_from_tf(
    packed: bool, plugin: StoragePlugin, tmp_path: Path
) -> None:
    driver = ReplayDriver(write_bag(tmp_path / "bag", packed=packed, plugin=plugin))
    captures = [driver.capture() for _ in range(SHOTS)]
    assert driver.state().finished
    for k, capture in enumerate(captures):
        assert capture.stamp_ns == stamp(k)
        assert capture.color[5, 5, 2] > 200 > 60 > capture.color[5, 5, 0]
        assert float(capture.depth_m[3, 3]) == pytest.approx(2.0)
        wanted = base(k) @ camera_on_base(np.eye(4), HEIGHT_M, 0.0)
        np.testing.assert_allclose(capture.T_world_cam, wanted, atol=2e-3)  # middle of a tf chord
        assert (capture.camera.fx, capture.camera.width) == (60, WIDTH)


def test_a_pose_topic_replaces_missing_tf(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "bag", tf=False, pose_topic=True)
    source = open_source(path, PlaybackRange(topics="pose=/slam/pose"))
    assert source.shots[1].T_world_cam[:3, 3] == pytest.approx([0.2, 0.1, HEIGHT_M])
    assert source.shots[0].T_world_cam[:3, :3] == pytest.approx(R_BODY_CAM)
    with pytest.raises(InvalidInput, match="neither tf nor"):
        open_source(path)


def test_a_pose_topic_takes_precedence_over_tf(tmp_path: Path) -> None:
    """The frame of the poses is the camera, which static tf attaches to the base."""
    path = write_bag(tmp_path / "bag", pose_topic=True)
    source = open_source(path, PlaybackRange(topics="pose=/slam/pose"))
    for k, shot in enumerate(source.shots):
        wanted = base(k) @ camera_on_base(np.eye(4), HEIGHT_M, 0.0)
        np.testing.assert_allclose(shot.T_world_cam, wanted, atol=1e-9)


def test_a_frame_with_two_tf_parents_is_refused_unless_a_pose_topic_is_given(
    tmp_path: Path,
) -> None:
    path = write_bag(tmp_path / "bag", pose_topic=True, second_parent=True)
    with pytest.raises(InvalidInput, match="optical hangs below base_link and below gripper") as e:
        open_source(path)
    assert "--topics pose=" in e.value.message
    assert len(open_source(path, PlaybackRange(topics="pose=/slam/pose")).shots) == SHOTS


def test_images_without_a_pose_are_reported(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """The only pose is used for images up to 0.5 s after it."""
    topics = PlaybackRange(topics="pose=/slam/pose")
    whole = write_bag(tmp_path / "whole", tf=False, pose_topic=True)
    part = write_bag(tmp_path / "part", tf=False, pose_topic=True, shots=10, poses=1)
    with caplog.at_level(logging.WARNING, "helios_replay"):
        assert open_source(whole, topics).left_out == ""
        assert not caplog.messages
        source = open_source(part, topics)
    assert len(source.shots) == 6
    assert source.left_out.startswith("4 of 10 images left out: no depth within 0.02 s or no pose")
    assert source.left_out in caplog.text


@pytest.mark.parametrize(("deepest_m", "steps"), [(10.0, 100), (4.0, 50)])
def test_inverse_depth_is_decoded_to_metres(deepest_m: float, steps: int, tmp_path: Path) -> None:
    """By the definition of the format: a = n (n + 1), b = 1 - a / deepest."""
    a = steps * (steps + 1.0)
    bag = write_bag(tmp_path / "bag", packed=True, inverse=(a, 1 - a / deepest_m))
    depth_m = open_source(bag).read(0).depth_m
    assert float(depth_m[3, 3]) == pytest.approx(2.0, abs=2.0**2 / a)  # one quantisation step
    assert depth_m[0, 0] == 0


@pytest.mark.parametrize("inverse", [(0.0, 1.0), (math.nan, 1.0), (5.0, -math.inf)])
def test_inverse_depth_with_invalid_coefficients_is_refused(inverse: tuple[float, float]) -> None:
    png = cv2.imencode(".png", np.ones((HEIGHT, WIDTH), np.uint16))[1].tobytes()
    data = struct.pack("<iff", 0, *inverse) + png
    with pytest.raises(InvalidInput, match="depth is inverse depth with a = "):
        depth_of(compressed(0, data, "32FC1; compressedDepth"), True, "depth")


def test_depth_of_a_distorted_camera_is_rectified_without_new_values(tmp_path: Path) -> None:
    source = open_source(write_bag(tmp_path / "bag", distortion=[-0.3, 0.1, 0.0, 0.0, 0.0]))
    picture = source.read(0)
    assert picture.depth_m.shape == (HEIGHT, WIDTH)
    assert set(np.unique(picture.depth_m)) <= {np.float32(0.0), np.float32(2000) * np.float32(1e-3)}


def test_an_ambiguous_colour_topic_must_be_named(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "bag", second_camera=True)
    with pytest.raises(InvalidInput, match=r"--topics color=") as error:
        open_source(path)
    assert "/rear/color/image_raw" in error.value.message
    named = open_source(path, PlaybackRange(topics="color=/cam/color/image_raw"))
    assert len(named.shots) == SHOTS


@pytest.mark.parametrize(
    ("topics", "words"),
    [
        ("colour=/x", "colour=/x"),
        ("color", "wanted NAME=/topic"),
        ("depth=/nowhere", "depth=/nowhere"),
        ("world=mars", "mars"),
    ],
)
def test_invalid_topic_options_are_refused_in_one_sentence(
    topics: str, words: str, tmp_path: Path
) -> None:
    path = write_bag(tmp_path / "bag")
    with pytest.raises(InvalidInput, match=words) as error:
        open_source(path, PlaybackRange(topics=topics))
    assert "\n" not in error.value.message


def test_a_broken_bag_is_refused_in_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "metadata.yaml").write_text("nonsense: [")
    with pytest.raises(InvalidInput, match="no ROS bag") as error:
        open_source(tmp_path)
    assert "\n" not in error.value.message


@pytest.mark.parametrize("share", [0.0, 0.25, 1.0])
def test_slerp_interpolates_rotations(share: float) -> None:
    a, b = np.array([0, 0, 0, 1.0]), np.array([0, 0, math.sin(0.4), math.cos(0.4)])
    half = 0.4 * share
    np.testing.assert_allclose(slerp(a, b, share), [0, 0, math.sin(half), math.cos(half)])
    np.testing.assert_allclose(np.abs(slerp(a, -b, share)), np.abs(slerp(a, b, share)))


@pytest.mark.parametrize(
    ("topic", "camera", "is_distorted"),
    [
        ("/rgb/image_raw", (60.0, 32.0), True),
        ("/rgb/image_rect_color", (50.0, 30.0), False),
        ("/rgb/image_rect/compressed", (50.0, 30.0), False),
    ],
)
def test_rectified_images_have_the_camera_of_p_and_no_distortion(
    topic: str, camera: tuple[float, float], is_distorted: bool
) -> None:
    told = info(1, [-0.3, 0.1, 0, 0, 0])
    told.p = np.array([50, 0, 30, 0, 0, 50, 22, 0, 0, 0, 1, 0], float)
    lens = Lens.of(told, "its CameraInfo", topic)
    assert (lens.camera.fx, lens.camera.cx) == camera
    assert bool(lens.distortion.size) is is_distorted


def test_rectified_images_without_a_rectified_calibration_are_refused() -> None:
    with pytest.raises(InvalidInput, match="is no calibration of rectified images"):
        Lens.of(info(1, []), "its CameraInfo", "/rgb/image_rect")
