"""Gripper: grasps, carries and releases one object. A held object is kinematic and contact-free."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from helios_core.geometry import Matrix, se2_to_se3
from numpy.typing import NDArray

from helios_sim.home.mujoco_model import GROUP_COLLISION
from helios_sim.mujoco_library import mujoco
from helios_sim.robot_model import (
    CAMERA_HEIGHT_M,
    CARRY_BASE_M,
    GRIPPER_BASE_M,
    SHOW_BASE_M,
    RobotIndex,
)

REST_LINEAR_M_S, REST_ANGULAR_RAD_S = 0.005, 0.05
REST_S = 50 / 30  # 50 control steps of the benchmark
_AWAKE_M_S = 0.01  # downward velocity that keeps the physics from putting the body to sleep
_ARM_ABOVE_M = 0.1  # height of the arm's end point above the place point
_PAST_M = 0.01  # a ray continues this far behind a movable body
_RELEASE_GAP_M = 0.02
_RELEASE_STEP_M, _RELEASE_MAX_RISE_M = 0.02, 0.3
_RELEASE_OVERLAP_M = 0.002
_SETTLE_S = 6.0
STAYS_M, STAYS_RAD = 0.001, math.radians(1)  # a trembling object moves and turns less


@dataclass(frozen=True)
class Graspable:
    """Free body that can be grasped; `half_m`: half extents of its box, centred on the origin."""

    name: str
    body: int
    qpos: int
    dof: int
    geoms: tuple[int, ...]  # collision geoms
    half_m: tuple[float, float, float]

    @classmethod
    def of(cls, model: mujoco.MjModel, name: str, size_m: Sequence[float]) -> Graspable:
        body = model.body(name)
        joint = int(body.jntadr[0])
        first, count = int(body.geomadr[0]), int(body.geomnum[0])
        return cls(
            name=name,
            body=int(body.id),
            qpos=int(model.jnt_qposadr[joint]),
            dof=int(model.jnt_dofadr[joint]),
            geoms=tuple(g for g in range(first, first + count) if model.geom_contype[g]),
            half_m=(size_m[0] / 2, size_m[1] / 2, size_m[2] / 2),
        )

    def distance_m(self, data: mujoco.MjData, point_world_m: Sequence[float]) -> float:
        """Distance (m) from a point to the object's box; 0 inside."""
        R = data.xmat[self.body].reshape(3, 3)
        p_body = R.T @ (np.asarray(point_world_m) - data.xpos[self.body])
        return float(np.linalg.norm(np.maximum(np.abs(p_body) - self.half_m, 0.0)))


@dataclass(frozen=True)
class RestState:
    """Final state of a released object. `on`: body -> height of the highest contact with it, m."""

    at_rest: bool  # for 50 consecutive control steps
    on: dict[int, float]  # touched at the end; if slow all the time: touched in all of these steps
    touched_any_time: frozenset[int]  # touched at any time
    height_m: float  # of the object's centre


class _Stay:
    """Number of steps for which an object has stayed near one pose, in contact."""

    def __init__(self) -> None:
        self.steps = 0
        self._pose: NDArray[np.float64] | None = None

    def note(self, pose: NDArray[np.float64], in_contact: bool) -> None:
        """Add a step. pose: [7] position (m) and unit quaternion."""
        if self._pose is not None and in_contact:
            moved_m = float(np.linalg.norm(pose[:3] - self._pose[:3]))
            turned_rad = 2 * math.acos(min(1.0, abs(float(pose[3:] @ self._pose[3:]))))
            if moved_m <= STAYS_M and turned_rad <= STAYS_RAD:
                self.steps += 1
                return
        self._pose, self.steps = pose.copy(), 0


