"""Physics steps of a robot in a home: of the whole model, or of the robot alone where both agree.

A step of the whole model searches all pairs of geoms for contacts. While nothing is near the robot
and nothing else moves, the robot's motion depends on its drives alone. Such steps use a model that
holds only the robot. They give the same numbers, bit for bit
(`tests/unit/sim/test_robot_physics.py`).
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from helios_sim.mujoco_library import mujoco
from helios_sim.navigable_area import clearance_m
from helios_sim.robot_model import BODY_BOTTOM_M, BODY_RADIUS_M, BODY_TOP_M, RobotIndex, add_robot

Pose = tuple[float, float, float]  # x, y, yaw; yaw is not wrapped

_FREE_M = 0.01  # least distance to the nearest geom for steps of the robot alone
_OVERLAP_M = 0.005  # geoms this far above or below the body count as beside it
_AGAIN_M = 0.01  # after a move this far, the distance to the nearest geom is measured again
_UPRIGHT = 1 - 1e-9  # least cosine of the tilt of a geom that counts as upright


class RobotPhysics:
    """Advances the physics while the robot drives or waits.

    Only after a step with `whole=True` is the state of the whole model up to date; end every
    motion with one. Before it, read the robot's pose from here.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        robot: RobotIndex,
        step: Callable[[], None],
        held_body: Callable[[], int | None],
    ) -> None:
        """step: advances the whole model by one step. held_body: the held body, which touches
        nothing, or None.
        """
        self._model, self._data, self._robot = model, data, robot
        self._step_whole, self._held_body = step, held_body
        self._alone = _robot_alone(model)
        self._alone_data = mujoco.MjData(self._alone)
        self._qpos, self._dof = [*robot.qpos, robot.tilt_qpos], [*robot.dof, robot.tilt_dof]
        self._controls = list(robot.controls)
        self._alone_qpos, self._alone_ctrl = self._alone_data.qpos, self._alone_data.ctrl
        self._margin_m = BODY_RADIUS_M + 2 * float(model.geom_margin.max(initial=0.0))
        self.watch: Callable[[], None] | None = None  # called after each step, all then whole
        self._ahead = False  # the robot alone is further than the whole model
        fixed, self._loose = _colliding_geoms(model, robot)
        self._fixed = _beside_body(model, data, fixed)
        self._rectangles: NDArray[np.float64] | None = None
        self._measured_m = (math.inf, math.inf)  # position at which the free distance was measured
        self._free_m = 0.0

    @property
    def time_s(self) -> float:
        """Simulated time."""
        return self._alone_data.time if self._ahead else self._data.time

    def pose(self) -> Pose:
        """Current pose (x, y, yaw) of the base."""
        if self._ahead:
            x, y, yaw, _ = self._alone_qpos.tolist()
            return x, y, yaw
        return self._robot.pose(self._data)

    def begin(self) -> None:
        """Call before the first step of a motion: objects may have moved."""
        self._rectangles = None
        self._measured_m = (math.inf, math.inf)

    def control(self, vx_m_s: float, vy_m_s: float, rate_rad_s: float) -> None:
        """Set the velocities of the base, world frame."""
        ctrl = self._alone_ctrl
        ctrl[0], ctrl[1], ctrl[2] = vx_m_s, vy_m_s, rate_rad_s

    def step(self, *, whole: bool = False) -> bool:
        """Advance by one step. whole: use the whole model in any case.

        True if the step was one of the whole model, so that contacts are listed.
        """
        if not whole and self.watch is None and self._is_free():
            if not self._ahead:
                self._copy_to_alone()
            mujoco.mj_step(self._alone, self._alone_data)
            return False
        if self._ahead:
            self._copy_to_whole()
        self._data.ctrl[self._controls] = self._alone_ctrl
        self._step_whole()
        if self.watch is not None:
            self.watch()
        return True

    def _is_free(self) -> bool:
        """True if nothing can touch the robot in the next step, and nothing else moves."""
        x, y, _ = self.pose()
        moved_m = math.hypot(x - self._measured_m[0], y - self._measured_m[1])
        if self._free_m > 0 and moved_m < self._free_m:
            return True
        if self._free_m <= 0 and moved_m < _AGAIN_M - self._free_m:
            return False
        if not self._ahead and self._others_move():
            return False
        if self._rectangles is None:
            loose = _beside_body(self._model, self._data, self._loose)
            self._rectangles = np.concatenate([self._fixed, loose])
        nearest_m = float(clearance_m(np.array([[x, y]]), self._rectangles)[0])
        self._measured_m = (x, y)
        self._free_m = nearest_m - self._margin_m - _FREE_M
        return self._free_m > 0

    def _others_move(self) -> bool:
        """True if anything but the robot and the held object is awake."""
        awake = self._data.tree_awake.copy()
        for body in (*self._robot.bodies, self._held_body()):
            if body is not None:
                awake[self._model.body_treeid[body]] = 0
        return bool(awake.any())

    def _copy_to_alone(self) -> None:
        alone, data = self._alone_data, self._data
        alone.qpos[:], alone.qvel[:] = data.qpos[self._qpos], data.qvel[self._dof]
        alone.qacc_warmstart[:] = data.qacc_warmstart[self._dof]
        alone.time = data.time
        self._ahead = True

    def _copy_to_whole(self) -> None:
        alone, data = self._alone_data, self._data
        data.qpos[self._qpos], data.qvel[self._dof] = alone.qpos, alone.qvel
        data.qacc_warmstart[self._dof] = alone.qacc_warmstart
        data.time = alone.time
        self._ahead = False


def _robot_alone(model: mujoco.MjModel) -> mujoco.MjModel:
    """Model of the robot without a home, with the same options of the physics."""
    spec = mujoco.MjSpec()
    add_robot(spec)
    alone = spec.compile()
    for name in ("timestep", "integrator", "gravity", "disableflags"):
        setattr(alone.opt, name, getattr(model.opt, name))
    return alone


def _colliding_geoms(
    model: mujoco.MjModel, robot: RobotIndex
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(fixed, loose) geoms that may touch the robot; the loose ones belong to movable bodies."""
    geoms = np.flatnonzero((model.geom_contype != 0) | (model.geom_conaffinity != 0))
    bodies = model.geom_bodyid[geoms]
    fixed = model.body_weldid[bodies] == 0
    return geoms[fixed], geoms[~fixed & ~np.isin(bodies, list(robot.bodies))]


def _beside_body(
    model: mujoco.MjModel, data: mujoco.MjData, geoms: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Rectangles [n, 5] as in `clearance_m` around those geoms that the robot's body can touch."""
    R = data.geom_xmat[geoms].reshape(-1, 3, 3)
    center, half = model.geom_aabb[geoms, :3], model.geom_aabb[geoms, 3:]
    center = data.geom_xpos[geoms] + np.einsum("nij,nj->ni", R, center)
    turned = np.einsum("nij,nj->ni", np.abs(R), half)
    upright = np.abs(R[:, 2, 2]) > _UPRIGHT
    yaw = np.where(upright, np.arctan2(R[:, 1, 0], R[:, 0, 0]), 0.0)
    half_xy = np.where(upright[:, None], half[:, :2], turned[:, :2])
    low, high = center[:, 2] - turned[:, 2], center[:, 2] + turned[:, 2]
    beside = (low < BODY_TOP_M + _OVERLAP_M) & (high > BODY_BOTTOM_M - _OVERLAP_M)
    return np.column_stack([center[:, :2], half_xy, yaw])[beside]
