"""Checks of helios_ros2 that need rclpy, as programs that print JSON.

python -m tests.ros2_checks messages        messages of `ros_messages`, serialised and read again
python -m tests.ros2_checks earlier_goal    a goal of a dead node, and a driver that starts after it
python -m tests.ros2_checks end             seconds in which the output ends while a map hangs
"""

from __future__ import annotations

import json
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from helios_core import proto as pb
from helios_core.geometry import se2_to_se3
from helios_core.health import Health
from helios_core.map_snapshot import MapView
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import SNAPSHOT
from helios_core.types import FrameId
from helios_ros2 import map_arrays, ros_messages
from helios_ros2.rclpy_loading import has_interface, interface, rclpy_module
from helios_ros2.ros_node import RosNode
from helios_ros2.settings import Ros2Settings

from tests.ros2_processes import PATIENT

WITHIN_S = 60.0
DETECTIONS = "vision_msgs/msg/Detection3DArray"
CLASSES = ("mug", "chair", "table", "sofa", "lamp", "can", "book", "bowl")
FAR_RAD = 100.0  # of the turn of the dead node: it lasts longer than the check


def wait_until(condition: Callable[[], object]) -> None:
    end_s = time.monotonic() + WITHIN_S
    while not condition():
        assert time.monotonic() < end_s, "it never came true"
        time.sleep(0.02)


def messages() -> dict[str, Any]:
    """Names of the messages that can go over the wire; colours of the markers before and after."""
    view = MapView(
        1, FrameId("", 0, 1), "", 0.05, (0.0, 0.0), np.zeros((3, 4), np.int8),
        np.zeros((3, 4), bool), np.zeros((3, 4), np.float32), {}, (), (0.0, 0.0, 0.0),
        np.zeros((0, 2), np.float32), 0.0, 0.0,
    )  # fmt: skip
    side = pb.Vector3(x=1, y=2, z=1)
    objects = [
        pb.ObjectInstance(id=i, class_name=name, score=1, center_m=side, size_m=side)
        for i, name in enumerate(CLASSES, 1)
    ]
    points = map_arrays.cloud(pb.GaussiansReply())
    status = pb.ServiceStatus(service="map2d", state="ready", metrics={"a": 1})
    made = [
        ros_messages.markers(objects, "map"),
        ros_messages.grid(view, view.occupancy, 1, "map"),
        ros_messages.picture(np.zeros((2, 3, 3), np.uint8), 1, "map"),
        ros_messages.path([(0, 0), (1, 0)], 1, "map"),
        ros_messages.point_cloud(points, 1, "map"),
        ros_messages.diagnostics([(status, 0.0), (status, 9.0)], 1),
        ros_messages.transform("map", "odom", se2_to_se3(1.0, 2.0, 0.5), 1),
    ]
    if has_interface(DETECTIONS):
        made.append(ros_messages.detections(objects, 1, "map"))
    wire = rclpy_module("serialization")
    read = [wire.deserialize_message(wire.serialize_message(m), type(m)) for m in made]
    colors = [
        [[m.color.r, m.color.g, m.color.b, m.color.a] for m in array.markers]
        for array in (made[0], read[0])
    ]
    return {"names": [type(m).__name__ for m in read], "colors": colors}


def earlier_goal() -> dict[str, Any]:
    """Whether the goal of a node that died was accepted, and the largest change of the base's
    matrix in the half second after a driver's start. Needs `tests.fake_ros2 --nav2`."""
    from helios_ros2.driver import Ros2Driver

    dead, spin = RosNode("dead"), interface("nav2_msgs/action/Spin")
    dead.start()
    client = rclpy_module("action").ActionClient(dead.node, spin, "spin")
    wait_until(client.server_is_ready)
    goal = spin.Goal(target_yaw=FAR_RAD)
    goal.time_allowance.sec = int(FAR_RAD)
    sent = client.send_goal_async(goal)
    wait_until(sent.done)
    dead.close()
    settings = Ros2Settings(pose="topic", camera_tilt_rad=0.55, motion="nav2", **PATIENT)
    driver = Ros2Driver(settings)
    try:
        wait_until(lambda: _described(driver))
        before = driver.state().T_world_base
        time.sleep(0.5)
        after = driver.state().T_world_base
    finally:
        driver.close()
    turned = float(np.abs(after - before).max())
    return {"accepted": sent.result().accepted, "turned_after_the_start": turned}


def _described(driver: Any) -> bool:
    from helios_core.errors import Unavailable

    try:
        return driver.describe() is not None
    except Unavailable:
        return False


def end() -> dict[str, Any]:
    from helios_ros2.output_service import OutputService

    hub, asked, answer = MemoryHub(), threading.Event(), threading.Event()

    def hang(_: pb.SnapshotRequest) -> pb.MapSnapshot:
        asked.set()
        answer.wait(WITHIN_S)
        return pb.MapSnapshot()

    MemoryBus(hub).serve(SNAPSHOT, hang)
    service = OutputService(MemoryBus(hub), Ros2Settings(frame="map", map_period_s=0.05), Health())
    assert asked.wait(WITHIN_S), "the map was not asked"
    began_s = time.monotonic()
    service.close()
    took_s = time.monotonic() - began_s
    answer.set()
    return {"seconds": took_s}


if __name__ == "__main__":
    checks = {check.__name__: check for check in (messages, earlier_goal, end)}
    print(json.dumps(checks[sys.argv[1]]()))
