"""Boxes and labels of detections, drawn on an image."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from helios_gateway.class_colors import class_rgb

FONT = cv2.FONT_HERSHEY_SIMPLEX


@dataclass(frozen=True)
class Box:
    """Bounding box of one detection, in pixels."""

    class_name: str
    score: float
    x: int
    y: int
    width: int
    height: int


def draw_boxes(bgr: NDArray, boxes: tuple[Box, ...]) -> NDArray:
    """Image with a frame and a label around each box, clipped at the border.

    bgr: uint8 [h, w, 3], drawn on in place if it is contiguous, else copied first.
    """
    out = np.ascontiguousarray(bgr)
    height, width = out.shape[:2]
    scale = max(0.4, height / 800)
    for box in sorted(boxes, key=lambda b: -b.width * b.height):
        x0, y0 = min(box.x, width - 1), min(box.y, height - 1)
        x1, y1 = min(box.x + box.width, width) - 1, min(box.y + box.height, height) - 1
        r, g, b = class_rgb(box.class_name)
        color = (b, g, r)
        cv2.rectangle(out, (x0, y0), (x1, y1), color, 2, cv2.LINE_AA)
        text = f"{_printable(box.class_name)} {box.score:.2f}"
        (w, h), base = cv2.getTextSize(text, FONT, scale, 1)
        left = max(0, min(x0, width - w - 6))
        top = y0 - h - base - 4 if y0 > h + base + 4 else y0 + 2
        cv2.rectangle(out, (left, top), (left + w + 6, top + h + base + 4), color, cv2.FILLED)
        at = (left + 3, top + h + 2)
        cv2.putText(out, text, at, FONT, scale, _readable_on(color), 1, cv2.LINE_AA)
    return out


def _readable_on(bgr: tuple[int, int, int]) -> tuple[int, int, int]:
    """Black or white, whichever has more contrast (ITU-R BT.709 luma)."""
    luma = 0.0722 * bgr[0] + 0.7152 * bgr[1] + 0.2126 * bgr[2]
    return (0, 0, 0) if luma > 110 else (255, 255, 255)


def _printable(text: str) -> str:
    """ASCII text of at most 40 characters; Hershey fonts have no other glyphs."""
    return text.encode("ascii", "replace").decode()[:40]
