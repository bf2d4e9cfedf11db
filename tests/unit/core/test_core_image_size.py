"""The size in the header of an image, which is checked before decoding, is the decoded size."""

from __future__ import annotations

import struct
import zlib

import cv2
import numpy as np
import pytest
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from helios_core.codec.images import decode_image, encoded_size
from helios_core.errors import InvalidInput
from hypothesis import example, given
from hypothesis import strategies as st

WIDTH, HEIGHT = 24, 40
JPEG = cv2.imencode(".jpg", np.zeros((HEIGHT, WIDTH, 3), np.uint8))[1].tobytes()
PNG = cv2.imencode(".png", np.zeros((HEIGHT, WIDTH, 3), np.uint8))[1].tobytes()
START, BODY = JPEG[:2], JPEG[2:]
DECOY = b"\xff\xc0\x00\x11\x08\x00\x10\x00\x10\x03" + bytes(20)  # frame header of 16x16
TO_THE_DECOY = len(BODY) + 2
MARKERS = st.sampled_from([0x00, 0x01, *range(0xC0, 0x100)]) | st.integers(0, 255)
SEGMENTS = st.builds(
    lambda marker, content: struct.pack(">BBH", 0xFF, marker, len(content) + 2) + content,
    st.sampled_from([*range(0xE0, 0xF0), 0xFE]),
    st.binary(max_size=30),
)


def decoded_size(data: bytes) -> tuple[int, int] | None:
    """(width, height) of the decoded image; None if it cannot be decoded."""
    try:
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        return None
    return None if pixels is None else (pixels.shape[1], pixels.shape[0])


@given(
    segments=st.lists(SEGMENTS, max_size=2),
    filling=st.integers(0, 2),
    marker=MARKERS,
    length=st.sampled_from([TO_THE_DECOY, 0, 1, 2, 3, 18]),
)
@example(segments=[], filling=0, marker=0x00, length=TO_THE_DECOY)
@example(segments=[], filling=0, marker=0x01, length=TO_THE_DECOY)
@example(segments=[], filling=0, marker=0xD0, length=TO_THE_DECOY)
def test_a_size_that_is_read_from_a_jpeg_with_any_marker_is_the_decoded_size(
    segments: list[bytes], filling: int, marker: int, length: int
) -> None:
    odd = b"\xff" * filling + struct.pack(">BBH", 0xFF, marker, length)
    data = START + b"".join(segments) + odd + BODY + DECOY
    assert decoded_size(data) in (None, encoded_size(data) or decoded_size(data))


@given(segments=st.lists(SEGMENTS, max_size=4), filling=st.integers(0, 3))
def test_segments_and_fill_bytes_before_the_frame_header_do_not_hide_the_size(
    segments: list[bytes], filling: int
) -> None:
    data = START + b"".join(b"\xff" * filling + segment for segment in segments) + BODY
    assert encoded_size(data) == decoded_size(data) == (WIDTH, HEIGHT)


@pytest.mark.parametrize("marker", [0x00, 0x01, *range(0xD0, 0xDA)])
def test_a_jpeg_with_a_marker_without_length_before_its_frame_header_is_refused(
    marker: int,
) -> None:
    data = START + struct.pack(">BBH", 0xFF, marker, TO_THE_DECOY) + BODY + DECOY
    with pytest.raises(InvalidInput, match="no JPEG or PNG"):
        decode_image(CompressedImage(data=data), cv2.IMREAD_COLOR, "the colour image")


def test_a_png_that_does_not_begin_with_its_header_is_refused() -> None:
    content = b"abCd" + struct.pack(">II", 16, 16) + bytes(5)
    chunk = struct.pack(">I", 13) + content + struct.pack(">I", zlib.crc32(content))
    assert encoded_size(PNG) == (WIDTH, HEIGHT)
    assert encoded_size(PNG[:8] + chunk + PNG[8:]) is None
