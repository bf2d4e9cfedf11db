"""Measures how many colour and depth images of 640x480 at 30 Hz reach the driver, and how late.

    .venv-ros2/bin/python -m tests.bench.ros2_images [--without-profile] [--best-effort]

A fake robot sends them from another process, with the profile deploy/ros2/shm.xml.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from helios_replay.ros_images import stamp_ns
from helios_ros2.image_pairs import ImagePairs
from helios_ros2.ros_node import RosNode
from helios_ros2.topic_choice import RAW, color_topic, depth_topic
from helios_ros2.topic_reader import TopicReader

PROFILE = Path(__file__).resolve().parents[2] / "deploy/ros2/shm.xml"
HZ = 30.0
VARIABLES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")


def measured(seconds: float) -> dict[str, Any]:
    """Rates and latencies of the images that arrive within `seconds`."""
    late_ms: dict[str, list[float]] = {"color": [], "depth": []}
    pairs, count = ImagePairs(0.02), [0]

    def on(what: str, message: Any) -> None:
        ns = stamp_ns(message.header)
        late_ms[what].append((time.time_ns() - ns) / 1e6)
        add = pairs.add_color if what == "color" else pairs.add_depth
        count[0] += add(ns, message) is not None

    ros = RosNode("bench")
    for what, choose in (("color", color_topic), ("depth", depth_topic)):
        TopicReader(
            ros,
            lambda choose=choose: choose(ros.graph(), ""),
            (RAW,),
            lambda m, what=what: on(what, m),
            5,
        )
    ros.start()
    deadline_s = time.monotonic() + 20
    while not count[0] and time.monotonic() < deadline_s:
        time.sleep(0.05)
    time.sleep(1.0)
    for values in late_ms.values():
        values.clear()
    count[0] = 0
    began_s = time.monotonic()
    time.sleep(seconds)
    took_s = time.monotonic() - began_s
    ros.close()
    out: dict[str, Any] = {"pairs_hz": round(count[0] / took_s, 2)}
    for what, values in late_ms.items():
        p50, p95 = np.percentile(values, [50, 95]) if values else (np.nan, np.nan)
        out[what] = {
            "hz": round(len(values) / took_s, 2),
            "p50_ms": round(float(p50), 1),
            "p95_ms": round(float(p95), 1),
        }
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--without-profile", action="store_true")
    parser.add_argument("--best-effort", action="store_true")
    args = parser.parse_args()
    environment = dict(os.environ)
    if not args.without_profile:
        environment |= dict.fromkeys(VARIABLES, str(PROFILE))
    argv = [sys.executable, "-m", "tests.fake_ros2", "--size", "640x480", "--hz", str(HZ)]
    argv += ["--still", *(["--best-effort"] if args.best_effort else [])]
    with subprocess.Popen(argv, env=environment, stdout=subprocess.DEVNULL) as robot:
        try:
            print(json.dumps(measured(args.seconds), indent=2))
        finally:
            robot.terminate()


if __name__ == "__main__":
    main()
