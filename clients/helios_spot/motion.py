"""Standing, walking and arm motions: sent, monitored, and ended by any halt condition.

A walk command expires after `command_s`, and `walk` renews it four times in that period. So the
robot stops if this program, the network or the computer fails.
"""

from __future__ import annotations

import logging
import time
from typing import Any

import numpy as np
from helios_core.errors import DeadlineExceeded, HeliosError
from helios_core.geometry import Matrix

from helios_spot import bosdyn_api
from helios_spot.frame_transforms import FLAT_BODY, VISION
from helios_spot.halt_conditions import Halt, Halted
from helios_spot.robot_connection import RobotConnection
from helios_spot.waypoints import Waypoint, between, reached, time_allowed_s

log = logging.getLogger(__name__)

POLL_S = 0.05
STAND_S = 12.0
PROGRESS_M, PROGRESS_RAD = 0.02, 0.02  # a smaller motion counts as standing still
MOST_ARM_S = 20.0


class CannotDo(Exception):
    """Raised when the robot could not complete an action; one sentence."""


class Motion:
    """Motions of one robot's legs and arm. For one thread, except `stop`."""

    def __init__(self, link: RobotConnection, halt: Halt) -> None:
        self._link, self._halt, self._s = link, halt, link.settings
        self._build = bosdyn_api.robot_command.RobotCommandBuilder

    def stop(self) -> None:
        """Stop the robot at once. Raises HeliosError when it does not receive the command."""
        self._link.command(self._build.stop_command(), "stop")

    def stop_if_heard(self) -> bool:
        """Stop the robot; False if it did not receive this. Its command then expires by itself."""
        try:
            self.stop()
        except HeliosError as error:
            log.warning("the robot did not take the stop: %s", error.message)
            return False
        return True

    def stand(self) -> None:
        """Stand up. Raises CannotDo."""
        done = bosdyn_api.basic_command_pb2.StandCommand.Feedback.STATUS_IS_STANDING
        id = self._send(self._build.synchro_stand_command(), "stand up")
        end = time.monotonic() + STAND_S
        while time.monotonic() < end:
            mobility = self._feedback(id, "stand up").mobility_command_feedback
            if mobility.stand_feedback.status == done:
                return
            self._halt.rest(POLL_S)
        self.stop()
        raise CannotDo(f"the robot did not stand within {STAND_S:g} s; look at it")

    def walk(self, start: Waypoint, goal: Waypoint) -> None:
        """Walk to a waypoint at bounded speed. Raises CannotDo when blocked."""
        stopped = bosdyn_api.basic_command_pb2.SE2TrajectoryCommand.Feedback.STATUS_STOPPED
        command = self._build.synchro_se2_trajectory_point_command(
            goal.x_m, goal.y_m, goal.yaw_rad, VISION, params=self._mobility()
        )
        end = time.monotonic() + time_allowed_s(start, goal, self._s.speed_m_s, self._s.turn_rad_s)
        renew_s, last, last_s = 0.0, start, time.monotonic()
        id = 0
        while time.monotonic() < end:
            if time.monotonic() >= renew_s:
                renew_s = time.monotonic() + self._s.command_s / 4
                id = self._send(command, "walk", self._s.command_s)
            at_end = self._trajectory(id).status == stopped
            here = Waypoint.of(self._link.read().T_world_base)
            if at_end and reached(goal, here):
                return
            moved_m, turned_rad = between(last, here)
            if moved_m > PROGRESS_M or abs(turned_rad) > PROGRESS_RAD:
                last, last_s = here, time.monotonic()
            elif time.monotonic() - last_s > self._s.blocked_s:
                break
            self._halt.rest(POLL_S)
        self.stop()
        moved_m, _ = between(start, Waypoint.of(self._link.read().T_world_base))
        raise CannotDo(f"blocked after {moved_m:.2f} m; look, and go another way")

    def hand_to(self, T_frame_hand: Matrix, frame: str, from_m: float, what: str) -> None:
        """Move the hand to a pose in a frame. from_m: its distance, which sets the duration.

        Raises CannotDo.
        """
        m = bosdyn_api.math_helpers.SE3Pose.from_matrix(np.asarray(T_frame_hand))
        seconds = max(1.0, from_m / self._s.arm_m_s)
        command = self._build.arm_pose_command_from_pose(m.to_proto(), frame, seconds=seconds)
        cartesian = command.synchronized_command.arm_command.arm_cartesian_command
        cartesian.max_linear_velocity.value = self._s.arm_m_s
        cartesian.max_angular_velocity.value = self._s.arm_rad_s
        self._arm(command, what)

    def look_from(self, T_flat_hand: Matrix) -> None:
        """Hold the hand in a pose relative to the body, also while walking."""
        self.hand_to(T_flat_hand, FLAT_BODY, 1.0, "raise the hand to look")

    def gaze(self, point_vision_m: Matrix) -> None:
        """Open the hand and turn it towards a point of the vision frame."""
        x, y, z = (float(v) for v in point_vision_m)
        command = self._build.arm_gaze_command(
            x,
            y,
            z,
            VISION,
            build_on_command=self._build.claw_gripper_open_command(),
            max_linear_vel=self._s.arm_m_s,
            max_angular_vel=self._s.arm_rad_s,
        )
        self._arm(command, "look at it with the hand")

    def grip(self, open: bool) -> None:
        """Open or close the claw."""
        build = self._build
        command = build.claw_gripper_open_command() if open else build.claw_gripper_close_command()
        self._send(command, "move the gripper")

    def stow(self) -> None:
        """Fold the arm. Raises CannotDo."""
        self._arm(self._build.arm_stow_command(), "stow the arm")

    def _arm(self, command: Any, what: str) -> None:
        id = self._send(command, what)
        end = time.monotonic() + MOST_ARM_S
        while time.monotonic() < end:
            done = arm_done(self._feedback(id, what).arm_command_feedback)
            if done is not None:
                if done:
                    return
                raise CannotDo(f"the arm could not {what}: it stalled; try from another place")
            self._halt.rest(POLL_S)
        self.stop()
        raise CannotDo(f"the arm could not {what} within {MOST_ARM_S:g} s; try another place")

    def _send(self, command: Any, what: str, end_s: float | None = None) -> int:
        """Send a command; return its id. If a halt occurs meanwhile, send a stop after it."""
        self._halt.check()
        id = self._link.command(command, what, end_s)
        self.check_after_command()
        return id

    def check_after_command(self) -> None:
        """Send a stop if a halt came while a command was sent: it may have arrived first. Raises
        Halted then."""
        try:
            self._halt.check()
        except Halted:
            self.stop_if_heard()
            raise

    def _feedback(self, id: int, what: str) -> Any:
        return self._link.feedback(id, what).synchronized_feedback

    def _trajectory(self, id: int) -> Any:
        mobility = self._feedback(id, "walk").mobility_command_feedback
        if (
            mobility.status
            == bosdyn_api.basic_command_pb2.RobotCommandFeedbackStatus.STATUS_ROBOT_FROZEN
        ):
            raise DeadlineExceeded("cannot walk: the robot is frozen; look at it")
        return mobility.se2_trajectory_feedback

    def _mobility(self) -> Any:
        params = self._build.mobility_params()
        limit = params.vel_limit
        speed, turn = self._s.speed_m_s, self._s.turn_rad_s
        limit.max_vel.linear.x = limit.max_vel.linear.y = speed
        limit.max_vel.angular = turn
        limit.min_vel.linear.x = limit.min_vel.linear.y = -speed
        limit.min_vel.angular = -turn
        params.obstacle_params.obstacle_avoidance_padding = self._s.obstacle_padding_m
        return params


