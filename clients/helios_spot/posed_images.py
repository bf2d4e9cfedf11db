"""Posed RGB-D images from one of Spot's cameras, and the hand's image for a grasp."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from helios_core.bus import Bus
from helios_core.depth_registration import registered
from helios_core.errors import InvalidInput, Unavailable
from helios_core.geometry import Matrix, Pinhole, invert
from helios_core.robot import Capture
from numpy.typing import NDArray

from helios_spot import bosdyn_api
from helios_spot.cameras import (
    Mount,
    lens_of,
    mounted,
    roll_to_upright,
    straight_color,
    straight_depth,
)
from helios_spot.depth_completion import estimated, filled, load_estimator
from helios_spot.errors import doing
from helios_spot.frame_transforms import BODY, VISION, base_below_body, pose
from helios_spot.robot_connection import RobotConnection
from helios_spot.robot_state import Reading
from helios_spot.self_mask import robot_capsules, robot_pixels

log = logging.getLogger(__name__)

JPEG_QUALITY = 90  # percent
HAND_COLOR = "hand_color_image"
BEYOND_U16 = 65535


@dataclass(frozen=True)
class Sources:
    """Names of a camera's images: colour, depth registered to colour, unregistered depth."""

    color: str
    on_color: str
    raw: str


def sources_of(camera: str) -> Sources:
    """The image names of a camera, the same on every Spot."""
    if camera == "hand":
        return Sources(HAND_COLOR, "hand_depth_in_hand_color_frame", "hand_depth")
    return Sources(f"{camera}_fisheye_image", f"{camera}_depth_in_visual_frame", f"{camera}_depth")


@dataclass(frozen=True)
class HandShot:
    """Image of the hand's camera for a grasp by pixel, with its camera model, pose and frames."""

    response: Any
    camera: Pinhole
    T_vision_cam: Matrix


class SpotCameras:
    """The camera that the settings name, and the hand's camera. For one thread."""

    def __init__(self, link: RobotConnection, bus: Bus | None) -> None:
        """Raises InvalidInput when the settings require a depth estimator that does not exist."""
        self._link, self._s = link, link.settings
        self._estimator = None
        if self._s.depth != "sensor":
            self._estimator = load_estimator(self._s.depth_estimator, bus, self._s.depth_timeout_s)
        self._names = sources_of(self._s.camera)
        self._depth_name = ""
        self._mount: Mount | None = None
        self.T_body_cam: Matrix = np.eye(4)
        self.has_hand = False
        self.hand_is_pinhole = False  # required by a grasp by pixel

    @property
    def mount(self) -> Mount:
        if self._mount is None:
            raise Unavailable("the robot's cameras are not known yet; wait for the connection")
        return self._mount

    def open(self) -> None:
        """Find the camera. Raises InvalidInput when the robot does not have it."""
        with doing("list the robot's cameras", self._link.host):
            listed = self._link.client("image").list_image_sources(timeout=self._s.rpc_timeout_s)
        have = {source.name: source for source in listed}
        names = self._names
        depth = next((n for n in (names.on_color, names.raw) if n in have), "")
        if names.color not in have or not (depth or self._s.depth == "estimate"):
            missing = names.color if names.color not in have else names.on_color
            raise InvalidInput(
                f"the robot has no image {missing!r}, only {', '.join(sorted(have)) or 'none'}; "
                "set HELIOS_SPOT_CAMERA to a camera that it has"
            )
        self._depth_name = depth
        hand = have.get(HAND_COLOR)
        self.has_hand = hand is not None
        self.hand_is_pinhole = hand is not None and _is_pinhole(hand)
        (shot,) = self._ask([self._color_request(names.color)])
        tree = shot.shot.transforms_snapshot
        self.T_body_cam = pose(tree, BODY, shot.shot.frame_name_image_sensor)
        roll_rad = 0.0  # the hand's camera is upright if the hand is
        if self._s.camera != "hand":
            roll_rad = math.radians(round(math.degrees(roll_to_upright(self.T_body_cam))))
        self._mount = mounted(lens_of(shot.source), roll_rad)

    def capture(self, reading: Reading) -> Capture:
        """The newest image; pixels that show the robot have depth 0."""
        mount = self.mount
        requests = [self._color_request(self._names.color)]
        if self._s.depth != "estimate":
            requests.append(
                bosdyn_api.image.build_image_request(
                    self._depth_name, image_format=bosdyn_api.image_pb2.Image.FORMAT_RAW
                )
            )
        shots = self._ask(requests)
        shot = shots[0].shot
        T_vision_cam = pose(shot.transforms_snapshot, VISION, shot.frame_name_image_sensor)
        T_vision_upright = T_vision_cam @ mount.T_cam_upright
        color = straight_color(mount, decode_color(shot.image, self._names.color))
        depth_m = np.zeros(color.shape[:2], np.float32)
        if len(shots) == 2:
            depth_m = self._depth(shots[1], T_vision_upright)
        sure = (depth_m >= self._s.min_depth_m) & (depth_m <= self._s.max_depth_m)
        depth_m = np.where(sure, depth_m, np.float32(0))
        if self._estimator is not None:
            guess_m = estimated(self._estimator, color, mount.camera)
            guess_m[guess_m > self._s.max_depth_m] = 0.0
            depth_m = guess_m if self._s.depth == "estimate" else filled(depth_m, guess_m)
        T_vision_body = pose(shot.transforms_snapshot, VISION, BODY)
        capsules = robot_capsules(
            reading.joints_rad, reading.T_body_wrist, reading.T_body_hand, reading.holding
        )
        own = robot_pixels(capsules, invert(T_vision_body) @ T_vision_upright, mount.camera)
        depth_m[own] = 0.0
        return Capture(
            stamp_ns=shot.acquisition_time.ToNanoseconds(),
            color=color,
            depth_m=depth_m,
            camera=mount.camera,
            T_world_cam=reading.T_world_vision @ T_vision_upright,
            T_world_base=base_below_body(reading.T_world_vision @ T_vision_body),
        )

    def hand_shot(self) -> HandShot:
        """The hand's unrectified image. Raises InvalidInput if it is not a pinhole camera's."""
        (response,) = self._ask([self._color_request(HAND_COLOR)])
        camera = lens_of(response.source)
        if not _is_pinhole(response.source):
            raise InvalidInput("the hand's camera has no pinhole model; a grasp by pixel needs one")
        shot = response.shot
        T_vision_cam = pose(shot.transforms_snapshot, VISION, shot.frame_name_image_sensor)
        return HandShot(response, camera.camera, T_vision_cam)

    def _ask(self, requests: list[Any]) -> Any:
        with doing("take an image", self._link.host):
            return self._link.client("image").get_image(requests, timeout=self._s.rpc_timeout_s)

    def _color_request(self, name: str) -> Any:
        pixel = bosdyn_api.image_pb2.Image
        return bosdyn_api.image.build_image_request(
            name,
            quality_percent=JPEG_QUALITY,
            image_format=pixel.FORMAT_JPEG,
            pixel_format=pixel.PIXEL_FORMAT_RGB_U8 if name == HAND_COLOR else None,
        )

    def _depth(self, response: Any, T_vision_upright: Matrix) -> NDArray[np.float32]:
        """Depth (m) on the upright camera's pixels, from registered or unregistered depth."""
        depth_m = decode_depth(response)
        if response.source.name == self._names.on_color:
            return straight_depth(self.mount, depth_m)
        shot = response.shot
        T_vision_depth = pose(shot.transforms_snapshot, VISION, shot.frame_name_image_sensor)
        T_upright_depth = invert(T_vision_upright) @ T_vision_depth
        return registered(
            depth_m, lens_of(response.source).camera, T_upright_depth, self.mount.camera
        )


