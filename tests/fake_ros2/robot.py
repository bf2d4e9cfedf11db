"""Body, clock, camera and topics of the fake ROS 2 robot. Its room is that of helios_examples."""

from __future__ import annotations

import argparse
import array
import math
import threading
import time
from typing import Any

import numpy as np
from geometry_msgs.msg import TransformStamped, Twist, TwistStamped
from helios_core.geometry import (
    Matrix,
    Pinhole,
    camera_on_base,
    quaternion_from_rotation,
    se2_to_se3,
)
from helios_examples.room import fits, look
from nav_msgs.msg import Odometry
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import BatteryState, CameraInfo, Image, JointState
from trajectory_msgs.msg import JointTrajectory

HEIGHT_M, TILT_RAD, RADIUS_M = 1.2, 0.55, 0.25
STEP_S, WATCHDOG_S = 0.02, 0.5
ASIDE_M = 0.05  # of the depth camera, to the left of the colour camera
OPTICAL, DEPTH_OPTICAL = "camera_color_optical_frame", "camera_depth_optical_frame"
TILT_JOINT = "head_tilt_joint"


class FakeRobot:
    """A round base with a camera; everything runs in timers and one camera thread."""

    def __init__(self, node: Node, options: argparse.Namespace) -> None:
        self.node, self.o = node, options
        width, height = map(int, options.size.split("x"))
        self.camera = Pinhole(
            0.875 * width, 0.875 * width, (width - 1) / 2, (height - 1) / 2, width, height
        )
        self._began_s = self._last_s = time.monotonic()
        self._clock_rate = options.clock_rate or 1.0
        self._clock_start_ns = (
            round(options.clock_start * 1e9) if options.clock_rate else time.time_ns()
        )
        self.x = self.y = self.yaw = 0.0
        self.v = self.w = self._command_s = 0.0
        self.tilt = self._tilt_goal = TILT_RAD
        # stamp of the newest motion step, and x, y, yaw and tilt then
        self._seen_from = (self.now_ns(self._began_s), (0.0, 0.0, 0.0, TILT_RAD))
        self._drawn: Any = None
        self.group = ReentrantCallbackGroup()
        self._make_topics()
        one_at_a_time = MutuallyExclusiveCallbackGroup()
        node.create_timer(STEP_S, self._step, callback_group=one_at_a_time)
        threading.Thread(target=self._film, daemon=True).start()

    def now_ns(self, now_s: float) -> int:
        """Time of the robot's own clock at a time of `time.monotonic`."""
        return self._clock_start_ns + int((now_s - self._began_s) * self._clock_rate * 1e9)

    @property
    def T_world_base(self) -> Matrix:
        return se2_to_se3(self.x, self.y, self.yaw)

    def halt(self) -> None:
        self.v = self.w = 0.0

    def command(self, v: float, w: float) -> None:
        self.v, self.w, self._command_s = v, w, time.monotonic()

    # --- topics -------------------------------------------------------------------------------
    def _make_topics(self) -> None:
        node, o = self.node, self.o
        images = QoSProfile(
            depth=5,
            reliability=ReliabilityPolicy.BEST_EFFORT
            if o.best_effort
            else ReliabilityPolicy.RELIABLE,
        )
        depth = "depth" if o.unaligned else "aligned_depth_to_color"
        make = node.create_publisher
        self._color = make(Image, "/camera/color/image_raw", images)
        self._color_info = make(CameraInfo, "/camera/color/camera_info", images)
        self._depth = make(Image, f"/camera/{depth}/image_raw", images)
        self._depth_info = make(CameraInfo, f"/camera/{depth}/camera_info", images)
        self._odom = None if o.no_odom else make(Odometry, "/odom", 10)
        self._clock = make(Clock, "/clock", 10) if o.clock_rate else None
        kind = TwistStamped if o.stamped else Twist
        node.create_subscription(kind, "/cmd_vel", self._on_twist, 10, callback_group=self.group)
        self._joints = None
        if o.tilt:
            self._joints = make(JointState, "/joint_states", 10)
            node.create_subscription(
                JointTrajectory, "/head_controller/joint_trajectory", self._on_trajectory, 10
            )
        self._battery = None if o.battery is None else make(BatteryState, "/battery_state", 1)
        self._tf = None
        if o.tf:
            from tf2_msgs.msg import TFMessage

            kept = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
            self._tf_message = TFMessage
            self._tf = make(TFMessage, "/tf", 100)
            self._tf_static = make(TFMessage, "/tf_static", kept)
            self._tf_static.publish(TFMessage(transforms=self._static_transforms()))

    def _on_twist(self, message: Any) -> None:
        twist = message.twist if self.o.stamped else message
        self.command(twist.linear.x, twist.angular.z)

    def _on_trajectory(self, message: JointTrajectory) -> None:
        self._tilt_goal = message.points[-1].positions[0]

    def _static_transforms(self) -> list[TransformStamped]:
        aside = np.eye(4)
        aside[0, 3] = -ASIDE_M  # x of the optical frame is to the right
        ns = self._clock_start_ns
        out = [self._transform(ns, OPTICAL, DEPTH_OPTICAL, aside)]
        if not self.o.tilt:
            out.append(self._transform(ns, "base_footprint", OPTICAL, self._T_base_cam()))
        return out

    def _T_base_cam(self) -> Matrix:
        return camera_on_base(np.eye(4), HEIGHT_M, self.tilt)

    def _transform(self, ns: int, parent: str, child: str, T: Matrix) -> TransformStamped:
        out = TransformStamped(child_frame_id=child)
        self._stamp(out.header, ns, parent)
        t, q = out.transform.translation, out.transform.rotation
        t.x, t.y, t.z = (float(v) for v in T[:3, 3])
        q.x, q.y, q.z, q.w = quaternion_from_rotation(T[:3, :3])
        return out

    # --- body ---------------------------------------------------------------------------------
    def _step(self) -> None:
        now_s = time.monotonic()
        passed_s = (now_s - self._last_s) * self._clock_rate
        self._last_s = now_s
        if now_s - self._command_s > WATCHDOG_S:
            self.halt()
        x = self.x + self.v * math.cos(self.yaw) * passed_s
        y = self.y + self.v * math.sin(self.yaw) * passed_s
        self.yaw += self.w * passed_s
        if fits(x, y, RADIUS_M):
            self.x, self.y = x, y
        self.tilt += max(-0.02, min(0.02, self._tilt_goal - self.tilt))
        ns = self.now_ns(now_s)
        self._seen_from = (ns, (self.x, self.y, self.yaw, self.tilt))
        self._tell(ns)

    def _tell(self, ns: int) -> None:
        if self._odom is not None:
            out = Odometry(child_frame_id="base_footprint")
            self._stamp(out.header, ns, "odom")
            p, q = out.pose.pose.position, out.pose.pose.orientation
            p.x, p.y = self.x, self.y
            q.z, q.w = math.sin(self.yaw / 2), math.cos(self.yaw / 2)
            out.twist.twist.linear.x, out.twist.twist.angular.z = self.v, self.w
            self._odom.publish(out)
        if self._tf is not None:
            moving = [self._transform(ns, "odom", "base_footprint", self.T_world_base)]
            if self.o.tilt:
                moving.append(self._transform(ns, "base_footprint", OPTICAL, self._T_base_cam()))
            self._tf.publish(self._tf_message(transforms=moving))
        if self._joints is not None:
            joints = JointState(name=["wheel", TILT_JOINT], position=[0.0, self.tilt])
            self._stamp(joints.header, ns, "")
            self._joints.publish(joints)
        if self._battery is not None:
            self._battery.publish(BatteryState(percentage=self.o.battery))
        if self._clock is not None:
            clock = Clock()
            clock.clock.sec, clock.clock.nanosec = divmod(ns, 10**9)
            self._clock.publish(clock)

    # --- camera -------------------------------------------------------------------------------
    def _film(self) -> None:
        due_s, last_ns = time.monotonic(), 0
        while self.node.context.ok():
            ns, at = self._seen_from
            if ns == last_ns:  # under load a step may take longer than an image
                time.sleep(STEP_S / 4)
                continue
            last_ns = ns
            color, depth_m = self._seen(at)
            self._publish_image(self._color, self._color_info, color, "rgb8", ns, OPTICAL)
            if self.o.depth == "16UC1":
                depth_m = np.rint(depth_m * 1000).astype(np.uint16)
            frame = DEPTH_OPTICAL if self.o.unaligned else OPTICAL
            self._publish_image(self._depth, self._depth_info, depth_m, self.o.depth, ns, frame)
            due_s = max(due_s + 1 / self.o.hz, time.monotonic() - 0.5)
            time.sleep(max(0.0, due_s - time.monotonic()))

    def _seen(self, at: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
        if self._drawn is not None and self._drawn[0] == at and self.o.still:
            return self._drawn[1]
        x, y, yaw, tilt = at
        T_world_cam = camera_on_base(se2_to_se3(x, y, yaw), HEIGHT_M, tilt)
        color, depth_m = look(self.camera, T_world_cam)
        if self.o.unaligned:
            aside = np.eye(4)
            aside[0, 3] = -ASIDE_M
            _, depth_m = look(self.camera, T_world_cam @ aside)
        self._drawn = (at, (color, depth_m))
        return color, depth_m

    def _publish_image(
        self, images: Any, infos: Any, pixels: np.ndarray, encoding: str, ns: int, frame: str
    ) -> None:
        c = self.camera
        out = Image(height=c.height, width=c.width, encoding=encoding, step=pixels.strides[0])
        out.data = array.array("B", np.ascontiguousarray(pixels).tobytes())
        self._stamp(out.header, ns, frame)
        images.publish(out)
        info = CameraInfo(height=c.height, width=c.width, distortion_model="plumb_bob", d=[0.0] * 5)
        info.k = c.matrix.ravel().tolist()
        self._stamp(info.header, ns, frame)
        infos.publish(info)

    @staticmethod
    def _stamp(header: Any, ns: int, frame: str) -> None:
        header.stamp.sec, header.stamp.nanosec = divmod(int(ns), 10**9)
        header.frame_id = frame
