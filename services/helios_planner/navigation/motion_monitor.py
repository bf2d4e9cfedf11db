"""Counts of failed motions. Each kind has a limit; beyond it the task fails."""

from __future__ import annotations

import math

from helios_core.geometry import wrap_angle
from helios_core.robot import Action, ActionResult, Forward, Observe, Place, Turn

from helios_planner.motion_planning.costmap import Pose2
from helios_planner.robot.interface import RobotInterface
from helios_planner.task import Cause, TaskFailed

NO_MOTION_M = 0.05  # a shorter move forward met an obstacle
MOST_BLOCKS = 12  # motions without effect in one task before the robot counts as stuck
MOST_WEDGED = 3  # times in one task that the robot may be wedged
MOST_JUMPS = 3  # jumps of the localisation in one task
JUMP_M, JUMP_RAD = 0.5, math.radians(40)  # beyond the motion that the robot reports


class Dropped(Exception):
    """Raised when the carried object is no longer held; `point_m`: position of the base (x, y)."""

    def __init__(self, point_m: tuple[float, float], reason: str) -> None:
        super().__init__(reason)
        self.point_m, self.reason = point_m, reason


class MotionMonitor:
    """Performs the actions of one task and counts failures. A jump of the localisation
    sets `jumped`, and the code that handles it clears it. The code that picks an
    object sets `carrying`."""

    def __init__(self, robot: RobotInterface) -> None:
        self.robot = robot
        self.jumped = self.carrying = False
        self.blocks = self.wedged = self.jumps = 0

    def act(self, action: Action) -> ActionResult:
        """Perform an action. Raises TaskFailed at a limit, and Dropped if the
        carried object fell."""
        before = self.robot.pose()
        result = self.robot.act(action)
        after = self.robot.pose()
        self._see_jump(before, after, result)
        if isinstance(action, Turn) and not self.jumped and not self.robot.cut_short:
            turned = abs(wrap_angle(after.yaw_rad - before.yaw_rad))
            if max(turned, abs(result.turned_rad)) < 0.5 * abs(action.angle_rad):
                self.blocked()
        if self.carrying and not isinstance(action, Place) and not self._still_held():
            self.carrying = False
            raise Dropped(after.xy, "it is held no more")
        return result

    def _still_held(self) -> bool:
        """True if the gripper reports an object; asks twice before the object counts as fallen."""
        if not self.robot.held():
            self.robot.act(Observe())
        return bool(self.robot.held())

    def stood_still(self, move: Forward, result: ActionResult) -> bool:
        """True if a move met an unseen obstacle; after stop-now and jumps only if it collided."""
        still = result.moved_m < min(NO_MOTION_M, 0.5 * move.distance_m)
        return (still and not self.robot.cut_short and not self.jumped) or result.collided

    def blocked(self) -> None:
        """Count a motion without effect. Raises TaskFailed at the limit."""
        self.blocks += 1
        if self.blocks > MOST_BLOCKS:
            raise TaskFailed(
                Cause.STUCK, f"the robot was told to move {self.blocks} times and did not"
            )

    def wedged_in(self, advice: str = "") -> None:
        """Count that no path led out. advice: remedy for the message at the limit."""
        self.wedged += 1
        if self.wedged > MOST_WEDGED:
            x_m, y_m = self.robot.pose().xy
            raise TaskFailed(
                Cause.STUCK,
                f"the robot is wedged at ({x_m:.2f}, {y_m:.2f}) m: no way leads out of where it "
                f"stands, after {MOST_WEDGED} looks around" + (advice and f"; {advice}"),
            )

    def _see_jump(self, before: Pose2, after: Pose2, result: ActionResult) -> None:
        moved_m = before.distance_m(after.xy) - result.moved_m
        turned = abs(wrap_angle(after.yaw_rad - before.yaw_rad)) - abs(result.turned_rad)
        if moved_m <= JUMP_M and turned <= JUMP_RAD:
            return
        self.jumped = True
        self.jumps += 1
        if self.jumps > MOST_JUMPS:
            raise TaskFailed(
                Cause.SYSTEM_ERROR,
                f"the robot's localisation jumped {self.jumps} times, the last time by "
                f"{before.distance_m(after.xy):.1f} m; see what its pose comes from",
            )