class Gripper:
    """Gripper of the robot, with at most one held object."""

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        robot: RobotIndex,
        movable: frozenset[int],
    ) -> None:
        """movable: bodies that do not block the arm."""
        self._model, self._data, self._robot = model, data, robot
        self._movable = movable
        self.held: Graspable | None = None
        self.shown_turn_rad: float | None = None  # None: the object is carried behind the camera
        self._R_base_object = np.eye(3)

    @property
    def held_body(self) -> int | None:
        """Id of the held body; None if the gripper is empty."""
        return self.held.body if self.held is not None else None

    def rest_world_m(self) -> NDArray[np.float64]:
        """Position [3] of the end effector at rest."""
        T = self._T_world_base()
        return T[:3, :3] @ np.array(GRIPPER_BASE_M) + T[:3, 3]

    def distance_m(self, point_world_m: Sequence[float] | NDArray[np.float64]) -> float:
        """Distance (m) from the end effector at rest to a point."""
        return float(np.linalg.norm(np.asarray(point_world_m) - self.rest_world_m()))

    def arm_blocked(self, point_world_m: Sequence[float]) -> bool:
        """True if walls or furniture block the arm on its path to 0.1 m above the point.

        The arm takes one of two straight paths from above the base: horizontal, or from the
        camera's height.
        """
        goal = np.add(point_world_m, (0.0, 0.0, _ARM_ABOVE_M))
        x, y, _ = self._robot.pose(self._data)
        starts = ((x, y, float(goal[2])), (x, y, CAMERA_HEIGHT_M))
        return all(self._meets(np.array(start), goal) for start in starts)

    def grasp(self, thing: Graspable) -> None:
        """Move the object to the carrying pose and disable its contacts until it is released."""
        R_world_base = self._T_world_base()[:3, :3]
        self._R_base_object = R_world_base.T @ self._data.xmat[thing.body].reshape(3, 3)
        self.held = thing
        self._collide(thing, False)
        self.follow()

    def follow(self) -> None:
        """Move the held object with the base. Call it also after the last physics step."""
        if self.held is not None:
            T = self._T_world_base()
            place_m, R_base_object = CARRY_BASE_M, self._R_base_object
            if self.shown_turn_rad is not None:
                turned = se2_to_se3(0.0, 0.0, self.shown_turn_rad)[:3, :3]
                place_m, R_base_object = SHOW_BASE_M, turned @ R_base_object
            position = T[:3, :3] @ np.array(place_m) + T[:3, 3]
            self._put(self.held, position, T[:3, :3] @ R_base_object)

    def show(self, turn_rad: float) -> None:
        """Hold the object before the camera, turned about the vertical from how it is carried."""
        self.shown_turn_rad = turn_rad
        self.follow()

    def end_showing(self) -> None:
        """Carry the object behind the camera again."""
        if self.shown_turn_rad is not None:
            self.shown_turn_rad = None
            self.follow()

    def step(self) -> None:
        """Advance the physics by one step and move the held object along."""
        self.follow()
        mujoco.mj_step(self._model, self._data)

    def release(self, point_world_m: Sequence[float]) -> bool:
        """Release the held object above a point, in its orientation relative to the base.

        Return False if there is no room for it.
        """
        thing = self.held
        if thing is None:
            return False
        R = self._T_world_base()[:3, :3] @ self._R_base_object
        half_height_m = float(np.abs(R[2]) @ thing.half_m)
        self._collide(thing, True)
        rises = np.arange(0.0, _RELEASE_MAX_RISE_M, _RELEASE_STEP_M)
        for rise_m in rises:
            position = np.array(point_world_m, float)
            position[2] += half_height_m + _RELEASE_GAP_M + rise_m
            self._put(thing, position, R)
            mujoco.mj_forward(self._model, self._data)
            if not self._overlaps(thing):
                self.held = None
                return True
        self._collide(thing, False)
        self.follow()
        mujoco.mj_forward(self._model, self._data)
        return False

    def settle(self, thing: Graspable) -> RestState:
        """Step the physics until the object rests for 50 control steps; at most 6 s.

        An object also rests if it stayed within `STAYS_M` and `STAYS_RAD` of one pose, in contact,
        for the last 50 control steps. Thin objects on a soft contact do: they tremble in their
        place, faster than the benchmark's limits of velocity.
        """
        data = self._data
        dt = float(self._model.opt.timestep)
        wanted = math.ceil(REST_S / dt)
        resting = 0
        on: dict[int, float] = {}
        met: set[int] = set()
        throughout: set[int] = set()
        stay = _Stay()
        for _ in range(math.ceil(_SETTLE_S / dt)):
            self.step()
            velocity = data.qvel[thing.dof : thing.dof + 6]
            # A sleeping body keeps its last contacts, but MuJoCo does not list them.
            if data.body_awake[thing.body]:
                on = self.touched_by(thing)
                met |= on.keys()
            stay.note(data.qpos[thing.qpos : thing.qpos + 7], bool(on))
            slow = (
                np.linalg.norm(velocity[:3]) < REST_LINEAR_M_S
                and np.linalg.norm(velocity[3:]) < REST_ANGULAR_RAD_S
            )
            if not slow or not on:
                resting = 0
                continue
            throughout = set(on) if resting == 0 else throughout & on.keys()
            resting += 1
            if resting >= wanted:
                break
        slow_enough = resting >= wanted
        at_rest = slow_enough or stay.steps >= wanted
        end = {body: z for body, z in on.items() if body in throughout} if slow_enough else on
        return RestState(at_rest, end, frozenset(met), float(data.xpos[thing.body][2]))

    def touched_by(self, thing: Graspable) -> dict[int, float]:
        """Bodies in contact with the object -> height of the highest contact, m."""
        found: dict[int, float] = {}
        for k in range(self._data.ncon):
            contact = self._data.contact[k]
            bodies = [int(self._model.geom_bodyid[g]) for g in (contact.geom1, contact.geom2)]
            if thing.body in bodies:
                other = bodies[0] if bodies[1] == thing.body else bodies[1]
                found[other] = max(found.get(other, -math.inf), float(contact.pos[2]))
        return found

    def _T_world_base(self) -> Matrix:
        return se2_to_se3(*self._robot.pose(self._data))

    def _put(self, thing: Graspable, position: NDArray[np.float64], R_world_object: Matrix) -> None:
        quat = np.empty(4)
        mujoco.mju_mat2Quat(quat, np.ascontiguousarray(R_world_object).ravel())
        self._data.qpos[thing.qpos : thing.qpos + 3] = position
        self._data.qpos[thing.qpos + 3 : thing.qpos + 7] = quat
        self._data.qvel[thing.dof : thing.dof + 6] = [0.0, 0.0, -_AWAKE_M_S, 0.0, 0.0, 0.0]

    def _meets(self, start: NDArray[np.float64], goal: NDArray[np.float64]) -> bool:
        """True if a body that is not movable intersects the line between two points."""
        group = np.zeros(6, np.uint8)
        group[GROUP_COLLISION] = 1
        geom = np.array([-1], np.int32)
        length_m = float(np.linalg.norm(goal - start))
        ahead = (goal - start) / max(length_m, 1e-9)
        gone_m = 0.0
        while gone_m < length_m:
            at = start + gone_m * ahead
            hit_m = mujoco.mj_ray(self._model, self._data, at, ahead, group, 1, -1, geom)
            if hit_m < 0 or gone_m + hit_m >= length_m:
                return False
            if int(self._model.geom_bodyid[geom[0]]) not in self._movable:
                return True
            gone_m += hit_m + _PAST_M
        return False

    def _overlaps(self, thing: Graspable) -> bool:
        for k in range(self._data.ncon):
            contact = self._data.contact[k]
            if contact.dist < -_RELEASE_OVERLAP_M and (
                contact.geom1 in thing.geoms or contact.geom2 in thing.geoms
            ):
                return True
        return False

    def _collide(self, thing: Graspable, on: bool) -> None:
        for geom in thing.geoms:
            self._model.geom_contype[geom] = self._model.geom_conaffinity[geom] = int(on)
