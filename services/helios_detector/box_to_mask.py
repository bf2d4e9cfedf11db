"""Segmentation of the object in a detector's box by depth.

A box contains the object, its support and background. Three class-independent rules separate them:

1. The object covers the middle of the box. Its own depth is the most common depth there; a nearer
   mode wins over a slightly higher one.
2. An object is about as deep as its box is wide or high. Pixels whose depth differs more from the
   object's own depth are background or occluders.
3. The support extends beyond the box at one height. A horizontal plane seen beside and below the
   box is not part of the object. Receptacles keep their surface.

The mask is the remaining region that is connected with the middle.
"""

from __future__ import annotations

import cv2
import numpy as np
from helios_core.geometry import Matrix, Pinhole
from numpy.typing import NDArray

Box = tuple[int, int, int, int]
Mask = NDArray[np.bool_]

MIDDLE_SHARE = 0.5  # share of the box's width and height that counts as its middle
DEPTH_BIN_M = 0.02
NEAR_MODE_SHARE = 0.5  # a nearer mode wins from this share of the highest mode's count
THICKNESS_SHARE = 0.75  # of the box's larger side, in metres at the object's depth
MIN_THICKNESS_M = 0.05
PLANE_MARGIN_M = 0.01  # height above the plane that still counts as plane; depth noise is added
PLANE_SHARE = 0.3  # share of the pixels around the box that must lie on the support plane
RING_SHARE = 0.4  # width of the ring around the box, as a share of the box's larger side
MIN_RING_PX = 6
MIN_ABOVE_SHARE = 0.1  # of the pixels near the object's depth; below that the object is flat
SURFACE_JUMP_M = 0.05  # neighbouring pixels on one receptacle differ by less in depth
FLOOR_M = 0.06  # points below this height are floor, never part of a receptacle


def depth_noise_m(depth_m: float) -> float:
    """Standard deviation (m) of a structured-light or stereo camera's depth: quadratic in depth.

    1.8 to 2.9 times (3 m to 1 m) the object map's `depth_noise_m`, which is a Kinect's: a mask
    keeps an object whole with other cameras, too.
    """
    return 0.003 + 0.0025 * depth_m**2


def clip_box(box_xyxy: tuple[float, float, float, float], height: int, width: int) -> Box | None:
    """The box in whole pixels, half open, clipped to the image; None if it lies outside the image
    or has a NaN corner."""
    if np.isnan(box_xyxy).any():
        return None
    x0, y0, x1, y1 = (float(v) for v in np.clip(box_xyxy, -1e6, 1e6))
    box = (
        max(0, round(x0)),
        max(0, round(y0)),
        min(width, round(x1)),
        min(height, round(y1)),
    )
    return box if box[2] > box[0] and box[3] > box[1] else None


def box_to_mask(
    depth_m: NDArray[np.float32],  # [h, w], 0 is invalid
    box_xyxy: Box,
    camera: Pinhole,
    T_world_cam: Matrix,
    *,
    keep_surface: bool = False,
) -> Mask:
    """Mask [h, w] of the object within the box; empty if the box has no valid depth.

    `keep_surface` is for receptacles: it keeps the horizontal surface and removes only the floor.
    """
    mask = np.zeros(depth_m.shape, bool)
    window = box_xyxy if keep_surface else _grown(box_xyxy, depth_m.shape)
    wx0, wy0, wx1, wy1 = window
    x0, y0, x1, y1 = (box_xyxy[0] - wx0, box_xyxy[1] - wy0, box_xyxy[2] - wx0, box_xyxy[3] - wy0)
    depth = depth_m[wy0:wy1, wx0:wx1]
    own_depth = _own_depth(depth[y0:y1, x0:x1])
    if own_depth is None:
        return mask

    height_m = _heights(depth, (wx0, wy0), camera, T_world_cam)
    inside = np.zeros(depth.shape, bool)
    inside[y0:y1, x0:x1] = True
    valid = depth > 0

    box = (x0, y0, x1, y1)
    if keep_surface:
        thing = _joined(valid & (height_m > FLOOR_M), depth, box, SURFACE_JUMP_M)
    else:
        size_m = max((x1 - x0) / camera.fx, (y1 - y0) / camera.fy) * own_depth
        thickness_m = max(MIN_THICKNESS_M, THICKNESS_SHARE * size_m)
        near = valid & (np.abs(depth - own_depth) < thickness_m)
        around = near & ~inside
        below = around.copy()
        below[:y0] = False  # pixels above the box cannot show the support
        noise_m = depth_noise_m(own_depth)
        thing = near & inside
        support_m = _support_height(height_m[below], int(np.count_nonzero(around)))
        if support_m is not None:
            above = thing & (height_m > support_m + PLANE_MARGIN_M + noise_m)
            if np.count_nonzero(above) >= MIN_ABOVE_SHARE * np.count_nonzero(thing):
                thing = above  # otherwise the object is too flat to separate from its support
        thing = _joined(thing, depth, box, jump_m=0.02 + 3 * noise_m)
    mask[wy0:wy1, wx0:wx1] = thing
    return mask


