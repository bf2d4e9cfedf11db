"""Poses from Spot's frame trees, and the HELIOS frames derived from them.

The HELIOS world is Spot's vision frame with heights relative to the ground below the robot. So the
floor stays at z = 0 after a restart and when the vision frame drifts upwards. This holds on one
storey. The base is the body's position on the ground with the body's heading.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from helios_core.errors import Internal, Unavailable
from helios_core.geometry import Matrix, invert, se2_to_se3

from helios_spot import bosdyn_api

VISION, BODY, FLAT_BODY, HAND = "vision", "body", "flat_body", "hand"
GROUND, WRIST = "gpe", "arm0.link_wr1"
NOMINAL_BODY_HEIGHT_M = 0.52  # standing; replaces a missing ground plane


def pose(snapshot: Any, a: str, b: str) -> Matrix:
    """T_a_b [4, 4] from a FrameTreeSnapshot. Raises Internal when the tree does not connect them,
    Unavailable when it is empty or broken."""
    try:
        found = bosdyn_api.frame_helpers.get_a_tform_b(snapshot, a, b)
    except (bosdyn_api.frame_helpers.Error, ValueError) as error:
        raise Unavailable(
            f"the robot told an empty or broken tree of frames ({type(error).__name__}); try again"
        ) from error
    if found is None:
        have = ", ".join(sorted(snapshot.child_to_parent_edge_map)) or "nothing"
        raise Internal(f"the robot told no pose of {b!r} in {a!r}, only of {have}")
    return np.asarray(found.to_matrix(), np.float64)


def knows(snapshot: Any, frame: str) -> bool:
    """True if the frame is in the tree."""
    return frame in snapshot.child_to_parent_edge_map


def ground_height_m(snapshot: Any) -> float:
    """Height (m) of the ground below the robot in the vision frame."""
    if knows(snapshot, GROUND):
        return float(pose(snapshot, VISION, GROUND)[2, 3])
    return float(pose(snapshot, VISION, BODY)[2, 3]) - NOMINAL_BODY_HEIGHT_M


def world_from_vision(ground_m: float) -> Matrix:
    """T_world_vision [4, 4] for ground at height `ground_m` in the vision frame."""
    out = np.eye(4)
    out[2, 3] = -ground_m
    return out


def base_below_body(T_world_body: Matrix) -> Matrix:
    """T_world_base [4, 4]: the body's x, y and heading on the floor."""
    ahead = T_world_body[:2, 0]
    x_m, y_m = (float(v) for v in T_world_body[:2, 3])
    return se2_to_se3(x_m, y_m, math.atan2(ahead[1], ahead[0]))


def to_vision(point_world_m: tuple[float, float, float], ground_m: float) -> Matrix:
    """A world point [3] in the vision frame."""
    return (invert(world_from_vision(ground_m)) @ [*point_world_m, 1.0])[:3]
