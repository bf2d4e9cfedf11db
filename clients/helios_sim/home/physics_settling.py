"""Settling of objects in the physics, with a check that they are visible and within reach."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from helios_sim.home import freespace
from helios_sim.home.freespace import CELL_M
from helios_sim.home.generated_home import Home
from helios_sim.home.home_types import SceneObject
from helios_sim.mujoco_library import mujoco

_SETTLE_S = 2.0
_MAX_DRIFT_M = 0.04
_MAX_TILT_COS = math.cos(math.radians(2))
_VIEW_CELLS = 24
_AROUND_M = 2.5
# Points of an object's box for the visibility test: (share of its width, share of its height).
_MIDDLE = ((0.0, 0.0), (0.0, 0.4))
_FACE = (*_MIDDLE, (-0.35, 0.0), (0.35, 0.0), (-0.3, 0.35), (0.3, 0.35))


def settled(home: Home, passable: NDArray[np.bool_]) -> tuple[SceneObject, ...]:
    """Objects at their rest poses that stay upright, in place and visible to a robot within reach.

    passable: cells [row, column] where the robot fits with its margin.
    """
    model = home.spec(visuals=False).compile()
    data = mujoco.MjData(model)
    for _ in range(round(_SETTLE_S / model.opt.timestep)):
        mujoco.mj_step(model, data)
    kept = []
    for thing in home.objects:
        body = data.body(thing.name)
        drift = float(np.linalg.norm(body.xpos - thing.position_m))
        up = float(body.xmat[8])
        yaw = math.atan2(float(body.xmat[3]), float(body.xmat[0]))
        # A ball has no upright orientation.
        upright = up > _MAX_TILT_COS or (
            len(thing.shape.collision_primitives) == 1 and thing.shape.rolls
        )
        if drift > _MAX_DRIFT_M or not upright:
            continue
        x, y, z = (float(value) for value in body.xpos)
        rested = replace(thing, position_m=(x, y, z), yaw_rad=yaw)
        if _can_be_seen(rested, home, passable, model, data):
            kept.append(rested)
    return tuple(kept)


def _can_be_seen(
    thing: SceneObject,
    home: Home,
    passable: NDArray[np.bool_],
    model: mujoco.MjModel,
    data: mujoco.MjData,
) -> bool:
    """True if a robot within reach sees enough of the object.

    The demo requires its centre or its top, the benchmark half of the points on its face.
    """
    receptacle = home.receptacle(thing.receptacle)
    near = passable & freespace.room_mask(home.rooms[receptacle.room], home.bounds, CELL_M)
    x_of, y_of = freespace.cell_centers(home.bounds, CELL_M)
    rows, columns = np.nonzero(near)
    away = np.hypot(x_of[columns] - thing.position_m[0], y_of[rows] - thing.position_m[1])
    in_reach = np.nonzero(away <= home.preset.reach_m - 0.05)[0]
    step = max(1, len(in_reach) // _VIEW_CELLS)
    simple = home.preset.catalog == "demo"
    for k in in_reach[::step]:
        eye = np.array([x_of[columns[k]], y_of[rows[k]], home.preset.camera_height_m])
        if simple:
            if any(sees(model, data, eye, thing, *part) for part in _MIDDLE):
                return True
        elif sum(sees(model, data, eye, thing, *part) for part in _FACE) * 2 >= len(_FACE):
            return True
    return False


def hidden_shares(home: Home, passable: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Share [n], for each object, of the stands around it from which its centre is not visible.

    A stand is a position in its room within `_AROUND_M` where the robot fits with its margin.
    """
    model = home.spec(visuals=False).compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    x_of, y_of = freespace.cell_centers(home.bounds, CELL_M)
    shares = []
    for thing in home.objects:
        room = home.rooms[home.receptacle(thing.receptacle).room]
        rows, columns = np.nonzero(passable & freespace.room_mask(room, home.bounds, CELL_M))
        x, y = x_of[columns], y_of[rows]
        near = np.hypot(x - thing.position_m[0], y - thing.position_m[1]) <= _AROUND_M
        near = np.nonzero(near)[0]
        near = near[:: max(1, len(near) // _VIEW_CELLS)]
        eyes = (np.array([x[k], y[k], home.preset.camera_height_m]) for k in near)
        seen = sum(sees(model, data, eye, thing, 0.0, 0.0) for eye in eyes)
        shares.append(1.0 - seen / max(len(near), 1))
    return np.array(shares)


def sees(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    eye: NDArray[np.float64],
    thing: SceneObject,
    across: float,
    up: float,
) -> bool:
    """True if a ray from the eye [3] to a point of the object hits the object first.

    across: lateral offset of the point, seen from the eye, as a share of the smaller width;
    up: vertical offset as a share of the height.
    """
    target = np.array(thing.position_m)
    to = target[:2] - eye[:2]
    side = np.array([-to[1], to[0]]) / max(float(np.linalg.norm(to)), 1e-9)
    target[:2] += across * min(thing.size_m[:2]) * side
    target[2] += up * thing.size_m[2]
    geom = np.array([-1], dtype=np.int32)
    mujoco.mj_ray(model, data, eye, target - eye, None, 1, -1, geom)
    return geom[0] >= 0 and model.body(model.geom_bodyid[geom[0]]).name == thing.name


def renumbered(things: Sequence[SceneObject]) -> tuple[SceneObject, ...]:
    """Objects renamed without gaps: mug_0, mug_1, …"""
    counts: dict[str, int] = {}
    named = []
    for thing in things:
        number = counts.get(thing.class_name, 0)
        counts[thing.class_name] = number + 1
        named.append(replace(thing, name=f"{thing.class_name.replace(' ', '_')}_{number}"))
    return tuple(named)
