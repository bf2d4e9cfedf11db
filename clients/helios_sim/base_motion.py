"""Base motion: velocity control in every physics step, with contact detection."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from helios_sim.drive_trace import DriveTrace
from helios_sim.mujoco_library import mujoco
from helios_sim.robot_model import RobotIndex
from helios_sim.robot_physics import RobotPhysics

MAX_SPEED_M_S, MAX_ACCELERATION_M_S2 = 0.8, 2.0
MAX_RATE_RAD_S, MAX_ACCELERATION_RAD_S2 = 1.6, 5.0
_ARRIVED_M, _ARRIVED_RAD = 5e-4, 5e-4
_HOLD_PER_S = 10.0  # proportional gain on the remaining pose error
_BLOCKED_COS = 0.2  # a contact within about 78 degrees of the direction of travel ends a drive
_COAST_STEPS = 25  # physics steps after the controls are set to zero


@dataclass(frozen=True)
class Drive:
    """Result of a drive; `touched` holds ids of touched bodies, without movable objects."""

    moved_m: float
    turned_rad: float
    arrived: bool
    stopped: bool  # by stop-now
    touched: frozenset[int]


class Base:
    """Base of a robot in a model. Contacts with the bodies in `movable` are ignored."""

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        robot: RobotIndex,
        movable: frozenset[int],
        physics: RobotPhysics,
        trace: DriveTrace,
    ) -> None:
        """physics: advances the model. trace: records the drives."""
        self._model, self._data, self._robot = model, data, robot
        self._movable = movable
        self._physics, self._trace = physics, trace

    def forward(self, distance_m: float, stop_asked: Callable[[], bool]) -> Drive:
        """Drive straight, backward if negative, until the base arrives, is blocked or stopped."""
        x, y, yaw = self._robot.pose(self._data)
        goal = (x + distance_m * math.cos(yaw), y + distance_m * math.sin(yaw), yaw)
        slowest_s = 2.0 * (abs(distance_m) / MAX_SPEED_M_S + MAX_SPEED_M_S / MAX_ACCELERATION_M_S2)
        return self._drive(goal, slowest_s, stop_asked)

    def turn(self, angle_rad: float, stop_asked: Callable[[], bool]) -> Drive:
        """Turn in place; positive to the left."""
        x, y, yaw = self._robot.pose(self._data)
        rate, acceleration = MAX_RATE_RAD_S, MAX_ACCELERATION_RAD_S2
        slowest_s = 2.0 * (abs(angle_rad) / rate + rate / acceleration)
        return self._drive((x, y, yaw + angle_rad), slowest_s, stop_asked)

    def touching(self) -> dict[int, tuple[float, float]]:
        """Non-movable bodies in contact -> horizontal direction (x, y) towards each."""
        found: dict[int, tuple[float, float]] = {}
        data, geoms = self._data, self._robot.geoms
        for k in range(data.ncon):
            contact = data.contact[k]
            a, b = int(contact.geom1), int(contact.geom2)
            if (a in geoms) == (b in geoms):
                continue
            # The contact's first axis points from geom1 to geom2.
            sign, other = (1.0, b) if a in geoms else (-1.0, a)
            body = int(self._model.geom_bodyid[other])
            if body not in self._movable:
                found[body] = (sign * float(contact.frame[0]), sign * float(contact.frame[1]))
        return found

    def _drive(
        self,
        goal: tuple[float, float, float],
        slowest_s: float,
        stop_asked: Callable[[], bool],
    ) -> Drive:
        physics = self._physics
        start = physics.pose()
        dt = float(self._model.opt.timestep)
        speed = rate = 0.0
        touched: set[int] = set()
        arrived = stopped = False
        physics.begin()
        self._trace.begin(physics.time_s, *start[:2])
        for _ in range(math.ceil(slowest_s / dt)):
            x, y, yaw = physics.pose()
            dx, dy, turn = goal[0] - x, goal[1] - y, goal[2] - yaw
            away = math.hypot(dx, dy)
            if away < _ARRIVED_M and abs(turn) < _ARRIVED_RAD:
                arrived = True
                break
            stopped = stop_asked()
            if stopped:
                break
            speed = _ramp(speed, away, MAX_SPEED_M_S, MAX_ACCELERATION_M_S2, dt)
            rate = _ramp(rate, abs(turn), MAX_RATE_RAD_S, MAX_ACCELERATION_RAD_S2, dt)
            across = min(speed, _HOLD_PER_S * away)
            ahead = (dx / away, dy / away) if away > 0 else (0.0, 0.0)
            physics.control(
                across * ahead[0],
                across * ahead[1],
                math.copysign(min(rate, 2 * _HOLD_PER_S * abs(turn)), turn),
            )
            contacts = self._step()
            touched |= contacts.keys()
            if away > _ARRIVED_M and any(
                ahead[0] * nx + ahead[1] * ny > _BLOCKED_COS for nx, ny in contacts.values()
            ):
                break
        physics.control(0.0, 0.0, 0.0)
        for left in reversed(range(_COAST_STEPS)):
            touched |= self._step(whole=left == 0).keys()
        x, y, yaw = physics.pose()
        return Drive(
            moved_m=math.hypot(x - start[0], y - start[1]),
            turned_rad=yaw - start[2],
            arrived=arrived,
            stopped=stopped,
            touched=frozenset(touched),
        )

    def _step(self, *, whole: bool = False) -> dict[int, tuple[float, float]]:
        """Advance by one step; the contacts as in `touching`."""
        contacts = self.touching() if self._physics.step(whole=whole) else {}
        self._trace.step(self._physics.time_s, *self._physics.pose()[:2])
        return contacts


def _ramp(speed: float, remaining: float, top: float, acceleration: float, dt: float) -> float:
    """Next speed, limited by acceleration, top speed and braking within the remaining distance."""
    return min(speed + acceleration * dt, top, math.sqrt(2 * acceleration * remaining))