def _is_pinhole(source: Any) -> bool:
    return source.WhichOneof("camera_models") == "pinhole"


def decode_color(image: Any, name: str = "colour") -> NDArray[np.uint8]:
    """RGB [h, w, 3]; grey images get three equal channels. name: of the image, for errors.

    Raises Unavailable for a broken image, and a raw one that has not 1, 3 or 4 bytes per pixel.
    """
    data = np.frombuffer(image.data, np.uint8)
    rows, columns = image.rows, image.cols
    if image.format == image.FORMAT_RAW:
        size = rows * columns
        channels = next((c for c in (1, 3, 4) if size and data.size == c * size), 0)
        if not channels:
            raise Unavailable(
                f"the robot sent the raw image {name!r} of {columns}x{rows} pixels as {data.size} "
                f"bytes, wanted {size}, {3 * size} or {4 * size}; try again"
            )
        pixels = data.reshape(rows, columns, channels)
        return np.ascontiguousarray(np.broadcast_to(pixels[..., :3], (rows, columns, 3)))
    as_stored = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION  # as depth and K
    bgr = cv2.imdecode(data, as_stored) if data.size else None
    if bgr is None or bgr.shape[:2] != (rows, columns):
        came = "no image" if bgr is None else f"an image of {bgr.shape[1]}x{bgr.shape[0]}"
        raise Unavailable(
            f"the robot sent the image {name!r} as {data.size} bytes that are {came}, wanted "
            f"{columns}x{rows} pixels; try again"
        )
    return cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB).astype(np.uint8, copy=False)


def decode_depth(response: Any) -> NDArray[np.float32]:
    """Depth [h, w] in metres; 0 is invalid. Raises Unavailable for a broken image."""
    image, source = response.shot.image, response.source
    size = image.rows * image.cols
    if not size or len(image.data) != 2 * size:
        raise Unavailable(
            f"the robot sent the depth image {source.name!r} of {image.cols}x{image.rows} pixels "
            f"as {len(image.data)} bytes, wanted {2 * size}; try again"
        )
    if not 0 < source.depth_scale < math.inf:
        raise Unavailable(
            f"the robot sent the depth image {source.name!r} with a scale of "
            f"{source.depth_scale:g} units a metre, wanted a positive one; try again"
        )
    values = np.frombuffer(image.data, "<u2")
    values = np.where(values == BEYOND_U16, 0, values).reshape(image.rows, image.cols)
    return (values / source.depth_scale).astype(np.float32)