def arm_done(feedback: Any) -> bool | None:
    """True if the arm has arrived, False if it stalled or was cancelled, None while it moves."""
    kind = feedback.WhichOneof("feedback")
    if kind is None:
        return None
    a, status = bosdyn_api.arm_command_pb2, getattr(feedback, kind).status
    cartesian = a.ArmCartesianCommand.Feedback
    gaze, named = a.GazeCommand.Feedback, a.NamedArmPositionsCommand.Feedback
    there = {
        "arm_cartesian_feedback": (cartesian.STATUS_TRAJECTORY_COMPLETE,),
        "arm_gaze_feedback": (gaze.STATUS_TRAJECTORY_COMPLETE,),
        "named_arm_position_feedback": (named.STATUS_COMPLETE,),
    }
    stuck = {
        "arm_cartesian_feedback": (
            cartesian.STATUS_TRAJECTORY_STALLED,
            cartesian.STATUS_TRAJECTORY_CANCELLED,
        ),
        "arm_gaze_feedback": (gaze.STATUS_TOOL_TRAJECTORY_STALLED,),
        "named_arm_position_feedback": (named.STATUS_STALLED_HOLDING_ITEM,),
    }
    if status in there.get(kind, ()):
        return True
    return False if status in stuck.get(kind, ()) else None
