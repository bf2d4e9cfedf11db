"""A ROS 2 program as a user would write it: listens to HELIOS' topics, calls its services.

python -m tests.ros2_probe listen SECONDS TOPIC=TYPE …     newest message of each, as JSON;
                                                            TOPIC=TYPE=volatile: not a retained one
python -m tests.ros2_probe call SERVICE                     a std_srvs/Trigger
python -m tests.ros2_probe do_task INSTRUCTION              the action DoTask, to its end
python -m tests.ros2_probe cancel_task INSTRUCTION          the same, cancelled at its start
python -m tests.ros2_probe say TOPIC TEXT [ANSWERS]         one std_msgs/String, and its answer
python -m tests.ros2_probe stop_drive                       stops the robot as soon as it drives
python -m tests.ros2_probe record FOLDER SECONDS TOPIC=TYPE …   a rosbag2 with MCAP
"""

from __future__ import annotations

import importlib
import json
import sys
import time
from collections.abc import Callable
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
        name, kind, *volatile = topic.split("=")
        node.create_subscription(
            kind_of(kind),
            name,
            lambda m, name=name: got.__setitem__(name, summary(m)),
            10 if volatile else KEPT,
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
        "status": ended.result().status,
        "state": result.state,
        "message": result.message,
        "succeeded": result.succeeded,
        "phases": sorted(set(phases)),
    }


def cancel_task(node: Node, instruction: str) -> dict[str, Any]:
    return do_task(node, instruction, cancel=True)


def stop_drive(node: Node) -> dict[str, Any]:
    """Call /helios/stop while velocities come; the time until the first that is zero."""
    trigger = kind_of("std_srvs/srv/Trigger")
    client = node.create_client(trigger, "/helios/stop")
    assert client.wait_for_service(timeout_sec=WITHIN_S)
    speeds: list[float] = []
    node.create_subscription(
        kind_of("geometry_msgs/msg/Twist"),
        "/cmd_vel",
        lambda m: speeds.append(abs(m.linear.x) + abs(m.angular.z)),
        50,
    )
    _spin_until(node, lambda: bool(speeds) and speeds[-1] > 0)
    asked_s = time.monotonic()
    answer = client.call_async(trigger.Request())
    _spin_until(node, lambda: speeds[-1] == 0)
    stood_s = time.monotonic() - asked_s
    _spin_until(node, answer.done)
    count = len(speeds)
    _spin_until(node, lambda: time.monotonic() > asked_s + 1.0)
    return {
        "success": answer.result().success,
        "seconds": round(stood_s, 4),
        "drove_on": any(speed > 0 for speed in speeds[count:]),
    }


def _spin_until(node: Node, is_true: Callable[[], bool]) -> None:
    end_s = time.monotonic() + WITHIN_S
    while not is_true():
        assert time.monotonic() < end_s, "it never came true"
        rclpy.spin_once(node, timeout_sec=0.05)


def say(node: Node, topic: str, text: str, answers: str = "") -> dict[str, Any]:
    kind = kind_of("std_msgs/msg/String")
    heard: list[str] = []
    if answers:
        node.create_subscription(kind, answers, lambda m: heard.append(m.data), 10)
        _spin_until(node, lambda: node.count_publishers(answers) > 0)
    publisher = node.create_publisher(kind, topic, 10)
    end_s = time.monotonic() + WITHIN_S
    while publisher.get_subscription_count() == 0 and time.monotonic() < end_s:
        time.sleep(0.05)
    publisher.publish(kind(data=text))
    publisher.wait_for_all_acked(rclpy.duration.Duration(seconds=5))
    if answers:
        _spin_until(node, lambda: bool(heard))
    return {"listeners": publisher.get_subscription_count(), "answer": heard[-1] if heard else ""}


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
    commands = {
        f.__name__: f
        for f in (
            listen,
            call,
            do_task,
            cancel_task,
            say,
            stop_drive,
            record,
        )
    }
    answer = commands[what](node, *args)
    print(json.dumps(answer))
    node.destroy_node()
    rclpy.shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
