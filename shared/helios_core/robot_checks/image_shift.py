"""Shift between the colour and the depth image of one frame, from their edges.

A nearer object covers a farther one along an edge in both images. The shift that puts the most
depth edges onto colour edges is the registration error.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from cv2.typing import MatLike
from numpy.typing import NDArray

MAX_SHARE = 0.04  # largest shift that is searched, of the image's width
STEP_PER_M = 0.04  # smallest step in inverse depth that is an edge
LEAST_EDGES = 1.875  # pixels of depth edges, per pixel of the image's width
EDGE_SHARE = 1 / 16  # of the image's width; shorter runs of depth edges are noise
GAP_PX = 7  # gaps up to half of it are filled
_UNKNOWN = np.float32(100.0)  # inverse depth of a gap
LEAST_PEAK = 4.0  # the best correlation, in standard deviations above the mean of all shifts
LARGEST_RIVAL = 0.9  # the best correlation elsewhere, as a share of the best


@dataclass(frozen=True)
class ImageShift:
    """The colour image lies this far to the right of the depth image, and below it, pixels."""

    right_px: float
    down_px: float
    peak: float  # height of the correlation's peak, standard deviations


def image_shift(color: NDArray[np.uint8], depth_m: NDArray[np.float32]) -> ImageShift | None:
    """Shift of colour [h, w, 3] against depth [h, w] (m; 0: none); None: too few common edges."""
    edges = _depth_edges(depth_m)
    if np.count_nonzero(edges) < LEAST_EDGES * depth_m.shape[1]:
        return None
    reach = max(4, round(MAX_SHARE * depth_m.shape[1]))
    score = _correlation(_color_edges(color), edges, reach)
    row, column = np.unravel_index(int(score.argmax()), score.shape)
    best = float(score[row, column])
    peak = (best - float(score.mean())) / max(float(score.std()), 1e-9)
    if peak < LEAST_PEAK or not (0 < row < 2 * reach and 0 < column < 2 * reach):
        return None
    elsewhere = score.copy()
    elsewhere[max(0, row - 4) : row + 5, max(0, column - 4) : column + 5] = 0.0
    if float(elsewhere.max()) > LARGEST_RIVAL * best:
        return None
    return ImageShift(
        int(column) - reach + _vertex(score[row, column - 1 : column + 2]),
        int(row) - reach + _vertex(score[row - 1 : row + 2, column]),
        peak,
    )


def _depth_edges(depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
    """1 at pixels on either side of a step between near and far, else 0.

    A gap without depth takes the farthest depth around it: the shadow of an edge lies on its far
    side.
    """
    valid = depth_m > 0
    inverse = np.divide(1.0, depth_m, out=np.full_like(depth_m, _UNKNOWN), where=valid)
    around = cv2.erode(inverse, np.ones((GAP_PX, GAP_PX), np.uint8))
    inverse = cv2.medianBlur(np.where(valid, inverse, around), 3)
    out = np.zeros(depth_m.shape, np.uint8)
    for first, second in (
        (np.s_[:-1], np.s_[1:]),
        (np.s_[:, :-1], np.s_[:, 1:]),
    ):
        a, b = inverse[first], inverse[second]
        step = (np.abs(a - b) > STEP_PER_M) & (np.maximum(a, b) < _UNKNOWN)
        out[first] |= step
        out[second] |= step
    count, labels, stats, _ = cv2.connectedComponentsWithStats(out, connectivity=8)
    long = stats[:, cv2.CC_STAT_AREA] >= EDGE_SHARE * depth_m.shape[1]
    long[0] = False
    return long[labels].astype(np.float32) if count > 1 else out.astype(np.float32)


def _color_edges(color: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Strength of the colour gradient [h, w], 0 to 1, even in dark parts of the image."""
    smooth = cv2.GaussianBlur(color, (0, 0), 0.8)
    gx = _largest(smooth[1:-1, 2:], smooth[1:-1, :-2])
    gy = _largest(smooth[2:, 1:-1], smooth[:-2, 1:-1])
    strength = np.pad(cv2.magnitude(gx, gy).astype(np.float32, copy=False), 1)
    return np.divide(strength, strength + np.float32(10.0), dtype=np.float32)


def _largest(a: MatLike, b: MatLike) -> NDArray[np.float32]:
    """Largest difference of the channels [h, w] between two images [h, w, 3]."""
    red, green, blue = cv2.split(cv2.absdiff(a, b))
    return cv2.max(cv2.max(red, green), blue).astype(np.float32)


def _correlation(
    strength: NDArray[np.float32], edges: NDArray[np.float32], reach: int
) -> NDArray[np.float64]:
    """Mean colour edge under the depth edges [2 reach + 1, 2 reach + 1], by shift (down, right)."""
    inner = edges[reach:-reach, reach:-reach]
    return cv2.matchTemplate(strength, inner, cv2.TM_CCORR).astype(np.float64) / max(inner.sum(), 1)


def _vertex(values: NDArray[np.float64]) -> float:
    """Offset of the vertex of a parabola through three values from the middle one."""
    a, b, c = (float(v) for v in values)
    bend = a - 2 * b + c
    return 0.5 * (a - c) / bend if bend < 0 else 0.0
