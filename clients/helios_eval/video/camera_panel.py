"""The robot's image with its detections."""

from __future__ import annotations

import cv2
import numpy as np

from helios_eval.video.drawing import INK, WHITE, Picture, Sheet, cut, pill_size
from helios_eval.video.frame_content import Scene

LABEL_PX = 12
MASK_SHARE = 0.38


def camera_picture(scene: Scene, width: int, height: int) -> Picture:
    """RGB [height, width, 3]: the whole image, as large as fits, on a dark background."""
    out = np.full((height, width, 3), INK, np.uint8)
    if scene.color is None:
        sheet = Sheet(out)
        sheet.text(
            width / 2, height / 2, "no picture yet", width - 20, 13, (170, 178, 190), align="m"
        )
        return sheet.pixels
    rows, columns = scene.color.shape[:2]
    scale = min(width / columns, height / rows)
    w, h = max(1, round(columns * scale)), max(1, round(rows * scale))
    left, top = (width - w) // 2, (height - h) // 2
    how = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    picture = cv2.resize(_tinted_by_masks(scene), (w, h), interpolation=how)
    labels: list[tuple[float, float, str, tuple[int, int, int]]] = []
    for detection in sorted(scene.detections, key=lambda d: d.score):
        x0, y0, x1, y1 = (round(v * scale) for v in detection.box_xyxy)
        color = scene.color_of(detection.class_name)
        cv2.rectangle(picture, (x0, y0), (x1 - 1, y1 - 1), WHITE, 4, cv2.LINE_AA)
        cv2.rectangle(picture, (x0, y0), (x1 - 1, y1 - 1), color, 2, cv2.LINE_AA)
        labels.append((x0, y0, f"{detection.class_name} {detection.score:.2f}", color))
    out[top : top + h, left : left + w] = picture
    sheet = Sheet(out)
    for x, y, text, color in labels:
        shown = cut(text, width * 0.6, LABEL_PX, bold=True)
        wide, high = pill_size(shown, LABEL_PX, bold=True)
        at_x = float(np.clip(left + x, 2, max(2, width - wide - 2)))
        at_y = float(np.clip(top + y - high / 2 - 2, high / 2 + 2, height - high / 2 - 2))
        sheet.pill(at_x, at_y, shown, width * 0.7, LABEL_PX, color, bold=True)
    return sheet.pixels


def _tinted_by_masks(scene: Scene) -> Picture:
    assert scene.color is not None
    out = scene.color.astype(np.float32)
    # Largest first, so that a table does not cover the mug on it.
    for detection in sorted(scene.detections, key=lambda d: -int(d.mask.sum())):
        if detection.mask.shape == out.shape[:2]:
            color = np.array(scene.color_of(detection.class_name), np.float32)
            out[detection.mask] += (color - out[detection.mask]) * MASK_SHARE
    return out.round().astype(np.uint8)
