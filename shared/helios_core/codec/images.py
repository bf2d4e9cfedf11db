"""Decoding and validation of the colour and depth images of a Frame message."""

from __future__ import annotations

import math
import struct

import cv2
import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from numpy.typing import NDArray

from helios_core import proto as pb
from helios_core.errors import InvalidInput
from helios_core.image_messages import Buffer

MAX_PIXELS = 16_000_000  # a larger image is refused before it is decoded
FARTHEST_DEPTH_M = 1000.0  # greater depth counts as invalid: beyond the range of any sensor
_BYTES_PER_PIXEL = {"rgb8": 3, "bgr8": 3, "16UC1": 2, "32FC1": 4}
_JPEG_SIZES = set(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}  # markers of a frame header
_JPEG_SEGMENTS = {0xC4, 0xCC, *range(0xDB, 0xDE), *range(0xE0, 0xF0), 0xFE}  # that a length follows


def raw_image_array(image: RawImage, what: str, data: Buffer | None = None) -> NDArray:
    """Pixels of a raw image, [h, w] or [h, w, 3]; views of its bytes where the layout allows.

    data: its bytes, if they are not in the message. Raises InvalidInput if data and size disagree.
    """
    data = image.data if data is None else data
    if image.encoding not in _BYTES_PER_PIXEL:
        known = ", ".join(_BYTES_PER_PIXEL)
        raise InvalidInput(f"{what} has encoding {image.encoding!r}; send one of {known}")
    size = _BYTES_PER_PIXEL[image.encoding]
    step = image.step or image.width * size
    if image.width == 0 or image.height == 0:
        raise InvalidInput(f"{what} is empty ({image.width}x{image.height}); send a real image")
    _check_pixels(image.width, image.height, what)
    if step < image.width * size or len(data) != step * image.height:
        raise InvalidInput(
            f"{what} is {image.width}x{image.height} {image.encoding} with step {step}, which "
            f"needs {step * image.height} bytes; {len(data)} came"
        )
    rows = np.frombuffer(data, np.uint8).reshape(image.height, step)
    pixels = rows[:, : image.width * size]
    if size == 3:
        return pixels.reshape(image.height, image.width, 3)
    dtype = np.dtype("<u2") if size == 2 else np.dtype("<f4")
    return np.ascontiguousarray(pixels).view(dtype)


def encoded_size(data: bytes) -> tuple[int, int] | None:
    """(width, height) in the header of a PNG or JPEG, as the decoder reads it; None for any other
    data, and for a JPEG with a marker before its frame header that encoders write only later."""
    if data[:8] == b"\x89PNG\r\n\x1a\n" and data[12:16] == b"IHDR" and len(data) >= 24:
        width, height = struct.unpack(">II", data[16:24])
        return width, height
    if data[:2] != b"\xff\xd8":
        return None
    at = 2
    while at + 9 < len(data) and data[at] == 0xFF:
        marker = data[at + 1]
        if marker in _JPEG_SIZES:
            height, width = struct.unpack(">HH", data[at + 5 : at + 9])
            return width, height
        if marker == 0xFF:  # a fill byte
            at += 1
        elif marker in _JPEG_SEGMENTS:
            at += 2 + int.from_bytes(data[at + 2 : at + 4], "big")
        else:  # the decoder skips some of these, and reads no length
            return None
    return None


def check_color_depth(data: bytes, what: str) -> None:
    """Raise InvalidInput for a PNG with 16 bit a channel.

    A decoder would silently drop half of the bits, and such a PNG is usually a depth image in the
    wrong field.
    """
    if data[:8] == b"\x89PNG\r\n\x1a\n" and data[24:25] == b"\x10":
        raise InvalidInput(
            f"{what} is a PNG of 16 bit a channel; send 8 bit a channel (JPEG or PNG), and depth "
            "as the depth image"
        )


