"""The fake Spot and its room. The robot moves as commanded while command and lease are valid.

Time is the computer's; the robot's clock is `skew_s` ahead. `hurry` multiplies the walking speed,
so that a complete task takes seconds; limits and end times of commands stay true.
"""

from __future__ import annotations

import math
import threading
import time
from dataclasses import dataclass, field, replace

import numpy as np

from tests.fake_spot.body import SITTING_M, STANDING_M, STOWED, Arm, Array, pose, yawed
from tests.fake_spot.scene import Box, Cylinder, Shape, first_hit, support_below

LEASE_STALE_S = 3.0
GROUND_IN_VISION_M = -0.2  # the vision frame's origin is not on the floor
FOOTPRINT_M = 0.35
REACH_M = 1.15  # from the shoulder to the grasped object
TIP_M = 0.12


@dataclass
class Walk:
    """Either a goal or a velocity, until `end_s` on the computer's clock."""

    end_s: float
    speed: float
    turn: float
    goal: tuple[float, float, float] | None = None
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass
class World:
    """State of robot and room, guarded by `lock`: servicers hold it while they read or write."""

    fixed: dict[str, Shape]
    things: dict[str, Cylinder | Box]
    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0
    skew_s: float = 0.0
    hurry: float = 1.0
    lock: threading.RLock = field(default_factory=threading.RLock)
    motors: bool = False
    standing: bool = False
    estops: set[str] = field(default_factory=set)
    power_refusal: str = ""  # name of a PowerCommandStatus
    grasp_outcome: str = ""  # name of a ManipulationFeedbackState to end every grasp with
    endless: set[str] = field(default_factory=set)  # kinds of commands that never end
    estop_due_s: float = math.inf  # monotonic: when a silent e-stop endpoint trips
    T_flat_hand: Array = field(default_factory=STOWED.copy)
    stowed: bool = True
    open: float = 0.0
    held: str = ""
    walk: Walk | None = None
    lease_owner: str = ""
    retained_s: float = 0.0
    # The fastest commanded speeds: walk, turn, hand (m/s), hand (rad/s).
    fastest: float = 0.0
    fastest_turn: float = 0.0
    fastest_hand: float = 0.0
    fastest_wrist: float = 0.0
    bumps: int = 0
    log: list[str] = field(default_factory=list)
    _then_s: float = field(default_factory=time.monotonic)

    # --- clocks -------------------------------------------------------------------------------
    @property
    def robot_ns(self) -> int:
        return time.time_ns() + round(self.skew_s * 1e9)

    def local_s(self, robot_ns: int) -> float:
        """Time on the computer's clock for a time on the robot's clock."""
        return robot_ns / 1e9 - self.skew_s

    # --- where it is --------------------------------------------------------------------------
    @property
    def T_world_body(self) -> Array:
        self.step()
        z = STANDING_M if self.standing else SITTING_M
        return pose((self.x, self.y, z), yawed(self.yaw))

    @property
    def T_world_hand(self) -> Array:
        return self.T_world_body @ self.T_flat_hand

    @property
    def shapes(self) -> dict[str, Shape]:
        """Everything but the robot and the object that hangs at its fingers."""
        return {**self.fixed, **{n: t for n, t in self.things.items() if n != self.held}}

    @property
    def moving(self) -> bool:
        """Whether the robot walks or turns; a walk that has reached its goal does not count."""
        self.step()
        return self.walk is not None and (self.walk.goal is None or not self.at_goal())

    @property
    def lease_is_stale(self) -> bool:
        """Whether the holder has been silent too long; then any client may acquire the lease."""
        return time.monotonic() - self.retained_s > LEASE_STALE_S

    # --- motion -------------------------------------------------------------------------------
    def step(self) -> None:
        with self.lock:
            now = time.monotonic()
            dt, self._then_s = now - self._then_s, now
            if now > self.estop_due_s:
                self.estop_due_s = math.inf
                self.press_estop("software")
            if self.walk is None:
                return
            self._check_command_expiry()
            while dt > 0 and self.walk is not None:
                part = min(dt, 0.01)
                dt -= part
                self._advance(part * self.hurry)

    def _check_command_expiry(self) -> None:
        assert self.walk is not None
        if time.time() > self.walk.end_s:
            self.halt("the command ended")
        elif not self.lease_owner or self.lease_is_stale:
            self.halt("the lease went stale")

    def _advance(self, dt: float) -> None:
        walk = self.walk
        assert walk is not None
        if walk.goal is None:
            vx, vy, w = walk.velocity
            c, s = math.cos(self.yaw), math.sin(self.yaw)
            self._move(self.x + (c * vx - s * vy) * dt, self.y + (s * vx + c * vy) * dt)
            self.yaw += w * dt
            return
        gx, gy, gyaw = walk.goal
        dx, dy = gx - self.x, gy - self.y
        far = math.hypot(dx, dy)
        part = min(1.0, walk.speed * dt / far) if far > 1e-9 else 1.0
        self._move(self.x + dx * part, self.y + dy * part)
        off = (gyaw - self.yaw + math.pi) % (2 * math.pi) - math.pi
        self.yaw += math.copysign(min(abs(off), walk.turn * dt), off)
        if math.hypot(gx - self.x, gy - self.y) < 1e-3 and abs(off) < 1e-3:
            self.walk = replace(walk, goal=(self.x, self.y, self.yaw))

    def _move(self, x: float, y: float) -> None:
        for shape in self.fixed.values():
            low, high = shape.bounds
            if high[2] < 0.1 or low[2] > 0.6:
                continue
            nearest = np.clip([x, y], low[:2], high[:2])
            if math.hypot(nearest[0] - x, nearest[1] - y) < FOOTPRINT_M:
                self.bumps += 1
                return
        self.x, self.y = x, y

    def at_goal(self) -> bool:
        self.step()
        if self.walk is None or self.walk.goal is None:
            return True
        gx, gy, gyaw = self.walk.goal
        off = (gyaw - self.yaw + math.pi) % (2 * math.pi) - math.pi
        return math.hypot(gx - self.x, gy - self.y) < 0.01 and abs(off) < 0.01

    def halt(self, why: str) -> None:
        """Stand still."""
        if self.walk is not None:
            self.log.append(f"halt: {why}")
        self.walk = None

    def press_estop(self, name: str) -> None:
        with self.lock:
            self.estops.add(name)
            self.motors = self.standing = False
            self.halt("an e-stop")

    # --- gripper ------------------------------------------------------------------------------
    def grasp_along(self, eye: Array, ray: Array) -> str:
        """Grasp along a camera ray; the resulting ManipulationFeedbackState's name."""
        name, t = first_hit(self.shapes, eye, ray)
        if self.grasp_outcome:
            return self.grasp_outcome
        if not name:
            return "MANIP_STATE_GRASP_FAILED_TO_RAYCAST_INTO_MAP"
        point = eye + t * ray
        shoulder = (self.T_world_body @ [0.292, 0.0, 0.188, 1.0])[:3]
        if np.linalg.norm(point - shoulder) > REACH_M:
            return "MANIP_STATE_GRASP_PLANNING_NO_SOLUTION"
        if name not in self.things:
            return "MANIP_STATE_GRASP_FAILED"
        self.held, self.open, self.stowed = name, 0.1, False
        self.log.append(f"grasped {name}")
        return "MANIP_STATE_GRASP_SUCCEEDED"

    def grip(self, open: float) -> None:
        """Set the gripper opening, 0 is closed. A held object falls when the gripper opens."""
        self.open = open
        if open > 0.5 and self.held:
            name, self.held = self.held, ""
            thing = self.things[name]
            tip = (self.T_world_hand @ [TIP_M, 0.0, 0.0, 1.0])[:3]
            low, high = thing.bounds
            half = float(high[2] - low[2]) / 2
            others = {**self.fixed, **{n: t for n, t in self.things.items() if n != name}}
            z = support_below(others.values(), tip[0], tip[1], float(tip[2]))
            center = (float(tip[0]), float(tip[1]), z + half)
            self.things[name] = replace(thing, center=center)
            self.log.append(f"released {name} at {center[0]:.2f} {center[1]:.2f} {z:.2f}")

    def reach(self, T_flat_hand: Array) -> bool:
        """Move the hand to a pose; False if the arm cannot reach it."""
        if not Arm(T_flat_hand).reachable:
            return False
        self.T_flat_hand, self.stowed = T_flat_hand, False
        return True
