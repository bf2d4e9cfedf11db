"""Hindsight: evidence of earlier views for Gaussians that are created later.

Gaussians are created where something is detected, so their evidence begins with the view that
supports them. Earlier views that showed the same place and detected nothing there are lost. A
detector that errs in one view in thirty then counts as much as one that is right each time. With
`evidence = "hindsight"` the map keeps its past views at low resolution. Each new Gaussian receives
the votes of the past views that had it in view, by the same rule (`viewing_sectors`), as if it had
existed from the start. So a belief does not depend on the order of the views.

A past view shows a Gaussian if its depth agrees. It gives no evidence on classes it did not search
for. After a pick, past views give no evidence on objects, because an object may have moved there.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

from helios_objectmap.camera import View, offset
from helios_objectmap.fusion.label_image import LabelImage

MOST_PAST_VIEWS = 1024  # 58 kB each
WIDTH_PX = 160  # largest width of a past view; a mug at 3 m still has nine pixels
AGREES_M, AGREES_SHARE = 0.08, 0.05  # largest depth difference, metres or share of the depth
NEAREST_M = 0.1  # in front of the camera
_MM = 1000


@dataclass(frozen=True)
class PastView:
    """Depth and labels of a past view."""

    view: View
    depth_mm: NDArray[np.uint16]  # [h, w], 0 = unknown
    labels: NDArray[np.uint8]  # [h, w], 0 = other, 1 + i = names[i]
    names: tuple[str, ...]  # classes that it searched for; "" for one that no longer counts
    weights: NDArray[np.float32]  # [names] weight in [0, 1] of the view for each class
    T_cam_world: NDArray[np.float64]  # [4, 4], of `view`


@dataclass(frozen=True)
class VisiblePoints:
    """Points that a past view shows, with their labels."""

    past: PastView
    points: NDArray[np.int64]  # [k] indices of the points
    labels: NDArray[np.uint8]  # [k] label of the view at each point


class PastViews:
    """The latest `most` views, 58 kB each."""

    def __init__(self, most: int = MOST_PAST_VIEWS) -> None:
        self._views: deque[PastView] = deque(maxlen=most)
        # Of each view: pose in the world, and angles from the optical axis to the widest edges.
        self._T_world_cam, self._half_angles = np.empty((0, 4, 4)), np.empty((0, 2))

    def __len__(self) -> int:
        return len(self._views)

    def note(self, reading: LabelImage, names: Sequence[str], weights: NDArray[np.float32]) -> None:
        """Store the labels of a view for the classes it searched for, unless all its weights are 0.

        weights: [names] share in [0, 1] that the view has beside those before it.
        """
        if not weights.any():
            return
        stride = -(-reading.view.width // WIDTH_PX)
        view = reading.view.strided(stride)
        grid = (slice(offset(stride), None, stride), slice(offset(stride), None, stride))
        depth_mm = np.rint(reading.depth_m[grid] * _MM).clip(0, np.iinfo(np.uint16).max)
        self._keep_pose(view)
        self._views.append(
            PastView(
                view,
                depth_mm.astype(np.uint16),
                reading.labels[grid].astype(np.uint8),
                tuple(names),
                weights.astype(np.float32),
                view.T_cam_world,
            )
        )

    def _keep_pose(self, view: View) -> None:
        """Add the pose and angles of a view that is about to be stored."""
        n, most = len(self._views), self._views.maxlen
        if n == most:  # the first view drops out
            n -= 1
            self._T_world_cam[:n], self._half_angles[:n] = (
                self._T_world_cam[1 : n + 1].copy(),
                self._half_angles[1 : n + 1].copy(),
            )
        elif n == len(self._T_world_cam):
            more = max(n, 16)
            self._T_world_cam = np.concatenate([self._T_world_cam, np.empty((more, 4, 4))])
            self._half_angles = np.concatenate([self._half_angles, np.empty((more, 2))])
        self._T_world_cam[n], self._half_angles[n] = view.T_world_cam, _half_angles(view)

    def forget(self, is_gone: Callable[[str], bool]) -> None:
        """Drop the evidence of past views on the classes for which `is_gone` is true; it is not
        asked for classes that were dropped before."""
        for k, past in enumerate(self._views):
            names = tuple("" if name and is_gone(name) else name for name in past.names)
            self._views[k] = replace(past, names=names)

    def of(self, points: NDArray[np.float32]) -> Iterator[VisiblePoints]:
        """Past views that show some of the points [n, 3], oldest first."""
        if not len(points) or not self._views:
            return
        low, high = points.min(axis=0), points.max(axis=0)
        middle, radius_m = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
        which, labels = np.empty(len(points), np.int64), np.empty(len(points), np.uint8)
        for k in self._near(middle, radius_m):
            past = self._views[k]
            v = past.view
            n = shown_kernel(
                points, past.T_cam_world, v.fx, v.fy, v.cx, v.cy, past.depth_mm, past.labels,
                NEAREST_M, AGREES_M, AGREES_SHARE, which, labels,
            )  # fmt: skip
            if n:
                yield VisiblePoints(past, which[:n].copy(), labels[:n].copy())

    def _near(self, middle: NDArray[np.floating], radius_m: float) -> NDArray[np.intp]:
        """Indices of the views that a ball may reach into."""
        T_world_cam = self._T_world_cam[: len(self._views)]
        in_cam = np.einsum("kji,kj->ki", T_world_cam[:, :3, :3], middle - T_world_cam[:, :3, 3])
        x, y, z = np.abs(in_cam[:, 0]), np.abs(in_cam[:, 1]), in_cam[:, 2]
        wide, high = self._half_angles[: len(self._views)].T
        # Distance of the ball's centre from the two nearest side planes of the view.
        outside = np.maximum(
            x * np.cos(wide) - z * np.sin(wide), y * np.cos(high) - z * np.sin(high)
        )
        return np.flatnonzero((outside < radius_m) & (z > -radius_m))


def _half_angles(view: View) -> tuple[float, float]:
    """Widest angles from the optical axis to a pixel's far edge, horizontal and vertical."""
    wide = max(view.cx + 0.5, view.width - 0.5 - view.cx) / view.fx
    high = max(view.cy + 0.5, view.height - 0.5 - view.cy) / view.fy
    return float(np.arctan(wide)), float(np.arctan(high))


