"""Filters for boxes and masks of one frame: suppression, one class per box, masks near boxes."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from helios_detector.box_to_mask import Box

NMS_IOU = 0.45
MAX_PER_CLASS = 50
FARTHEST_PX = 1e6  # corners are clipped here, since OpenCV cannot compute with larger values
REACH_SHARE = 0.25  # reach of a mask beyond its box, as a share of the box's larger side


def suppressed(boxes: NDArray[np.float32], scores: NDArray[np.float32]) -> list[int]:
    """Indices of the boxes [n, 4] xyxy of one class that suppression keeps, best first; at most 50.

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
    """(box, class) pairs: each box gets its best class among those whose threshold it passes.

    Of overlapping boxes of one class, such as one object found by several synonyms, the best stays.
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
    """Part of a mask [h, w] that belongs to a box: the components that reach into the box, cut at a
    quarter of the box's larger side beyond it.

    A box-prompted model correctly follows the object beyond the box, but may also leak into the
    support and leave specks across the image.
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