def decode_image(image: CompressedImage, flags: int, what: str) -> NDArray:
    """Pixels of a JPEG or PNG in OpenCV's channel order, as they are stored.

    An EXIF orientation, such as a phone writes, turns nothing: depth and K belong to the stored
    pixels. Raises InvalidInput if the image is corrupt.
    """
    data = bytes(image.data)
    size = encoded_size(data)
    if size is None:
        raise InvalidInput(
            f"{what} is {len(data)} bytes that are no JPEG or PNG (format says {image.format!r}); "
            "send a whole JPEG or PNG file"
        )
    _check_pixels(*size, what)
    try:
        stored = np.frombuffer(data, np.uint8)
        pixels = cv2.imdecode(stored, flags | cv2.IMREAD_IGNORE_ORIENTATION)
    except cv2.error as error:
        raise InvalidInput(f"{what} cannot be decoded ({error.err}); send a whole image") from error
    if pixels is None:
        raise InvalidInput(f"{what} cannot be decoded; {len(data)} bytes came; send a whole image")
    return pixels


def color_array(
    raw: RawImage | None, compressed: CompressedImage | None, data: Buffer | None = None
) -> NDArray[np.uint8]:
    """RGB [h, w, 3] of the raw or the compressed image; of a raw one in rgb8 a view.

    data: the raw image's bytes, if they are not in the message. Raises InvalidInput without either
    image.
    """
    if raw is not None:
        pixels = raw_image_array(raw, "the colour image", data)
        if raw.encoding not in ("rgb8", "bgr8"):
            raise InvalidInput(f"the colour image has encoding {raw.encoding}; send rgb8 or bgr8")
        return pixels if raw.encoding == "rgb8" else np.ascontiguousarray(pixels[..., ::-1])
    if compressed is not None:
        check_color_depth(compressed.data, "the colour image")
        bgr = decode_image(compressed, cv2.IMREAD_COLOR, "the colour image")
        return cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB).astype(np.uint8, copy=False)
    raise InvalidInput("the frame has no colour image; send raw_color or compressed_color")


def depth_array(
    raw: RawImage | None, compressed: CompressedImage | None, data: Buffer | None = None
) -> NDArray[np.float32]:
    """Depth [h, w] in metres, never a view; NaN, negative values and values above FARTHEST_DEPTH_M
    become 0.

    data: the raw image's bytes, if they are not in the message.
    """
    if raw is not None:
        pixels = raw_image_array(raw, "the depth image", data)
        if raw.encoding == "16UC1":
            return _metres(pixels)
        if raw.encoding != "32FC1":
            raise InvalidInput(f"the depth image has encoding {raw.encoding}; send 16UC1 or 32FC1")
        good = (pixels > 0) & (pixels <= FARTHEST_DEPTH_M)  # False for NaN
        return np.where(good, pixels, np.float32(0)).astype(np.float32, copy=False)
    if compressed is not None:
        return _metres(depth_mm_array(compressed))
    raise InvalidInput(
        "the frame has no depth image; send raw_depth or compressed_depth, over HTTP the part depth"
    )


def _metres(depth_mm: NDArray[np.uint16]) -> NDArray[np.float32]:
    depth_m = depth_mm.astype(np.float32)
    depth_m *= np.float32(0.001)
    return depth_m


def depth_mm_array(compressed: CompressedImage) -> NDArray[np.uint16]:
    """Depth [h, w] in millimetres of a 16-bit PNG; 0 is invalid."""
    pixels = decode_image(compressed, cv2.IMREAD_UNCHANGED, "the depth image")
    if pixels.dtype != np.uint16 or pixels.ndim != 2:
        raise InvalidInput(
            f"the depth image decodes to {pixels.dtype} {pixels.shape}; send a PNG with one "
            "channel of 16 bit, millimetres"
        )
    return pixels


def _check_pixels(width: int, height: int, what: str) -> None:
    if width * height > MAX_PIXELS:
        raise InvalidInput(
            f"{what} is {width}x{height}; at most {MAX_PIXELS // 10**6} megapixels are taken; "
            "send a smaller one"
        )


def estimated_depth(reply: pb.DepthReply, shape: tuple[int, int]) -> NDArray[np.float32]:
    """Depth [h, w] along the optical axis (m) that a model estimated for an image of `shape`.

    Raises InvalidInput for another shape, or a focal length that is not positive and finite.
    """
    depth_m = depth_array(reply.raw_depth, None)
    if depth_m.shape != shape:
        raise InvalidInput(f"{reply.model} made depth of {depth_m.shape} for an image of {shape}")
    if not 0 < reply.focal_px < math.inf:
        raise InvalidInput(
            f"{reply.model} told a focal length of {reply.focal_px} pixels; wanted a positive one"
        )
    return depth_m
