"""Agreement of a detector with itself, without ground truth.

A detection of one image marks a place in the world. Another image that sees the place, by its
depth, either repeats the name there, or has only another name, or has nothing. These shares by the
angle between the two lines of sight can be measured on real frames, where no truth is known.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from helios_core.geometry import Matrix, Pinhole, project
from helios_core.types import Detection, Frame
from numpy.typing import NDArray

from helios_eval.studies.detector_errors.sightings import COUNTED

ANGLES_DEG = (0, 3, 10, 20, 40, 70, 110, 180)  # borders of the bands
SAME_DISTANCE = 1.3  # largest ratio of the two distances
VISIBLE_M = 0.15  # the depth there agrees within this
STRIDE_PX = 4
RIM_PX = 24  # a place nearer to the image's border does not count as seen


@dataclass(frozen=True)
class SeenPlace:
    """One detection, and the place (world, metres) that it marks."""

    name: str
    score: float
    box_xyxy: tuple[float, float, float, float]
    point_m: NDArray[np.float64]  # [3]


@dataclass(frozen=True)
class LoggedImage:
    """What is kept of one image."""

    camera: Pinhole
    T_world_cam: Matrix
    depth_m: NDArray[np.float32]  # every `STRIDE_PX`-th pixel
    seen: tuple[SeenPlace, ...]


@dataclass(frozen=True)
class RepeatRates:
    """Counts by band of angle: pairs, same name again, another name only."""

    pairs: NDArray[np.int64]
    same: NDArray[np.int64]
    other: NDArray[np.int64]

    def __add__(self, more: RepeatRates) -> RepeatRates:
        return RepeatRates(self.pairs + more.pairs, self.same + more.same, self.other + more.other)


def nothing() -> RepeatRates:
    """Counts of no images."""
    empty = np.zeros(len(ANGLES_DEG) - 1, np.int64)
    return RepeatRates(empty, empty.copy(), empty.copy())


def logged(frame: Frame, found: Sequence[Detection]) -> LoggedImage:
    """Image with the detections from `COUNTED` on."""
    depth_m = frame.depth_m[::STRIDE_PX, ::STRIDE_PX]
    seen = []
    for d in found:
        point = _place(frame, depth_m, d.box_xyxy) if d.score >= COUNTED else None
        if point is not None:
            seen.append(SeenPlace(d.class_name, d.score, d.box_xyxy, point))
    return LoggedImage(frame.camera, frame.T_world_cam, depth_m, tuple(seen))


def repeat_rates(images: Sequence[LoggedImage]) -> RepeatRates:
    """Counts over all ordered pairs of images of one static scene."""
    out = nothing()
    if len(images) < 2:
        return out
    eyes_m = np.array([i.T_world_cam[:3, 3] for i in images])
    borders = np.radians(ANGLES_DEG)
    for n, image in enumerate(images):
        for place in image.seen:
            away = eyes_m - place.point_m
            distance_m = np.linalg.norm(away, axis=1)
            cosine = away @ away[n] / np.maximum(distance_m * distance_m[n], 1e-9)
            angle_rad = np.arccos(np.clip(cosine, -1, 1))
            ratio = distance_m / max(distance_m[n], 1e-9)
            near = (ratio < SAME_DISTANCE) & (ratio > 1 / SAME_DISTANCE)
            near[n] = False
            for k in np.flatnonzero(near).tolist():
                uv = _visible_at(images[k], place.point_m)
                if uv is None:
                    continue
                band = min(
                    int(np.searchsorted(borders, angle_rad[k], "right")) - 1, len(out.pairs) - 1
                )
                names = {p.name for p in images[k].seen if _inside(p.box_xyxy, uv)}
                out.pairs[band] += 1
                out.same[band] += place.name in names
                out.other[band] += bool(names) and place.name not in names
    return out


def _place(
    frame: Frame, depth_m: NDArray[np.float32], box: tuple[float, float, float, float]
) -> NDArray[np.float64] | None:
    """World point [3] at the middle of a box, at the median depth around it; None without depth."""
    u, v = (box[0] + box[2]) / 2, (box[1] + box[3]) / 2
    half_u, half_v = (box[2] - box[0]) / 6, (box[3] - box[1]) / 6
    low_u, low_v = int((u - half_u) / STRIDE_PX), int((v - half_v) / STRIDE_PX)
    high_u, high_v = int((u + half_u) / STRIDE_PX) + 1, int((v + half_v) / STRIDE_PX) + 1
    part = depth_m[max(low_v, 0) : high_v, max(low_u, 0) : high_u]
    part = part[part > 0]
    if not len(part):
        return None
    z, c = float(np.median(part)), frame.camera
    point = np.array([(u - c.cx) / c.fx * z, (v - c.cy) / c.fy * z, z])
    return frame.T_world_cam[:3, :3] @ point + frame.T_world_cam[:3, 3]


def _visible_at(image: LoggedImage, point_m: NDArray[np.float64]) -> tuple[float, float] | None:
    """Pixel at which an image sees the world point; None if it does not see it."""
    uv, z = project(point_m[None], image.camera, image.T_world_cam)
    u, v, z_m = float(uv[0, 0]), float(uv[0, 1]), float(z[0])
    c = image.camera
    if z_m <= 0 or not (RIM_PX <= u < c.width - RIM_PX and RIM_PX <= v < c.height - RIM_PX):
        return None
    measured_m = float(image.depth_m[int(v / STRIDE_PX), int(u / STRIDE_PX)])
    if measured_m <= 0 or math.fabs(measured_m - z_m) > VISIBLE_M:
        return None
    return u, v


def _inside(box: tuple[float, float, float, float], uv: tuple[float, float]) -> bool:
    return box[0] <= uv[0] <= box[2] and box[1] <= uv[1] <= box[3]
