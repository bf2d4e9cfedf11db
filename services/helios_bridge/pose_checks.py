"""Plausibility checks of poses, for every driver and every pushed frame.

They refuse a matrix that is not a rotation, a base that lies on its side or upside down, or a floor
500 m below: the maps would accept such a frame as part of a home. The bounds are wide, so that a
slope, a ramp, a drifting localisation or a camera on a mast passes. Cameras may be mounted in any
orientation.
"""

from __future__ import annotations

import math

import numpy as np
from helios_core.errors import InvalidInput
from helios_core.geometry import Matrix, is_rigid

LEANING_RAD = math.radians(45)  # largest tilt from upright; beyond it a base has fallen over
OFF_FLOOR_M = 2.0  # of the base's origin, up or down; the floor is at 0
CAMERA_M = (-2.0, 10.0)  # range of a camera's height
AWAY_M = 5.0  # horizontal, base to camera; the 2D map has the same limit


def check_poses(T_world_cam: Matrix, T_world_base: Matrix, whose: str) -> None:
    """Check the poses of a camera and its base. whose: "the driver's".

    Raises InvalidInput that names the value and the requirement.
    """
    for name, T in (("T_world_cam", T_world_cam), ("T_world_base", T_world_base)):
        if not isinstance(T, np.ndarray):
            raise InvalidInput(f"{whose} {name} is a {type(T).__name__}; give an array [4, 4]")
        if not is_rigid(T):
            raise InvalidInput(
                f"{whose} {name} is no rigid transform [4, 4]: {T.tolist()}; give a rotation and a "
                "position in metres"
            )
    leaning_rad = math.acos(min(max(float(T_world_base[2, 2]), -1.0), 1.0))
    if leaning_rad > LEANING_RAD:
        raise InvalidInput(
            f"{whose} T_world_base leans by {math.degrees(leaning_rad):.0f} degrees; a base stands "
            f"upright, z up, to within {math.degrees(LEANING_RAD):.0f} degrees"
        )
    base_m, cam_m = T_world_base[:3, 3], T_world_cam[:3, 3]
    if abs(base_m[2]) > OFF_FLOOR_M:
        raise InvalidInput(
            f"{whose} T_world_base is at a height of {base_m[2]:.1f} m; the base's origin is on "
            f"the floor, and the floor at 0, to within {OFF_FLOOR_M:g} m"
        )
    if not CAMERA_M[0] <= cam_m[2] <= CAMERA_M[1]:
        raise InvalidInput(
            f"{whose} T_world_cam is at a height of {cam_m[2]:.1f} m; the floor is at 0, and a "
            f"camera between {CAMERA_M[0]:g} and {CAMERA_M[1]:g} m"
        )
    away_m = math.hypot(cam_m[0] - base_m[0], cam_m[1] - base_m[1])
    if away_m > AWAY_M:
        raise InvalidInput(
            f"{whose} camera is {away_m:.1f} m from its base; give both in the same world, within "
            f"{AWAY_M:g} m of each other"
        )
