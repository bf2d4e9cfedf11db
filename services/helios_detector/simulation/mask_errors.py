"""Simulated mask errors: eroded, cut off, or leaking onto the support below."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

Box = tuple[int, int, int, int]  # x0, y0, x1, y1, half open
Masked = tuple[Box, NDArray[np.bool_]]  # a box and the mask within it


def trimmed(box_xyxy: Box, crop: NDArray[np.bool_]) -> Masked:
    """The smallest box and mask with the same pixels; the mask must not be empty."""
    rows, columns = np.flatnonzero(crop.any(1)), np.flatnonzero(crop.any(0))
    r0, r1, c0, c1 = rows[0], rows[-1] + 1, columns[0], columns[-1] + 1
    x0, y0 = box_xyxy[:2]
    box = (int(x0 + c0), int(y0 + r0), int(x0 + c1), int(y0 + r1))
    return box, crop[r0:r1, c0:c1]


def eroded(box_xyxy: Box, crop: NDArray[np.bool_], erode_px: int) -> Masked:
    """The mask eroded by `erode_px`; unchanged if no pixel would remain."""
    if erode_px <= 0:
        return box_xyxy, crop
    kernel = np.ones((2 * erode_px + 1, 2 * erode_px + 1), np.uint8)
    smaller = cv2.erode(crop.astype(np.uint8), kernel, borderValue=0) > 0
    return trimmed(box_xyxy, smaller) if smaller.any() else (box_xyxy, crop)


def partial(box_xyxy: Box, crop: NDArray[np.bool_], keep: float, side: int) -> Masked:
    """About a share `keep` of the pixels, from the left, right, top or bottom (`side` 0 to 3)."""
    along = np.cumsum(np.count_nonzero(crop, axis=0 if side < 2 else 1))
    share = keep if side in (0, 2) else 1 - keep
    cut = int(np.searchsorted(along, share * along[-1]))
    kept = np.zeros_like(crop)
    if side == 0:
        kept[:, : cut + 1] = crop[:, : cut + 1]
    elif side == 1:
        kept[:, cut:] = crop[:, cut:]
    elif side == 2:
        kept[: cut + 1] = crop[: cut + 1]
    else:
        kept[cut:] = crop[cut:]
    return trimmed(box_xyxy, kept)


def leaked(
    box_xyxy: Box,
    crop: NDArray[np.bool_],
    by_px: int,
    support: Callable[[Box], NDArray[np.bool_]],
    depth_m: NDArray[np.float32],
    within_m: float,
) -> Masked:
    """The mask extended by up to `by_px` below and half of it to each side, onto pixels of the
    support whose depth is within `within_m` of the object's median.

    support: returns the part of the support's mask [h, w] within a box."""
    x0, y0, x1, y1 = box_xyxy
    h, w = depth_m.shape
    beside = (by_px + 1) // 2
    left, right, below = min(beside, x0), min(beside, w - x1), min(by_px, h - y1)
    grown = np.pad(crop, ((0, below), (left, right))).astype(np.uint8)
    kernel = np.ones((by_px + 1, 2 * beside + 1), np.uint8)
    spread = cv2.dilate(grown, kernel, anchor=(beside, by_px)) > 0
    box = (x0 - left, y0, x1 + right, y1 + below)
    window = np.s_[box[1] : box[3], box[0] : box[2]]
    own_m = depth_m[window][grown > 0]
    own_m = own_m[np.isfinite(own_m) & (own_m > 0)]
    if not len(own_m):
        return box_xyxy, crop
    near = np.abs(depth_m[window] - np.median(own_m)) < within_m
    return trimmed(box, (grown > 0) | (spread & support(box) & near))
