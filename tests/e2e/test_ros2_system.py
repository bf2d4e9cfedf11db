"""`helios up --robot ros2 --ros2`: a task by ROS, its map on ROS topics, stop, and an outage."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.e2e.own_robot_up import OwnUp
from tests.helios_up import helios_up
from tests.ros2_processes import (
    fake_robot,
    free_domain,
    has_interfaces,
    needs_ros2,
    probe,
    ros_environment,
)
from tests.support import LOOPBACK, wait_until

pytestmark = pytest.mark.long

SERVICES = ("bridge", "detector", "map2d", "objectmap", "planner", "ros2")
SETTINGS = {
    "HELIOS_ROS2_POSE": "topic",
    "HELIOS_ROS2_CAMERA_TILT_RAD": "0.55",
    "HELIOS_ROS2_TURN_RAD_S": "2.0",
    "HELIOS_ROS2_SPEED_M_S": "0.8",  # the fake robot has no mass
}
GRID = "nav_msgs/msg/OccupancyGrid"


@dataclass
class Scene:
    up: OwnUp
    robot: subprocess.Popen[str]
    domain: int

    def bridge(self) -> dict[str, str]:
        return self.up.services().get("bridge", {})


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Scene]:
    domain, state = free_domain(), tmp_path_factory.mktemp("ros2")
    flags = ("--robot", "ros2", "--ros2", "--detector", "paint")
    with (
        fake_robot(domain, "--still") as robot,
        helios_up(state, *flags, kind=OwnUp, environment=ros_environment(domain, SETTINGS)) as up,
    ):
        wait_until(lambda: up.are_ready(*SERVICES), 150, "all services are ready")
        yield Scene(up, robot, domain)


@needs_ros2
def test_a_task_by_ros_succeeds_and_its_map_reaches_a_node_that_starts_later(scene: Scene) -> None:
    if has_interfaces("helios_msgs"):
        done = probe(scene.domain, "do_task", "find the table", timeout_s=240)
        assert (done["status"], done["state"]) == (4, "succeeded"), done
        assert "find_object" in done["phases"]
    else:
        probe(scene.domain, "say", "/helios/do_task", "find the table")
    wait_until(lambda: newest_state(scene) == "succeeded", 240, "the task has succeeded")
    wanted = {
        "/helios/map": GRID,
        "/helios/costmap": GRID,
        "/helios/path": "nav_msgs/msg/Path",
        "/helios/trajectory": "nav_msgs/msg/Path",
        "/helios/objects": "visualization_msgs/msg/MarkerArray",
        "/helios/points": "sensor_msgs/msg/PointCloud2",
        "/helios/task": "std_msgs/msg/String",
        "/helios/value/pick": "sensor_msgs/msg/Image",
        "/helios/value/pick/grid": GRID,
        "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
    }
    if has_interfaces("vision_msgs"):
        wanted["/helios/detections"] = "vision_msgs/msg/Detection3DArray"
    # diagnostics are not retained; the listener waits for the next
    asked = [
        f"{t}={kind}" + ("=volatile" if t == "/diagnostics" else "") for t, kind in wanted.items()
    ]
    got = probe(scene.domain, "listen", "20", *asked)
    assert got.keys() == wanted.keys()
    assert any("bridge" in name for name in got["/diagnostics"]["names"])
    assert got["/helios/map"]["cells"] == [-1, 0, 100]
    assert got["/helios/map"]["frame"] == "odom"  # that of the robot's poses
    assert {0, 99, 100} <= set(got["/helios/costmap"]["cells"])
    assert got["/helios/points"]["fields"] == ["x", "y", "z", "rgb", "class", "object"]
    assert any(text.startswith("table") for text in got["/helios/objects"]["texts"])


def newest_state(scene: Scene) -> str:
    tasks = LOOPBACK.get(f"{scene.up.address}/v1/tasks", timeout=60).json()["tasks"]
    return tasks[0]["state"] if tasks else ""


@needs_ros2
def test_a_cancelled_action_cancels_its_task(scene: Scene) -> None:
    if not has_interfaces("helios_msgs"):
        pytest.skip("the interfaces are not built: make ros2-interfaces")
    done = probe(scene.domain, "cancel_task", "find the shelf")
    assert (done["status"], done["state"]) == (5, "cancelled"), done
    wait_until(lambda: newest_state(scene) == "cancelled", 60, "the gateway has heard of it")


@needs_ros2
def test_a_wrong_task_is_refused_on_a_topic(scene: Scene) -> None:
    told = probe(scene.domain, "say", "/helios/do_task", "{no json", "/helios/refused")
    assert told["listeners"] == 1
    assert json.loads(told["answer"])["instruction"] == "{no json"
    assert json.loads(told["answer"])["error"]


@needs_ros2
def test_the_stop_service_stops_the_robot_and_clear_stop_lets_it_move(scene: Scene) -> None:
    assert probe(scene.domain, "call", "/helios/stop")["success"]
    assert "stop" in str(LOOPBACK.get(f"{scene.up.address}/readyz").json())
    assert LOOPBACK.get(f"{scene.up.address}/readyz").json()["stopped"]
    assert probe(scene.domain, "call", "/helios/clear_stop")["success"]
    assert not LOOPBACK.get(f"{scene.up.address}/readyz").json()["stopped"]


@needs_ros2
def test_the_stop_service_ends_a_drive(scene: Scene) -> None:
    LOOPBACK.post(f"{scene.up.address}/v1/robot/explore", json={"time_limit_s": 60}, timeout=60)
    told = probe(scene.domain, "stop_drive")
    assert told["success"]
    assert not told["drove_on"]
    print(f"the first velocity of zero came {told['seconds']} s after the call")
    assert probe(scene.domain, "call", "/helios/clear_stop")["success"]


@needs_ros2
def test_topics_that_die_are_named_and_the_bridge_is_ready_when_they_come_back(
    scene: Scene,
) -> None:
    scene.robot.send_signal(signal.SIGSTOP)
    wait_until(
        lambda: "is silent for" in scene.bridge().get("reason", ""), 60, "the silence is reported"
    )
    assert "nav_msgs/msg/Odometry" in scene.bridge()["reason"] or (
        "sensor_msgs/msg/Image" in scene.bridge()["reason"]
    )
    scene.robot.send_signal(signal.SIGCONT)
    wait_until(lambda: scene.bridge().get("state") == "ready", 60, "the bridge is ready again")


@needs_ros2
def test_without_rclpy_one_sentence_says_what_to_install(tmp_path: Path) -> None:
    up = ("up", "--robot", "ros2", "--detector", "paint", "--state", str(tmp_path))
    done = subprocess.run(
        [sys.executable, "-m", "helios_client", *up],
        capture_output=True,
        text=True,
        timeout=60,
        env=os.environ | {"HELIOS_ROS2_PYTHON": "no-such-python"},
        check=False,
    )
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "HELIOS_ROS2_PYTHON" in done.stderr
