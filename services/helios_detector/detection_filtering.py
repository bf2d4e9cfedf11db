"""Boxes, scores and masks of one frame: suppression, one class for each box, masks near it."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from helios_detector.box_to_mask import Box

NMS_IOU = 0.45
MAX_PER_CLASS = 50
FARTHEST_PX = 1e6  # of a corner; beyond it OpenCV's arithmetic ends
REACH_SHARE = 0.25  # of its box's larger side: how far a mask may go beyond the box


def suppressed(boxes: NDArray[np.float32], scores: NDArray[np.float32]) -> list[int]:
    """Indices of the boxes [n, 4] xyxy of one class that stay, best first; at most 50.

    Scores are above 0; boxes may hold infinite corners.
    """
    corners = np.clip(boxes, -FARTHEST_PX, FARTHEST_PX)
    sizes = np.concatenate([corners[:, :2], corners[:, 2:] - corners[:, :2]], 1)
    kept = cv2.dnn.NMSBoxes(sizes.tolist(), scores.tolist(), 0.0, NMS_IOU)
    return [int(i) for i in np.asarray(kept).ravel()[:MAX_PER_CLASS]]


def one_class_each(
    boxes: NDArray[np.float32],  # [n, 4] xyxy
    scores: NDArray[np.float32],  # [n, classes]
    thresholds: NDArray[np.float32],  # [classes]
) -> list[tuple[int, int]]:
    """(box, class) pairs: a box goes to its best class among those whose threshold it passes.

    Of boxes of one class that overlap, the best stays: one thing found by several synonyms.
    """
    if not scores.size:
        return []
    passing = np.where(scores >= thresholds, scores, -1.0)
    best = passing.argmax(1)
    best_scores = passing[np.arange(len(best)), best].astype(np.float32)
    out = []
    for c in range(scores.shape[1]):
        some = np.flatnonzero((best == c) & (best_scores > 0))
        kept = suppressed(boxes[some], best_scores[some])
        out += [(int(some[i]), c) for i in kept]
    return out


def box_of(mask: NDArray[np.bool_]) -> Box:
    """The smallest box around a mask [h, w] that is not empty."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1


def near_box(mask: NDArray[np.bool_], box_xyxy: Box) -> NDArray[np.bool_]:
    """What of a mask [h, w] belongs to a box: its connected parts that reach into the box, as far
    as a quarter of the box's larger side beyond it.

    A model that is given a box follows the thing beyond it, which is right, but may also leak into
    what carries the thing, and leaves specks all over the image.
    """
    x0, y0, x1, y1 = box_xyxy
    reach = round(REACH_SHARE * max(x1 - x0, y1 - y0))
    left, top = max(0, x0 - reach), max(0, y0 - reach)
    near = mask[top : y1 + reach, left : x1 + reach]
    _, labels = cv2.connectedComponents(near.astype(np.uint8), connectivity=8)
    inside = np.unique(labels[y0 - top : y1 - top, x0 - left : x1 - left])
    out = np.zeros_like(mask)
    out[top : y1 + reach, left : x1 + reach] = near & np.isin(labels, inside)
    return out
