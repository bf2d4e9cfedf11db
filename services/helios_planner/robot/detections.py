"""Sightings: the newest detections as points in the world, masks lifted with the frame's depth."""

from __future__ import annotations

import logging
import math
import threading
from dataclasses import dataclass

import cv2
import numpy as np
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.codec import observation_from_proto
from helios_core.errors import HeliosError
from helios_core.geometry import Matrix, Pinhole
from helios_core.image_messages import ObservationMessage
from helios_core.keyframe_acks import KeyframeAcks
from helios_core.topics import OBSERVATION
from helios_core.types import Detection, FrameId, Observation
from numpy.typing import NDArray

MIN_POINTS = 8  # least points of a mask with usable depth
TRIMMED = 0.02  # share of the points beyond each side of the box: edges may show the background
log = logging.getLogger(__name__)
DETECTIONS = "detections"  # part of a keyframe that the planner itself acknowledges


@dataclass(frozen=True)
class Sighting:
    """One detection in the world: the part of an object seen in one frame. Metres, world."""

    class_name: str
    confidence: float  # of the detector, 0 to 1
    center_m: NDArray[np.float64]  # [3] middle of the box of its points
    size_m: NDArray[np.float64]  # [3]
    outline_m: NDArray[np.float64]  # [n, 2] hull of its points on the ground
    nearest_m: float  # from the camera to the nearest of its points
    at_side: bool  # entirely in the left or right third of the image, and at its edge

    @property
    def top_m(self) -> float:
        """Height of its highest point."""
        return float(self.center_m[2] + self.size_m[2] / 2)


def sightings_of(observation: Observation, max_depth_m: float = math.inf) -> list[Sighting]:
    """Sightings of all detections that have depth, in the detector's order. max_depth_m: depth
    beyond it is not used; a saturated sensor reports its highest value, for example 65.535 m."""
    frame = observation.frame
    found = []
    for detection in observation.detections:
        points = mask_points_m(
            detection, frame.depth_m, frame.camera, frame.T_world_cam, max_depth_m
        )
        if len(points) >= MIN_POINTS:
            left, _, right, _ = detection.box_xyxy
            found.append(
                sighting_of(
                    detection.class_name,
                    detection.score,
                    points,
                    frame.T_world_cam[:3, 3],
                    lies_at_side(left, right, frame.camera.width),
                )
            )
    return found


def mask_points_m(
    detection: Detection,
    depth_m: NDArray[np.float32],
    camera: Pinhole,
    T_world_cam: Matrix,
    max_depth_m: float = math.inf,
) -> NDArray[np.float64]:
    """World points [n, 3] under a mask. Its rim, where depth mixes with the background, is left out
    if enough points remain."""
    x0, y0, x1, y1 = detection.box_xyxy
    mask = detection.mask[y0:y1, x0:x1]
    inner = cv2.erode(
        mask.astype(np.uint8),
        np.ones((3, 3), np.uint8),
        borderType=cv2.BORDER_CONSTANT,
        borderValue=(0.0,),
    )
    within = depth_m[y0:y1, x0:x1]
    usable = (within > 0) & (within <= max_depth_m)
    for part in (inner != 0, mask):
        v, u = np.nonzero(part & usable)
        if len(v) >= MIN_POINTS:
            break
    else:
        return np.empty((0, 3))
    z = depth_m[y0 + v, x0 + u].astype(np.float64)
    x = (u + x0 - camera.cx) / camera.fx * z
    y = (v + y0 - camera.cy) / camera.fy * z
    return np.stack([x, y, z], -1) @ T_world_cam[:3, :3].T + T_world_cam[:3, 3]


def lies_at_side(left_px: int, right_px: int, width_px: int) -> bool:
    """True if columns [left, right) lie within the left or right third of an image and come within
    5 % of its edge: VLFM doubts such a detection, since little of the object is visible."""
    third, margin = width_px // 3, int(0.05 * width_px)
    if right_px <= third:
        return left_px <= margin
    return left_px >= 2 * third and right_px >= int(0.95 * width_px)


def sighting_of(
    class_name: str,
    confidence: float,
    points_m: NDArray[np.float64],
    eye_m: NDArray[np.float64],
    at_side: bool,
) -> Sighting:
    """Sighting of points [n, 3], n >= 1, from a camera position [3]: their box without the
    outermost few, and their hull."""
    low, high = np.quantile(points_m, [TRIMMED, 1 - TRIMMED], axis=0)
    within = ((points_m >= low) & (points_m <= high)).all(axis=1)
    kept = points_m[within] if within.sum() >= 3 else points_m
    away_m = np.linalg.norm(kept - eye_m, axis=1)
    hull = cv2.convexHull(kept[:, :2].astype(np.float32))
    return Sighting(
        class_name=class_name,
        confidence=confidence,
        center_m=(low + high) / 2,
        size_m=high - low,
        outline_m=np.asarray(hull, np.float64).reshape(-1, 2),
        nearest_m=float(away_m.min()),
        at_side=at_side,
    )


class MessageBuffer:
    """Collects the sightings of a task, and acknowledges each keyframe with an
    observation. Thread-safe."""

    def __init__(self, bus: Bus, acks: KeyframeAcks, context_id: str, max_depth_m: float) -> None:
        """max_depth_m: greatest depth that the robot's sensor measures."""
        self._acks, self._context_id, self._max_depth_m = acks, context_id, max_depth_m
        self._lock = threading.Lock()
        self._sightings: list[Sighting] = []
        self._heard: set[FrameId] = set()
        self._registration = bus.subscribe_in_place(OBSERVATION, self._on_observation)

    def sightings(self) -> list[Sighting]:
        """All sightings of this task, in order of arrival."""
        with self._lock:
            return list(self._sightings)

    def close(self) -> None:
        self._registration.close()

    def _on_observation(self, message: ObservationMessage) -> None:
        ack = pb.Ack(
            service="planner",
            part=DETECTIONS,
            id=message.frame.id,
            context_id=message.context_id,
            accepted=True,
        )
        if message.context_id == self._context_id:
            try:
                observation = observation_from_proto(message, with_others=False)
                found = sightings_of(observation, self._max_depth_m)
            except HeliosError as error:
                log.warning("observation %d refused: %s", message.frame.id.seq, error.message)
                ack.accepted, ack.reason = False, error.message
            else:
                with self._lock:
                    if observation.frame.id not in self._heard:  # it may be sent twice
                        self._heard.add(observation.frame.id)
                        self._sightings += found
        self._acks.add(ack)
