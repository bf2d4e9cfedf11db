"""Output to ROS: what HELIOS' bus says, as topics that RViz, Foxglove and other nodes understand.

Maps are asked for in one thread, at most once per `map_period_s`; each publication also reaches
nodes that start later. Missing answers are counted; without a map the others go on.
"""

from __future__ import annotations

import logging
import threading
import time
from typing import Any, TypeVar

import numpy as np
from google.protobuf.message import Message
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.codec import transform_from_proto
from helios_core.errors import HeliosError, InvalidInput
from helios_core.health import Health
from helios_core.topics import (
    ANY_STATUS,
    GAUSSIANS,
    OBJECTS,
    PLAN,
    ROBOT_DESCRIPTION,
    ROBOT_STATE,
    SNAPSHOT,
    Method,
)

from helios_ros2 import map_arrays, ros_messages
from helios_ros2.map_output import PATH, MapOutput
from helios_ros2.offered_qos import Qos
from helios_ros2.rclpy_loading import has_interface, interface
from helios_ros2.robot_input import TF_MESSAGE
from helios_ros2.ros_node import RosNode, qos_profile
from helios_ros2.settings import Ros2Settings
from helios_ros2.task_interface import TaskInterface

log = logging.getLogger(__name__)

CALL_S = 3.0
END_WITHIN_S = 0.5  # wait for the thread of the maps; a process has 2 s for its whole end
DEFAULT_RADIUS_M = 0.25  # of the costmap before the robot's description is known
DETECTIONS = "vision_msgs/msg/Detection3DArray"
THREADS = 3
Req = TypeVar("Req", bound=Message)
Rep = TypeVar("Rep", bound=Message)


