"""Hand poses for looking and for placing an object."""

from __future__ import annotations

import math

import numpy as np
from helios_core.geometry import Matrix

PLACE_PITCHES_RAD = tuple(math.radians(d) for d in (70, 55, 40, 25))  # downwards; steepest first
FINGERTIPS_M = 0.12  # ahead of the hand's frame
HELD_BELOW_M = 0.05  # assumed extent of a held object below the fingertips
TILT_RANGE_RAD = (-0.4, 1.4)
WRIST_BEHIND_HAND_M = 0.196
ARM_M = 0.72  # reach from shoulder to wrist, slightly less than the straight arm


def pitched(yaw_rad: float, down_rad: float) -> Matrix:
    """Rotation [3, 3] of a hand (x forward, z up) with heading `yaw_rad`, pitched down."""
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    heading = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    c, s = math.cos(down_rad), math.sin(down_rad)
    return heading @ np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def looking_pose(forward_m: float, above_body_m: float, tilt_rad: float) -> Matrix:
    """T_flat_hand [4, 4]: ahead of and above the body's centre, tilted down."""
    out = np.eye(4)
    out[:3, :3] = pitched(0.0, tilt_rad)
    out[:3, 3] = [forward_m, 0.0, above_body_m]
    return out


def placing_poses(point_m: Matrix, shoulder_m: Matrix, clearance_m: float) -> tuple[Matrix, Matrix]:
    """(above, release): hand poses [4, 4] that place the held object on a point.

    All are in one frame with z up. The hand approaches from the shoulder's side with the steepest
    pitch within the arm's reach, or the flattest if none is.
    """
    yaw_rad = math.atan2(point_m[1] - shoulder_m[1], point_m[0] - shoulder_m[0])
    tips = np.add(point_m, (0.0, 0.0, HELD_BELOW_M))
    above, release = np.eye(4), np.eye(4)
    for down_rad in PLACE_PITCHES_RAD:
        release[:3, :3] = pitched(yaw_rad, down_rad)
        release[:3, 3] = tips - FINGERTIPS_M * release[:3, 0]
        above = release.copy()
        above[2, 3] += clearance_m
        wrists = [T[:3, 3] - WRIST_BEHIND_HAND_M * T[:3, 0] for T in (above, release)]
        if all(np.linalg.norm(wrist - shoulder_m) <= ARM_M for wrist in wrists):
            break
    return above, release
