"""Action services of the fake Spot: robot commands and grasps."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np

from tests.fake_spot import pb
from tests.fake_spot.body import STOWED, Array, looking_at, pose
from tests.fake_spot.right import Leases
from tests.fake_spot.world import GROUND_IN_VISION_M, Walk, World

T_WORLD_VISION = pose((0.0, 0.0, -GROUND_IN_VISION_M))
HALF_OPEN_RAD = 1.5708


class Commands(pb.servicer("RobotCommandService")):
    def __init__(self, world: World, leases: Leases) -> None:
        self._w, self._leases = world, leases
        self.late_s = 0.0  # delay from send to arrival of a command with an end time
        self.asked = 0  # number of requests for command feedback
        self._ids = itertools.count(1)
        self._arm_ok: dict[int, bool] = {}
        self._kinds: dict[int, str] = {}

    def RobotCommand(self, request: Any, _: Any) -> Any:
        reply = pb.robot_command.RobotCommandResponse()
        w = self._w
        with w.lock:
            w.step()
            if self._leases.use(request.lease, reply.lease_use_result):
                reply.status = self._do(request.command, reply)
        return pb.answer(reply, request, w.robot_ns)

    def RobotCommandFeedback(self, request: Any, _: Any) -> Any:
        reply = pb.robot_command.RobotCommandFeedbackResponse()
        w, id = self._w, request.robot_command_id
        self.asked += 1
        processing = pb.basic.RobotCommandFeedbackStatus.STATUS_PROCESSING
        reported = reply.feedback.synchronized_feedback
        legs, arm = reported.mobility_command_feedback, reported.arm_command_feedback
        legs.status = arm.status = processing
        with w.lock:
            w.step()
            kind = self._kinds.get(id, "")
            if kind in w.endless:
                pass
            elif kind == "se2_trajectory_request":
                status = pb.basic.SE2TrajectoryCommand.Feedback
                done = w.walk is None or w.at_goal()
                legs.se2_trajectory_feedback.status = (
                    status.STATUS_STOPPED if done else status.STATUS_IN_PROGRESS
                )
            elif kind == "stand_request":
                done = pb.basic.StandCommand.Feedback.STATUS_IS_STANDING
                legs.stand_feedback.status = done
            elif kind == "arm_gaze_command":
                status = pb.arm.GazeCommand.Feedback
                arm.arm_gaze_feedback.status = status.STATUS_TRAJECTORY_COMPLETE
            elif kind == "arm_cartesian_command":
                status = pb.arm.ArmCartesianCommand.Feedback
                arm.arm_cartesian_feedback.status = (
                    status.STATUS_TRAJECTORY_COMPLETE
                    if self._arm_ok.get(id)
                    else status.STATUS_TRAJECTORY_STALLED
                )
            elif kind == "named_arm_position_command":
                status = pb.arm.NamedArmPositionsCommand.Feedback
                arm.named_arm_position_feedback.status = status.STATUS_COMPLETE
        return pb.answer(reply, request, w.robot_ns)

    def _do(self, command: Any, reply: Any) -> int:
        w = self._w
        if not w.motors:
            return reply.STATUS_NOT_POWERED_ON
        id = next(self._ids)
        reply.robot_command_id = id
        if command.WhichOneof("command") == "full_body_command":
            w.halt("a stop command")
            w.log.append("stop")
            return reply.STATUS_OK
        both = command.synchronized_command
        if both.HasField("mobility_command"):
            refused = self._legs(both.mobility_command, reply, id)
            if refused is not None:
                return refused
        if both.HasField("gripper_command"):
            claw = both.gripper_command.claw_gripper_command
            w.grip(min(1.0, abs(claw.trajectory.points[-1].point) / HALF_OPEN_RAD))
        if both.HasField("arm_command"):
            self._arm(both.arm_command, id)
        return reply.STATUS_OK

    def _legs(self, mobility: Any, reply: Any, id: int) -> int | None:
        w, kind = self._w, mobility.WhichOneof("command")
        self._kinds[id] = kind
        if kind in ("stand_request", "sit_request", "stop_request"):
            w.halt(kind)
            w.standing = kind != "sit_request" and (w.standing or kind == "stand_request")
            return None
        asked = getattr(mobility, kind)
        end_ns = asked.end_time.ToNanoseconds()
        if end_ns <= w.robot_ns + self.late_s * 1e9:
            w.log.append("expired")
            return int(reply.STATUS_EXPIRED)
        params = pb.spot_command.MobilityParams()
        mobility.params.Unpack(params)
        speed = params.vel_limit.max_vel.linear.x or 1.6
        turn = params.vel_limit.max_vel.angular or 2.0
        w.fastest, w.fastest_turn = max(w.fastest, speed), max(w.fastest_turn, turn)
        w.standing = True
        w.log.append("walk")
        if kind == "se2_trajectory_request":
            if asked.se2_frame_name not in ("vision", "odom"):
                return int(reply.STATUS_UNKNOWN_FRAME)
            goal = asked.trajectory.points[-1].pose
            w.walk = Walk(
                w.local_s(end_ns), speed, turn, (goal.position.x, goal.position.y, goal.angle)
            )
        else:
            v = asked.velocity
            w.walk = Walk(
                w.local_s(end_ns),
                speed,
                turn,
                velocity=(v.linear.x, v.linear.y, v.angular),
            )
        return None

    def _arm(self, arm: Any, id: int) -> None:
        w, kind = self._w, arm.WhichOneof("command")
        self._kinds[id] = kind
        if kind == "named_arm_position_command":
            w.T_flat_hand, w.stowed = STOWED.copy(), True
        elif kind == "arm_gaze_command":
            asked = arm.arm_gaze_command
            p = asked.target_trajectory_in_frame1.points[-1].point
            self._bounded(asked)
            target = np.linalg.inv(w.T_world_body) @ T_WORLD_VISION @ [p.x, p.y, p.z, 1.0]
            if w.stowed:
                w.reach(pose((0.5, 0.0, 0.35)))
            turned = w.T_flat_hand.copy()
            turned[:3, :3] = looking_at(turned[:3, 3], target[:3])
            w.reach(turned)
        elif kind == "arm_cartesian_command":
            asked = arm.arm_cartesian_command
            self._bounded(asked)
            T = pb.math_helpers.SE3Pose.from_proto(
                asked.pose_trajectory_in_task.points[-1].pose
            ).to_matrix()
            if asked.root_frame_name == "vision":
                T = np.linalg.inv(w.T_world_body) @ T_WORLD_VISION @ T
            self._arm_ok[id] = w.reach(T)

    def _bounded(self, asked: Any) -> None:
        """Record how fast the hand may move; a missing bound counts as infinite."""
        w = self._w
        linear = asked.max_linear_velocity.value or math.inf
        angular = asked.max_angular_velocity.value or math.inf
        w.fastest_hand, w.fastest_wrist = (
            max(w.fastest_hand, linear),
            max(w.fastest_wrist, angular),
        )


class Manipulation(pb.servicer("ManipulationApiService")):
    """Casts the pixel's ray with the camera and frames of the request."""

    def __init__(self, world: World, leases: Leases) -> None:
        self._w, self._leases = world, leases
        self._ids = itertools.count(1000)
        self._states: dict[int, list[str]] = {}

    def ManipulationApi(self, request: Any, _: Any) -> Any:
        reply = pb.manipulation.ManipulationApiResponse()
        w = self._w
        with w.lock:
            if self._leases.use(request.lease, reply.lease_use_result):
                id = next(self._ids)
                reply.manipulation_cmd_id = id
                self._states[id] = [
                    "MANIP_STATE_SEARCHING_FOR_GRASP",
                    "MANIP_STATE_MOVING_TO_GRASP",
                    w.grasp_along(*self._ray(request.pick_object_in_image)),
                ]
        return pb.answer(reply, request, w.robot_ns)

    def ManipulationApiFeedback(self, request: Any, _: Any) -> Any:
        states = self._states[request.manipulation_cmd_id]
        name = states.pop(0) if len(states) > 1 else states[0]
        reply = pb.manipulation.ManipulationApiFeedbackResponse(
            manipulation_cmd_id=request.manipulation_cmd_id,
            current_state=pb.manipulation.ManipulationFeedbackState.Value(name),
        )
        return pb.answer(reply, request, self._w.robot_ns)

    def _ray(self, pick: Any) -> tuple[Array, Array]:
        T_vision_cam = pb.frame_helpers.get_a_tform_b(
            pick.transforms_snapshot_for_camera, "vision", pick.frame_name_image_sensor
        ).to_matrix()
        k = pick.camera_model.intrinsics
        x = (pick.pixel_xy.x - k.principal_point.x) / k.focal_length.x
        y = (pick.pixel_xy.y - k.principal_point.y) / k.focal_length.y
        T = T_WORLD_VISION @ T_vision_cam
        ray = T[:3, :3] @ np.array([x, y, 1.0])
        return T[:3, 3], ray / math.sqrt(float(ray @ ray))
