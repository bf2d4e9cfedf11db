"""Detected classes of a view and their places, to search views without an image embedding."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from helios_core.types import Detection, Frame, Observation


@dataclass(frozen=True)
class DetectedClass:
    """Class detected in a view."""

    class_name: str
    score: float  # the detector's, 0 to 1
    x_m: float  # place in the world: median over the detection's pixels
    y_m: float


def sighted(
    observation: Observation, min_depth_m: float, max_depth_m: float
) -> list[DetectedClass]:
    """Best detection of each class among those with measured depth, highest score first."""
    out: dict[str, DetectedClass] = {}
    for detection in sorted(observation.detections, key=lambda d: -d.score):
        if detection.class_name in out or not math.isfinite(detection.score):
            continue
        place = _place(observation.frame, detection, min_depth_m, max_depth_m)
        if place is not None:
            out[detection.class_name] = DetectedClass(detection.class_name, detection.score, *place)
    return list(out.values())


def _place(
    frame: Frame, detection: Detection, min_depth_m: float, max_depth_m: float
) -> tuple[float, float] | None:
    """Median world x, y (m) of a detection's pixels; None if none has depth."""
    x0, y0, x1, y1 = detection.box_xyxy
    depth_m = frame.depth_m[y0:y1, x0:x1]
    with np.errstate(invalid="ignore"):
        good = detection.mask[y0:y1, x0:x1] & (depth_m > min_depth_m) & (depth_m < max_depth_m)
    v, u = np.nonzero(good)
    if not len(v):
        return None
    z, camera = depth_m[v, u].astype(np.float64), frame.camera
    points_cam = np.stack(
        [(u + x0 - camera.cx) / camera.fx * z, (v + y0 - camera.cy) / camera.fy * z, z]
    )
    x, y = frame.T_world_cam[:2, :3] @ points_cam + frame.T_world_cam[:2, 3:]
    return float(np.median(x)), float(np.median(y))
