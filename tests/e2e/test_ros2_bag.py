"""A rosbag2 (MCAP) of a ROS 2 robot, recorded from its topics and played by `helios replay`."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.ros2_processes import ROOT, fake_robot, free_domain, needs_interfaces, needs_ros2, probe

TOPICS = (
    "/camera/color/image_raw=sensor_msgs/msg/Image",
    "/camera/aligned_depth_to_color/image_raw=sensor_msgs/msg/Image",
    "/camera/color/camera_info=sensor_msgs/msg/CameraInfo",
    "/tf=tf2_msgs/msg/TFMessage",
    "/tf_static=tf2_msgs/msg/TFMessage",
)


@pytest.mark.slow
@needs_ros2
@needs_interfaces("tf2_msgs")
def test_a_recorded_bag_replays_to_the_objects_in_front_of_the_robot(tmp_path: Path) -> None:
    bag, domain = tmp_path / "bag", free_domain()
    with fake_robot(domain, "--still", "--tf", "--hz", "5"):
        counts = probe(domain, "record", str(bag), "4", *TOPICS)
    assert counts["/tf_static"] >= 1
    assert min(counts.values()) >= 1
    assert list(bag.glob("*.mcap")), "the bag holds MCAP"
    replayed = subprocess.run(
        [
            sys.executable, "-m", "helios_client", "replay", str(bag), "--out",
            str(tmp_path / "out"), "--classes", "table,box", "--detector", "paint",
        ],
        cwd=ROOT, env=os.environ | {"MUJOCO_GL": "egl"}, capture_output=True, text=True,
        timeout=200, check=False,
    )  # fmt: skip
    assert replayed.returncode == 0, replayed.stderr
    summary = json.loads((tmp_path / "out/summary.json").read_text())
    assert summary["keyframes"] >= 10
    [table] = [
        o for o in json.loads((tmp_path / "out/objects.json").read_text()) if o["class"] == "table"
    ]
    x, y, _ = table["center_m"]  # a table from x = 1.4 to 2.0 m; its near side is seen
    assert 1.3 < x < 2.0
    assert abs(y) < 0.2
