"""Gaze points: where to stand to look at a candidate (paper section 3.2, local search)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from helios_core.geometry import Matrix, camera_on_base
from helios_core.types import ObjectInstance, RobotDescription
from numpy.typing import NDArray

from helios_planner.ground import kernels
from helios_planner.ground.grid import GroundMap, Pose2, facing
from helios_planner.ground.motion import Reach


@dataclass(frozen=True)
class GazeRules:
    """Lengths in metres. Contours at `distances_m` around the candidate's ground projection;
    gaze points `spacing_m` apart; none where something above `block_height_m`, or above the line
    of sight, stands between; things within `near_m` of the candidate are part of it."""

    distances_m: tuple[float, ...]
    spacing_m: float
    block_height_m: float = 1.25
    near_m: float = 0.15


@dataclass(frozen=True)
class GazePoint:
    """A pose of the base and a tilt of the head; positive tilt looks down."""

    pose: Pose2
    tilt_rad: float
    arrival: float  # cells at full speed from where the robot stands

    def T_world_cam(self, robot: RobotDescription) -> Matrix:
        """Camera pose [4, 4] there."""
        return camera_on_base(
            self.pose.T_world_base, robot.camera_height_m, self.tilt_rad, robot.camera_forward_m
        )


def outline_of(candidate: ObjectInstance) -> NDArray[np.float64]:
    """Ground projection [n, 2] of a candidate: its hull, or its box where the hull is too small."""
    if len(candidate.outline_m) >= 3:
        return np.asarray(candidate.outline_m, float)
    half = np.maximum(candidate.size_m[:2] / 2, 0.03)
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], float)
    return candidate.center_m[:2] + corners * half


def outline_mask(ground: GroundMap, outline_m: NDArray[np.float64]) -> NDArray[np.uint8]:
    """1 for the cells [h, w] under an outline [n, 2]."""
    mask = np.zeros(ground.occupancy.shape, np.uint8)
    corners = np.rint(ground.exact_cells_of(outline_m)[:, ::-1] - 0.5).astype(np.int32)
    cv2.fillPoly(mask, [corners.reshape(-1, 1, 2)], 1)
    return mask


def tilt_towards(distance_m: float, height_m: float, robot: RobotDescription) -> float:
    """Tilt that centres a point ahead of the base at that distance and height, within the head's
    range."""
    ahead_m = max(distance_m - robot.camera_forward_m, 0.05)
    tilt = math.atan2(robot.camera_height_m - height_m, ahead_m)
    low, high = robot.tilt_range_rad
    return float(np.clip(tilt, low, high))


def eye_of(pose: Pose2, robot: RobotDescription) -> tuple[float, float]:
    """Where the camera is over the ground (x, y) when the base stands at a pose."""
    return (
        pose.x_m + robot.camera_forward_m * math.cos(pose.yaw_rad),
        pose.y_m + robot.camera_forward_m * math.sin(pose.yaw_rad),
    )


def in_sight(
    ground: GroundMap,
    eye_xy: tuple[float, float],
    eye_z_m: float,
    target_m: Sequence[float] | NDArray[np.float64],
    near_m: float,
    block_height_m: float,
) -> bool:
    """Whether nothing known stands between an eye and a point (world x, y, z)."""
    (r0, c0), (r1, c1) = ground.exact_cells_of(np.array([eye_xy, target_m[:2]]))
    return not kernels.hidden_along(
        ground.top_m, r0, c0, eye_z_m, r1, c1, float(target_m[2]),
        near_m / ground.cell_m, block_height_m,
    )  # fmt: skip


def gaze_points(
    candidate: ObjectInstance, reached: Reach, robot: RobotDescription, rules: GazeRules
) -> list[GazePoint]:
    """Gaze points around a candidate, nearest by way first. Free and reachable places only, facing
    the middle of its ground projection and its highest point."""
    ground = reached.ground
    outline = outline_of(candidate)
    middle = (outline.min(axis=0) + outline.max(axis=0)) / 2
    top_m = float(max(candidate.top_m, candidate.center_m[2]))
    extent_m = float(np.hypot(*(outline - middle).T).max())
    farthest = max(rules.distances_m) + extent_m + 0.2
    near = ground.window_at(middle, farthest)
    part = ground.part(near)
    if part.occupancy.size == 0:
        return []
    mask = outline_mask(part, outline)
    if not mask.any():
        return []
    away_m = cv2.distanceTransform((mask == 0).astype(np.uint8), cv2.DIST_L2, 5) * ground.cell_m
    arrival = reached.arrival[near]
    chosen: list[GazePoint] = []
    for wanted_m in rules.distances_m:
        on_contour = (np.abs(away_m - wanted_m) <= 0.75 * ground.cell_m) & np.isfinite(arrival)
        cells = np.argwhere(on_contour)
        if not len(cells):
            continue
        cells = cells[np.argsort(arrival[cells[:, 0], cells[:, 1]], kind="stable")]
        for (row, column), (x_m, y_m) in zip(cells, part.centres_of(cells), strict=True):
            if any(g.pose.distance_m((x_m, y_m)) < rules.spacing_m for g in chosen):
                continue
            target = (*middle, top_m)
            pose = facing(float(x_m), float(y_m), middle)
            seen = in_sight(ground, eye_of(pose, robot), robot.camera_height_m, target,
                            extent_m + rules.near_m, rules.block_height_m)  # fmt: skip
            if not seen or not reached.fits(pose):
                continue
            distance_m = pose.distance_m(middle)
            aim = (tilt_towards(distance_m, top_m, robot)
                   + tilt_towards(distance_m, float(candidate.center_m[2]), robot)) / 2  # fmt: skip
            chosen.append(GazePoint(pose, aim, float(arrival[row, column])))
    return sorted(chosen, key=lambda g: g.arrival)
