"""Current boxes of furniture and movable objects, from the state of the physics."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from helios_sim.ground_truth import TrueObjectState
from helios_sim.home import Fixture, Home
from helios_sim.mujoco_library import mujoco

_FLOOR_M = 0.1  # an object whose underside is below this height lies on the floor


def current_object_states(
    home: Home, data: mujoco.MjData, on: Mapping[str, str]
) -> Iterator[TrueObjectState]:
    """Furniture, then movable objects. on: movable object -> body on which it stands."""
    for item in (*home.receptacles, *home.fixtures):
        z = item.z_m if isinstance(item, Fixture) else 0.0
        center = (item.x, item.y, z + item.size_m[2] / 2)
        yield TrueObjectState(item.name, item.class_name, center, item.size_m, item.yaw_rad, False)
    for thing in home.objects:
        body = data.body(thing.name)
        size_m, yaw_rad = upright_box(body.xmat.reshape(3, 3), thing.size_m)
        x, y, z = (float(v) for v in body.xpos)
        stands_on = on[thing.name] if z - size_m[2] / 2 > _FLOOR_M else ""
        yield TrueObjectState(
            thing.name, thing.class_name, (x, y, z), size_m, yaw_rad, True, stands_on
        )


def upright_box(
    R_world_body: NDArray[np.float64], size_m: tuple[float, float, float]
) -> tuple[tuple[float, float, float], float]:
    """Size and yaw of the upright box around a rotated box; the same size if it stands upright."""
    ahead = R_world_body[:, 0]
    if abs(ahead[2]) > 0.9:  # the x axis is almost vertical
        ahead = R_world_body[:, 1]
    yaw_rad = math.atan2(ahead[1], ahead[0])
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    R_yaw_world = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    x, y, z = (float(v) for v in np.abs(R_yaw_world @ R_world_body) @ size_m)
    return (x, y, z), yaw_rad
