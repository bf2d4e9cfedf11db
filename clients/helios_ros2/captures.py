"""A posed RGB-D image from a pair of ROS images: decoded, registered, without distortion."""

from __future__ import annotations

import numpy as np
from helios_core.depth_registration import registered
from helios_core.errors import InvalidInput, Unavailable
from helios_core.geometry import Matrix
from helios_core.robot import Capture
from helios_replay.ros_images import Lens, color_of, depth_of
from numpy.typing import NDArray

from helios_ros2.image_pairs import ImagePair
from helios_ros2.robot_input import RobotInput

LENS_WAIT_S = 1.0


def capture_of(pair: ImagePair, senses: RobotInput, lens: Lens) -> Capture:
    """Capture of a pair; lens: of the colour camera. Raises Unavailable, InvalidInput."""
    T_world_base, T_world_cam = senses.poses_at(pair.stamp_ns)
    color = color_of(pair.color, _is_compressed(pair.color), senses.color.topic)
    depth_m = depth_of(pair.depth, _is_compressed(pair.depth), senses.depth.topic)
    camera = lens.camera
    if color.shape[:2] != (camera.height, camera.width):
        raise InvalidInput(
            f"{senses.color.topic} is {color.shape[1]}x{color.shape[0]}, its CameraInfo "
            f"{camera.width}x{camera.height}; name the right one with HELIOS_ROS2_COLOR_INFO"
        )
    if is_registered(pair, depth_m, lens, senses.depth.topic):
        color, depth_m = lens.straight(color, depth_m)
    else:
        color = lens.straight_color(color)
        depth_m = _registered(pair, senses, depth_m, lens)
    return Capture(pair.stamp_ns, color, depth_m, camera, T_world_cam, T_world_base)


def is_registered(
    pair: ImagePair, depth_m: NDArray[np.float32], lens: Lens, depth_topic: str
) -> bool:
    """True if the depth image has the pixels of the colour image."""
    frames = {pair.color.header.frame_id, pair.depth.header.frame_id}
    same_view = len(frames) == 1 or "aligned" in depth_topic or "registered" in depth_topic
    return same_view and depth_m.shape == (lens.camera.height, lens.camera.width)


def _registered(
    pair: ImagePair, senses: RobotInput, depth_m: NDArray[np.float32], lens: Lens
) -> NDArray[np.float32]:
    depth_lens = senses.lens("depth", LENS_WAIT_S)
    seen = depth_lens.camera
    if depth_m.shape != (seen.height, seen.width):
        raise InvalidInput(
            f"{senses.depth.topic} is {depth_m.shape[1]}x{depth_m.shape[0]}, its CameraInfo "
            f"{seen.width}x{seen.height}; name the right one with HELIOS_ROS2_DEPTH_INFO"
        )
    T_color_depth = _between_cameras(pair, senses)
    return registered(depth_lens.straight_depth(depth_m), seen, T_color_depth, lens.camera)


def _between_cameras(pair: ImagePair, senses: RobotInput) -> Matrix:
    color, depth = pair.color.header.frame_id, pair.depth.header.frame_id
    if color == depth:
        return np.eye(4)
    try:
        return senses.between(color, depth, pair.stamp_ns)
    except Unavailable as error:
        raise Unavailable(
            f"{senses.depth.topic} is not registered to {senses.color.topic}, and TF does not "
            f"connect their frames {depth} and {color} ({error.message}); let the camera publish "
            "aligned depth (align_depth.enable:=true), or build tf2_msgs"
        ) from error


def _is_compressed(message: object) -> bool:
    return hasattr(message, "format")
