"""Boxes and scores of one frame: suppression, and one class for each box."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

NMS_IOU = 0.45
MAX_PER_CLASS = 50


def suppressed(
    boxes: NDArray[np.float32], scores: NDArray[np.float32], threshold: float
) -> list[int]:
    """Indices of the boxes [n, 4] xyxy of one class that stay, best first; at most 50."""
    sizes = np.concatenate([boxes[:, :2], boxes[:, 2:] - boxes[:, :2]], 1)
    kept = cv2.dnn.NMSBoxes(sizes.tolist(), scores.tolist(), threshold, NMS_IOU)
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
        kept = suppressed(boxes[some], best_scores[some], 0.0)
        out += [(int(some[i]), c) for i in kept]
    return out
