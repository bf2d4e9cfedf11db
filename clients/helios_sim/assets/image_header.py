"""Size of an image from its header, without decoding it."""

from __future__ import annotations

import struct


def pixels_of(data: bytes) -> tuple[int, int] | None:
    """(width, height) of a PNG, JPEG, GIF or BMP file; None for any other or damaged file."""
    try:
        if data[:8] == b"\x89PNG\r\n\x1a\n":
            width, height = struct.unpack(">II", data[16:24])
        elif data[:6] in (b"GIF87a", b"GIF89a"):
            width, height = struct.unpack("<HH", data[6:10])
        elif data[:2] == b"BM":
            width, height = struct.unpack("<ii", data[18:26])
        elif data[:2] == b"\xff\xd8":
            return _jpeg(data)
        else:
            return None
    except struct.error:
        return None
    return abs(width), abs(height)


def _jpeg(data: bytes) -> tuple[int, int] | None:
    """Size in the frame header, the first segment SOF0 to SOF15 except DHT, JPG and DAC."""
    at = 2
    while at + 9 <= len(data):
        if data[at] != 0xFF:
            return None
        marker = data[at + 1]
        if marker == 0xFF or marker == 0x01 or 0xD0 <= marker <= 0xD8:
            at += 1 if marker == 0xFF else 2
            continue
        (length,) = struct.unpack(">H", data[at + 2 : at + 4])
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            height, width = struct.unpack(">HH", data[at + 5 : at + 9])
            return width, height
        at += 2 + length
    return None
