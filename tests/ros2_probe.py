"""A ROS 2 program as a user would write it: listens to HELIOS' topics, calls its services.

python -m tests.ros2_probe listen SECONDS TOPIC=TYPE …     newest message of each, as JSON
python -m tests.ros2_probe call SERVICE                     a std_srvs/Trigger
python -m tests.ros2_probe do_task INSTRUCTION              the action DoTask, to its end
python -m tests.ros2_probe cancel_task INSTRUCTION          the same, cancelled at its start
python -m tests.ros2_probe say TOPIC TEXT                   one std_msgs/String
python -m tests.ros2_probe record FOLDER SECONDS TOPIC=TYPE …   a rosbag2 with MCAP
"""

from __future__ import annotations

import importlib
import json
import sys
import time
from pathlib import Path
from typing import Any

import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

WITHIN_S = 60.0
KEPT = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def kind_of(name: str) -> Any:
    package, part, short = name.split("/")
    return getattr(importlib.import_module(f"{package}.{part}"), short)


def listen(node: Node, seconds: str, *topics: str) -> dict[str, Any]:
    """Newest message of each topic; ends as soon as each has one."""
    got: dict[str, Any] = {}
    for topic in topics:
        name, kind = topic.split("=")
        node.create_subscription(
            kind_of(kind), name, lambda m, name=name: got.__setitem__(name, summary(m)), KEPT
        )
    end_s = time.monotonic() + float(seconds)
    while len(got) < len(topics) and time.monotonic() < end_s:
        rclpy.spin_once(node, timeout_sec=0.1)
    return got


def summary(message: Any) -> dict[str, Any]:
    """What a test wants to know of a message."""
    out: dict[str, Any] = {"frame": getattr(getattr(message, "header", None), "frame_id", "")}
    if hasattr(message, "info"):
        out["size"] = [message.info.width, message.info.height]
        out["cells"] = sorted(set(message.data))
    elif hasattr(message, "encoding"):
        out["size"] = [message.width, message.height]
    elif hasattr(message, "fields"):
        out["fields"], out["points"] = [f.name for f in message.fields], message.width
    elif hasattr(message, "markers"):
        out["texts"] = [m.text for m in message.markers if m.text]
    elif hasattr(message, "detections"):
        out["classes"] = [d.results[0].hypothesis.class_id for d in message.detections]
    elif hasattr(message, "poses"):
        out["poses"] = len(message.poses)
    elif hasattr(message, "status"):
        out["names"] = [s.name for s in message.status]
    elif hasattr(message, "data"):
        out["text"] = message.data
    return out


def call(node: Node, service: str) -> dict[str, Any]:
    client = node.create_client(kind_of("std_srvs/srv/Trigger"), service)
    assert client.wait_for_service(timeout_sec=WITHIN_S), f"nobody serves {service}"
    future = client.call_async(kind_of("std_srvs/srv/Trigger").Request())
    rclpy.spin_until_future_complete(node, future, timeout_sec=WITHIN_S)
    return {"success": future.result().success, "message": future.result().message}


def do_task(node: Node, instruction: str, cancel: bool = False) -> dict[str, Any]:
    from rclpy.action import ActionClient

    kind = kind_of("helios_msgs/action/DoTask")
    client = ActionClient(node, kind, "/helios/do_task")
    assert client.wait_for_server(timeout_sec=WITHIN_S), "nobody serves /helios/do_task"
    phases: list[str] = []
    sent = client.send_goal_async(
        kind.Goal(instruction=instruction),
        feedback_callback=lambda m: phases.append(m.feedback.phase),
    )
    rclpy.spin_until_future_complete(node, sent, timeout_sec=WITHIN_S)
    handle = sent.result()
    ended = handle.get_result_async()
    if cancel:
        while not phases and not ended.done():
            rclpy.spin_once(node, timeout_sec=0.1)
        handle.cancel_goal_async()
    rclpy.spin_until_future_complete(node, ended, timeout_sec=3 * WITHIN_S)
    result = ended.result().result
    return {
        "status": ended.result().status, "state": result.state, "message": result.message,
        "succeeded": result.succeeded, "phases": sorted(set(phases)),
    }  # fmt: skip


def cancel_task(node: Node, instruction: str) -> dict[str, Any]:
    return do_task(node, instruction, cancel=True)


def say(node: Node, topic: str, text: str) -> dict[str, Any]:
    kind = kind_of("std_msgs/msg/String")
    publisher = node.create_publisher(kind, topic, 10)
    end_s = time.monotonic() + WITHIN_S
    while publisher.get_subscription_count() == 0 and time.monotonic() < end_s:
        time.sleep(0.05)
    publisher.publish(kind(data=text))
    publisher.wait_for_all_acked(rclpy.duration.Duration(seconds=5))
    return {"listeners": publisher.get_subscription_count()}


def record(node: Node, folder: str, seconds: str, *topics: str) -> dict[str, Any]:
    """Record the serialised messages as `ros2 bag record -s mcap` does."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    counts: dict[str, int] = {}
    writer = Writer(Path(folder), version=9, storage_plugin=StoragePlugin.MCAP)
    with writer:
        for topic in topics:
            name, kind = topic.split("=")
            connection = writer.add_connection(name, kind, typestore=store)
            static = name.endswith("_static")
            qos = KEPT if static else QoSProfile(depth=50, reliability=ReliabilityPolicy.RELIABLE)

            def on(data: bytes, connection: Any = connection, name: str = name) -> None:
                writer.write(connection, time.time_ns(), data)
                counts[name] = counts.get(name, 0) + 1

            node.create_subscription(kind_of(kind), name, on, qos, raw=True)
        began_s = time.monotonic()
        while time.monotonic() < began_s + WITHIN_S and (
            len(counts) < len(topics) or time.monotonic() < began_s + float(seconds)
        ):
            rclpy.spin_once(node, timeout_sec=0.1)
    return counts


def main() -> int:
    rclpy.init(args=[])
    node = rclpy.create_node("probe")
    what, *args = sys.argv[1:]
    commands = {f.__name__: f for f in (listen, call, do_task, cancel_task, say, record)}
    answer = commands[what](node, *args)
    print(json.dumps(answer))
    node.destroy_node()
    rclpy.shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