class OutputService:
    """Publishers of one robot: see the module."""

    def __init__(self, bus: Bus, settings: Ros2Settings, health: Health) -> None:
        """Raises InvalidInput without rclpy, or for an output that it cannot make."""
        self._bus, self._s, self._health = bus, settings, health
        self._frame = settings.frame or settings.world_frame  # empty: the robot's driver tells it
        if settings.publish_tf == "odom" and self._frame == "odom":
            raise InvalidInput(
                "publish_tf = odom publishes that `frame` and odom are the same, but frame is "
                "odom: name another frame, or set HELIOS_ROS2_PUBLISH_TF=none"
            )
        self._radius_m = DEFAULT_RADIUS_M
        # service -> its newest status, and when that came, by a monotonic clock
        self._statuses: dict[str, tuple[pb.ServiceStatus, float]] = {}
        self._object_version = 0
        self._ending = threading.Event()
        self._ros = RosNode(settings.node, THREADS, settings.sim_time)
        self._make_publishers()
        self._tasks = TaskInterface(self._ros, bus)
        bus.subscribe(PLAN, self._on_plan)
        bus.subscribe(ROBOT_DESCRIPTION, self._on_description)
        bus.subscribe(ROBOT_STATE, self._on_state)
        bus.subscribe(ANY_STATUS, self._on_status)
        self._ros.start()
        self._thread = threading.Thread(target=self._run, name="maps to ros", daemon=True)
        self._thread.start()
        health.ready(self._missing())

    def close(self) -> None:
        self._ending.set()
        self._thread.join(END_WITHIN_S)  # it may wait for an answer; it publishes nothing any more
        self._tasks.close()
        self._ros.close()

    def _make_publishers(self) -> None:
        kept = Qos(retained=True)

        def publisher(kind: str, name: str, qos: Qos = kept) -> Any:
            return self._ros.node.create_publisher(interface(kind), name, qos_profile(qos, 1))

        self._map = MapOutput(publisher, self._send, self._ros.now_ns)
        self._path = publisher(PATH, "~/path")
        self._objects = publisher("visualization_msgs/msg/MarkerArray", "~/objects")
        self._points = publisher("sensor_msgs/msg/PointCloud2", "~/points")
        self._classes = publisher("std_msgs/msg/String", "~/classes")
        self._diagnostics = publisher("diagnostic_msgs/msg/DiagnosticArray", "/diagnostics", Qos())
        self._detections = (
            publisher(DETECTIONS, "~/detections") if has_interface(DETECTIONS) else None
        )
        self._tf: Any = None
        if self._s.publish_tf != "none":
            still = self._s.publish_tf == "odom"
            self._tf = publisher(TF_MESSAGE, "/tf_static" if still else "/tf", Qos(retained=still))
        if self._frame:
            self._publish_odom()

    def _missing(self) -> str:
        """What is not published because its interfaces are not built."""
        kinds = {DETECTIONS: "~/detections", "helios_msgs/action/DoTask": "the action ~/do_task"}
        left_out = [what for kind, what in kinds.items() if not has_interface(kind)]
        if not left_out:
            return ""
        return f"without {', '.join(left_out)}: `helios ros2 build-interfaces DIR` adds them"

    # --- streams ------------------------------------------------------------------------------
    def _on_plan(self, plan: pb.Plan) -> None:
        if self._frame:
            points = zip(plan.path_m[::2], plan.path_m[1::2], strict=False)
            self._send(self._path, ros_messages.path(points, self._ros.now_ns(), self._frame))

    def _on_description(self, description: pb.RobotDescription) -> None:
        self._radius_m = description.footprint_radius_m or DEFAULT_RADIUS_M
        frame = self._s.frame or self._s.world_frame or description.world_frame or "map"
        if frame != self._frame:  # a bridge that starts again may take its poses from another
            self._frame, self._object_version = frame, 0
            log.info("publishes in the frame %s", frame)
            self._publish_odom()

    def _on_state(self, state: pb.RobotState) -> None:
        if self._s.publish_tf == "base" and self._frame:
            self._publish_transform("base_link", transform_from_proto(state.T_world_base))

    def _on_status(self, status: pb.ServiceStatus) -> None:
        self._statuses[status.service] = status, time.monotonic()

    def _publish_odom(self) -> None:
        if self._s.publish_tf == "odom" and self._frame != "odom":
            self._publish_transform("odom", np.eye(4))

    def _publish_transform(self, child: str, T: Any) -> None:
        one = ros_messages.transform(self._frame, child, T, self._ros.now_ns())
        self._send(self._tf, interface(TF_MESSAGE)(transforms=[one]))

    # --- maps ---------------------------------------------------------------------------------
    def _run(self) -> None:
        while not self._ending.wait(self._s.map_period_s):
            try:
                self._publish_diagnostics()
                if self._frame:
                    self._map.update(self._ask_snapshot, self._radius_m, self._frame)
                    self._publish_objects()
            except HeliosError as error:  # a map with impossible content; the next may be valid
                self._health.count("unpublishable_maps")
                log.warning("a map was left out: %s", error.message)
            except Exception:  # as the node ends
                if self._ending.is_set():
                    return
                self._health.count("unpublishable_maps")
                log.exception("a map was left out")

    def _publish_diagnostics(self) -> None:
        now_s = time.monotonic()
        ages = [(status, now_s - came_s) for status, came_s in list(self._statuses.values())]
        self._send(self._diagnostics, ros_messages.diagnostics(ages, self._ros.now_ns()))

    def _publish_objects(self) -> None:
        reply = self._ask(OBJECTS, pb.ObjectsRequest())
        if reply is None or reply.version == self._object_version:
            return
        gaussians = self._ask(GAUSSIANS, pb.GaussiansRequest())
        if gaussians is None:
            return
        ns = self._ros.now_ns()
        self._send(self._objects, ros_messages.markers(reply.objects, self._frame))
        if self._detections is not None:
            found = ros_messages.detections(reply.objects, ns, self._frame)
            self._send(self._detections, found)
        points = map_arrays.cloud(gaussians)
        self._send(self._points, ros_messages.point_cloud(points, ns, self._frame))
        names = interface("std_msgs/msg/String")(data=map_arrays.class_table(gaussians))
        self._send(self._classes, names)
        self._object_version = reply.version

    def _ask_snapshot(self, request: pb.SnapshotRequest) -> pb.MapSnapshot | None:
        return self._ask(SNAPSHOT, request)

    def _ask(self, method: Method[Req, Rep], request: Req) -> Rep | None:
        try:
            return self._bus.call(method, request, CALL_S)
        except HeliosError as error:
            self._health.count("missed_maps")
            log.debug("%s gave no answer: %s", method.name, error.message)
            return None

    def _send(self, publisher: Any, message: Any) -> None:
        if not self._ending.is_set():
            publisher.publish(message)
            self._health.count("messages")