@njit(cache=True, nogil=True, error_model="numpy")
def shown_kernel(
    points,
    T_cam_world,
    fx,
    fy,
    cx,
    cy,
    depth_mm,
    labels,
    nearest_m,
    agrees_m,
    agrees_share,
    which,
    label_of,
):
    """Fill which [n] with the points [n, 3] that the view shows, and label_of [n] with the labels.

    A point counts if its depth agrees with that of its pixel. Returns the number of points.
    """
    n = 0
    for k in range(points.shape[0]):
        x, y, z = points[k, 0], points[k, 1], points[k, 2]
        deep = T_cam_world[2, 0] * x + T_cam_world[2, 1] * y + T_cam_world[2, 2] * z
        deep += T_cam_world[2, 3]
        if deep < nearest_m:
            continue
        right = T_cam_world[0, 0] * x + T_cam_world[0, 1] * y + T_cam_world[0, 2] * z
        down = T_cam_world[1, 0] * x + T_cam_world[1, 1] * y + T_cam_world[1, 2] * z
        u = np.floor((right + T_cam_world[0, 3]) / deep * fx + cx + 0.5)
        v = np.floor((down + T_cam_world[1, 3]) / deep * fy + cy + 0.5)
        if u < 0 or v < 0 or u >= depth_mm.shape[1] or v >= depth_mm.shape[0]:
            continue
        measured_m = depth_mm[int(v), int(u)] / 1000.0
        if measured_m > 0 and abs(measured_m - deep) < max(agrees_m, agrees_share * deep):
            which[n], label_of[n] = k, labels[int(v), int(u)]
            n += 1
    return n
