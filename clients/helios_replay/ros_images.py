"""Conversion of `sensor_msgs` messages to arrays."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from helios_core.codec.images import MAX_PIXELS, decode_image
from helios_core.errors import InvalidInput
from helios_core.geometry import Pinhole
from numpy.typing import NDArray

# Header before the PNG of "compressedDepth": its kind, and a and b of depth = a / (value - b).
COMPRESSED_DEPTH_HEADER = struct.Struct("<iff")
_TO_RGB = {
    "rgb8": (3, None),
    "bgr8": (3, cv2.COLOR_BGR2RGB),
    "rgba8": (4, cv2.COLOR_RGBA2RGB),
    "bgra8": (4, cv2.COLOR_BGRA2RGB),
    "mono8": (1, cv2.COLOR_GRAY2RGB),
}
_DEPTH = {"16UC1": ("u2", 0.001), "mono16": ("u2", 0.001), "32FC1": ("f4", 1.0)}


def stamp_ns(header: Any) -> int:
    """Stamp of a `std_msgs/Header` in nanoseconds."""
    return int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)


def color_of(message: Any, is_compressed: bool, what: str) -> NDArray[np.uint8]:
    """RGB [h, w, 3] of an image message. Raises InvalidInput; `what` names the image in it."""
    if is_compressed:
        image = CompressedImage(data=bytes(message.data), format=str(message.format))
        bgr = decode_image(image, cv2.IMREAD_COLOR, what)
        return cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB).astype(np.uint8, copy=False)
    if message.encoding not in _TO_RGB:
        raise InvalidInput(f"{what} has encoding {message.encoding!r}; wanted {', '.join(_TO_RGB)}")
    channels, conversion = _TO_RGB[message.encoding]
    pixels = _pixels(message, np.dtype("u1"), channels, what)
    rgb = pixels if conversion is None else cv2.cvtColor(pixels, conversion)
    return rgb.astype(np.uint8, copy=False)


def depth_of(message: Any, is_compressed: bool, what: str) -> NDArray[np.float32]:
    """Depth [h, w] in metres of an image message; 0 is invalid. Raises InvalidInput."""
    if is_compressed:
        return _unpacked_depth(bytes(message.data), str(message.format), what)
    if message.encoding not in _DEPTH:
        raise InvalidInput(f"{what} has encoding {message.encoding!r}; wanted {', '.join(_DEPTH)}")
    kind, metres = _DEPTH[message.encoding]
    order = ">" if message.is_bigendian else "<"
    pixels = _pixels(message, np.dtype(order + kind), 1, what).astype(np.float32)
    return np.where(np.isfinite(pixels) & (pixels > 0), pixels * np.float32(metres), np.float32(0))


def _unpacked_depth(data: bytes, form: str, what: str) -> NDArray[np.float32]:
    """Depth [h, w] in metres from a PNG of millimetres, or of inverse depth (compressed 32FC1)."""
    has_header = "compressedDepth" in form
    png = data[COMPRESSED_DEPTH_HEADER.size if has_header else 0 :]
    pixels = decode_image(CompressedImage(data=png, format="png"), cv2.IMREAD_UNCHANGED, what)
    if pixels.dtype != np.uint16 or pixels.ndim != 2:
        raise InvalidInput(f"{what} decodes to {pixels.dtype}; wanted a PNG of 16 bit")
    if not (has_header and form.startswith("32FC1")):
        return pixels.astype(np.float32) * np.float32(0.001)
    _, a, b = COMPRESSED_DEPTH_HEADER.unpack_from(data)
    if not (math.isfinite(a) and a > 0 and math.isfinite(b)):
        raise InvalidInput(
            f"{what} is inverse depth with a = {a:g}, b = {b:g} in its header; wanted a above 0 "
            "and finite numbers: record it as 16UC1, or not compressed"
        )
    inverse = pixels.astype(np.float32) - np.float32(b)
    is_depth = (pixels > 0) & (inverse > 0)
    return np.where(is_depth, np.float32(a) / np.where(is_depth, inverse, 1), np.float32(0))


def _pixels(message: Any, dtype: np.dtype, channels: int, what: str) -> NDArray:
    height, width, step = int(message.height), int(message.width), int(message.step)
    row = width * channels * dtype.itemsize
    data = np.asarray(message.data).view(np.uint8)
    if not 0 < width * height <= MAX_PIXELS or step < row or data.size != step * height:
        raise InvalidInput(
            f"{what} is {width}x{height} with step {step} and {data.size} bytes; wanted "
            f"{row} bytes a row at least"
        )
    cut = np.ascontiguousarray(data.reshape(height, step)[:, :row]).view(dtype)
    return cut.reshape((height, width, channels) if channels > 1 else (height, width))


def is_rectified(image_topic: str) -> bool:
    """True if a topic has the name that image_proc gives to rectified images."""
    parts = [p for p in image_topic.split("/") if p not in ("compressed", "compressedDepth")]
    return bool(parts) and parts[-1].startswith("image_rect")


def _of_rectified(info: Any, what: str) -> Pinhole:
    P = [float(v) for v in (info.p if hasattr(info, "p") else info.P)]
    width, height = int(info.width), int(info.height)
    if len(P) != 12 or not np.isfinite(P).all() or min(P[0], P[5], width, height) <= 0:
        raise InvalidInput(
            f"{what} is no calibration of rectified images: P is {P}, the size {width}x{height}"
        )
    return Pinhole(P[0], P[5], P[2], P[6], width, height)


@dataclass(frozen=True)
class Lens:
    """Pinhole camera and distortion from a `sensor_msgs/CameraInfo`."""

    camera: Pinhole
    distortion: NDArray[np.float64]  # OpenCV's coefficients; empty: none

    @classmethod
    def of(cls, info: Any, what: str, image_topic: str) -> Lens:
        """The lens of a CameraInfo, for the images of a topic: K with distortion for raw ones, P
        for those that `is_rectified` names. Raises InvalidInput if it is not a pinhole calibration.
        """
        if is_rectified(image_topic):
            return cls(_of_rectified(info, what), np.empty(0))
        K = [float(v) for v in (info.k if hasattr(info, "k") else info.K)]
        d = np.array(info.d if hasattr(info, "d") else info.D, float)
        width, height = int(info.width), int(info.height)
        if not (np.isfinite(K).all() and K[0] > 0 and K[4] > 0 and width > 0 and height > 0):
            raise InvalidInput(f"{what} is no calibration: K is {K}, the size {width}x{height}")
        distorted = bool(np.abs(d).max(initial=0) > 1e-9)
        known = ("plumb_bob", "rational_polynomial", "")
        if distorted and info.distortion_model not in known:
            raise InvalidInput(
                f"{what} has the distortion model {info.distortion_model!r}; take rectified "
                "images, on a topic such as image_rect_color"
            )
        camera = Pinhole(K[0], K[4], K[2], K[5], width, height)
        return cls(camera, d if distorted else np.empty(0))

    def straight(
        self, color: NDArray[np.uint8], depth_m: NDArray[np.float32]
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Both images undistorted; depth by nearest neighbour, never interpolated."""
        return self.straight_color(color), self.straight_depth(depth_m)

    def straight_color(self, color: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Colour [h, w, 3] undistorted."""
        if not self.distortion.size:
            return color
        return cv2.remap(color, *self._maps, cv2.INTER_LINEAR).astype(np.uint8, copy=False)

    def straight_depth(self, depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
        """Depth [h, w] undistorted, by nearest neighbour."""
        if not self.distortion.size:
            return depth_m
        return cv2.remap(depth_m, *self._maps, cv2.INTER_NEAREST).astype(np.float32, copy=False)

    @cached_property
    def _maps(self) -> tuple[NDArray, NDArray]:
        size, K = (self.camera.width, self.camera.height), self.camera.matrix
        x, y = cv2.initUndistortRectifyMap(K, self.distortion, np.eye(3), K, size, cv2.CV_32FC1)
        return x, y
