"""Display colour of a class name."""

from __future__ import annotations

import colorsys
import zlib


def class_rgb(name: str) -> tuple[int, int, int]:
    """Saturated RGB colour, 0 to 255 each; the same for the same class everywhere."""
    hue = (zlib.crc32(name.encode()) % 360) / 360
    r, g, b = colorsys.hls_to_rgb(hue, 0.45, 0.9)
    return int(r * 255), int(g * 255), int(b * 255)