def _grown(box: Box, shape: tuple[int, ...]) -> Box:
    x0, y0, x1, y1 = box
    ring = max(MIN_RING_PX, round(RING_SHARE * max(x1 - x0, y1 - y0)))
    return max(0, x0 - ring), max(0, y0 - ring), min(shape[1], x1 + ring), min(shape[0], y1 + ring)


def _heights(
    depth: NDArray[np.float32], corner_px: tuple[int, int], camera: Pinhole, T_world_cam: Matrix
) -> NDArray[np.float32]:
    """World z (m) of each pixel of a window with its corner at `corner_px`."""
    r, (h, w) = T_world_cam[2], depth.shape
    across = r[0] / camera.fx * (np.arange(w) + corner_px[0] - camera.cx)
    down = r[1] / camera.fy * (np.arange(h) + corner_px[1] - camera.cy)
    return depth * (across + (down + r[2])[:, None]).astype(np.float32) + np.float32(r[3])


def _own_depth(depth: NDArray[np.float32]) -> float | None:
    """Most common depth (m) in the middle of a box, nearer modes preferred; None without depth."""
    h, w = depth.shape
    margin_y, margin_x = (round(n * (1 - MIDDLE_SHARE) / 2) for n in (h, w))
    middle = depth[margin_y : h - margin_y, margin_x : w - margin_x]
    values = middle[middle > 0]
    if values.size == 0:
        values = depth[depth > 0]
    if values.size == 0:
        return None
    low = float(values.min())
    counts = np.bincount(((values - low) / DEPTH_BIN_M).astype(int))
    smooth = np.convolve(counts, [1, 2, 3, 2, 1], mode="same")
    first = int(np.argmax(smooth >= NEAR_MODE_SHARE * smooth.max()))
    while first + 1 < smooth.size and smooth[first + 1] > smooth[first]:
        first += 1
    bin_low = low + (first - 1) * DEPTH_BIN_M
    chosen = values[(values >= bin_low) & (values < bin_low + 3 * DEPTH_BIN_M)]
    if chosen.size == 0:  # the smoothed peak lies between two occupied bins
        chosen = values[np.abs(values - bin_low - 1.5 * DEPTH_BIN_M) <= 2.5 * DEPTH_BIN_M]
    return float(np.median(chosen))


def _support_height(heights_m: NDArray[np.float32], around: int) -> float | None:
    """Height (m) of the horizontal plane that holds at least `PLANE_SHARE` of the `around` pixels.

    None without such a plane.
    """
    if heights_m.size < 12:
        return None
    low = float(heights_m.min())
    counts = np.bincount(((heights_m - low) / 0.01).astype(int))
    smooth = np.convolve(counts, np.ones(3), mode="same")
    peak = int(np.argmax(smooth))
    if smooth[peak] < PLANE_SHARE * around:
        return None
    bin_low = low + (peak - 1) * 0.01
    on_plane = heights_m[(heights_m >= bin_low) & (heights_m < bin_low + 0.03)]
    return float(np.median(on_plane))


def _joined(thing: Mask, depth: NDArray[np.float32], box: Box, jump_m: float) -> Mask:
    """The component of mask `thing`, without depth jumps, that covers most of the box's middle."""
    cut = thing.astype(np.uint8)
    dx = np.abs(np.diff(depth, axis=1)) > jump_m
    dy = np.abs(np.diff(depth, axis=0)) > jump_m
    # Cutting out the pixel after a jump breaks 4-connectivity; the dilation below restores it.
    cut[:, 1:][dx] = 0
    cut[1:, :][dy] = 0
    count, labels = cv2.connectedComponents(cut, connectivity=4)
    if count < 2:
        return thing
    x0, y0, x1, y1 = box
    margin_x, margin_y = (round(n * (1 - MIDDLE_SHARE) / 2) for n in (x1 - x0, y1 - y0))
    middle = labels[y0 + margin_y : y1 - margin_y, x0 + margin_x : x1 - margin_x]
    votes = np.bincount(middle.ravel(), minlength=count)
    votes[0] = 0
    if votes.max() == 0:
        votes = np.bincount(labels.ravel(), minlength=count)
        votes[0] = 0
    best = int(votes.argmax())
    grown = cv2.dilate((labels == best).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    return thing & grown
