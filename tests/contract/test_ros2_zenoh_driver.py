"""The contract suite on the ROS 2 driver over plain Zenoh, without rclpy.

The robot here speaks our own reading of rmw_zenoh's format; no real one could be tried.
"""

from __future__ import annotations

import contextlib
import math
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import Any

import numpy as np
import zenoh
from helios_contract.rig import Rig
from helios_contract.suite import DriverContract
from helios_core.errors import Unavailable
from helios_core.geometry import (
    Pinhole,
    camera_on_base,
    quaternion_from_rotation,
    se2_to_se3,
)
from helios_examples.room import fits, look
from helios_ros2.driver import Ros2Driver
from helios_ros2.offered_qos import Qos
from helios_ros2.settings import Ros2Settings
from helios_ros2.zenoh_node import ZenohNode

from tests.ros2_processes import PATIENT
from tests.support import ENDS_WITHIN_S, free_port, wait_until

CAMERA = Pinhole(140, 140, 79.5, 59.5, 160, 120)
FRAME, HEIGHT_M, TILT_RAD, STEP_S = "camera_color_optical_frame", 1.2, 0.55, 0.02
TF = "tf2_msgs/msg/TFMessage"


class ZenohRobot:
    """A base with a camera; TF tells its mount, /tf its pose."""

    def __init__(self, router: str) -> None:
        self.x = self.y = self.yaw = self.v = self.w = self._command_s = 0.0
        self._last_s = time.monotonic()
        self._seen_from = (time.time_ns(), np.eye(4))  # stamp and pose of the base
        self.node = ros = ZenohNode("fake_robot", router)
        image, info = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"
        best = Qos(reliable=False)
        self._color = ros.publisher("/camera/color/image_raw", image, best, 5)
        self._depth = ros.publisher("/camera/aligned_depth_to_color/image_raw", image, best, 5)
        self._info = ros.publisher("/camera/color/camera_info", info, best, 5)
        self._tf = ros.publisher("/tf", TF, Qos(), 100)
        static = ros.publisher("/tf_static", TF, Qos(retained=True), 1)
        mount = camera_on_base(np.eye(4), HEIGHT_M, TILT_RAD)
        static.publish(self._transforms(time.time_ns(), "base_link", FRAME, mount))
        ros.subscribe("/cmd_vel", "geometry_msgs/msg/TwistStamped", self._on_twist, Qos(), 1)
        self._ended = threading.Event()
        for do, period_s in ((self._step, STEP_S), (self._film, 0.1)):
            threading.Thread(target=self._repeat, args=(do, period_s), daemon=True).start()

    def close(self) -> None:
        self._ended.set()
        self.node.close()

    def _repeat(self, do: Any, period_s: float) -> None:
        with contextlib.suppress(zenoh.ZError):  # the session ends first
            while not self._ended.wait(period_s):
                do()

    def _on_twist(self, message: Any) -> None:
        self.v, self.w = message.twist.linear.x, message.twist.angular.z
        self._command_s = time.monotonic()

    def _step(self) -> None:
        now_s, ns = time.monotonic(), time.time_ns()
        passed_s, self._last_s = now_s - self._last_s, now_s
        if now_s - self._command_s > 0.5:
            self.v = self.w = 0.0
        x = self.x + self.v * math.cos(self.yaw) * passed_s
        y = self.y + self.v * math.sin(self.yaw) * passed_s
        self.yaw += self.w * passed_s
        if fits(x, y, 0.25):
            self.x, self.y = x, y
        base = se2_to_se3(self.x, self.y, self.yaw)
        self._seen_from = (ns, base)
        self._tf.publish(self._transforms(ns, "odom", "base_link", base))

    def _film(self) -> None:
        ns, base = self._seen_from
        header = self._header(ns, FRAME)
        color, depth_m = look(CAMERA, camera_on_base(base, HEIGHT_M, TILT_RAD))
        image = self.node.interface("sensor_msgs/msg/Image")
        for publisher, pixels, encoding in (
            (self._color, color, "rgb8"),
            (self._depth, depth_m, "32FC1"),
        ):
            data = np.frombuffer(np.ascontiguousarray(pixels).tobytes(), np.uint8)
            publisher.publish(
                image(
                    header=header,
                    height=120,
                    width=160,
                    encoding=encoding,
                    step=pixels.strides[0],
                    data=data,
                )
            )
        info = self.node.interface("sensor_msgs/msg/CameraInfo")
        k = CAMERA.matrix.ravel()
        self._info.publish(
            info(header=header, height=120, width=160, distortion_model="plumb_bob", d=[], k=k)
        )

    def _header(self, ns: int, frame: str) -> Any:
        header = self.node.interface("std_msgs/msg/Header")(frame_id=frame)
        header.stamp.sec, header.stamp.nanosec = divmod(ns, 10**9)
        return header

    def _transforms(self, ns: int, parent: str, child: str, T: np.ndarray) -> Any:
        one = self.node.interface("geometry_msgs/msg/TransformStamped")(
            header=self._header(ns, parent), child_frame_id=child
        )
        t, q = one.transform.translation, one.transform.rotation
        t.x, t.y, t.z = (float(v) for v in T[:3, 3])
        q.x, q.y, q.z, q.w = quaternion_from_rotation(T[:3, :3])
        return self.node.interface(TF)(transforms=[one])


class TestZenoh(DriverContract):
    """The driver without rclpy."""

    @classmethod
    @contextmanager
    def stand(cls) -> Iterator[Rig]:
        router = f"tcp/127.0.0.1:{free_port()}"
        argv = [sys.executable, "-m", "helios_core.router", "--listen", router]
        with subprocess.Popen(argv, env=os.environ | {"ROS_DOMAIN_ID": "0"}) as process:
            try:
                with closing(connected(router)) as robot:
                    assert robot is not None
                    settings = Ros2Settings(
                        transport="zenoh", zenoh_router=router, pose="tf", **PATIENT
                    )
                    with closing(Ros2Driver(settings)) as driver:
                        wait_until(lambda: described(driver), 60, "the robot is described")
                        yield Rig(driver, tolerance_m=0.05)
            finally:
                process.terminate()
                process.wait(ENDS_WITHIN_S)


def connected(router: str) -> ZenohRobot:
    robots: list[ZenohRobot] = []

    def connects() -> bool:
        try:
            robots.append(ZenohRobot(router))
        except Unavailable:
            return False
        return True

    wait_until(connects, 60, "the router is up")
    return robots[0]


def described(driver: Ros2Driver) -> bool:
    try:
        return driver.describe().camera == CAMERA
    except Unavailable:
        return False
