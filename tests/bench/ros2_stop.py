"""Time from a call of /helios/stop to the first velocity of zero.

`python -m tests.bench.ros2_stop --trials 20`.

A fake ROS 2 robot explores its room under `helios up --robot ros2 --ros2`.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from tests.e2e.own_robot_up import OwnUp
from tests.e2e.test_ros2_system import SERVICES, SETTINGS
from tests.helios_up import helios_up
from tests.ros2_processes import fake_robot, free_domain, probe, ros_environment
from tests.support import LOOPBACK, wait_until


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=20)
    trials = parser.parse_args().trials
    domain = free_domain()
    environment = ros_environment(domain, SETTINGS)
    flags = ("--robot", "ros2", "--ros2", "--detector", "paint")
    times_s = []
    with (
        tempfile.TemporaryDirectory() as folder,
        fake_robot(domain, "--still"),
        helios_up(Path(folder), *flags, kind=OwnUp, environment=environment) as up,
    ):
        wait_until(lambda: up.are_ready(*SERVICES), 150, "all services are ready")
        for _ in range(trials):
            explore = {"time_limit_s": 60}
            LOOPBACK.post(f"{up.address}/v1/robot/explore", json=explore, timeout=10)
            told = probe(domain, "stop_drive")
            assert told["success"]
            assert not told["drove_on"]
            times_s.append(told["seconds"])
            assert probe(domain, "call", "/helios/clear_stop")["success"]
    ms = np.array(times_s) * 1e3
    print(f"{trials} stops: median {np.median(ms):.0f} ms, largest {ms.max():.0f} ms")


if __name__ == "__main__":
    main()
