"""Entry point `python -m helios_ros2`: publishes maps, objects and tasks to ROS."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from helios_core.service_process import Service, run_service

from helios_ros2.output_service import OutputService
from helios_ros2.settings import Ros2Settings


def service(argv: Sequence[str] | None = None) -> Service:
    settings = Ros2Settings.load(argv)
    return Service("ros2", settings, lambda bus, health: OutputService(bus, settings, health))


if __name__ == "__main__":
    sys.exit(run_service(service()))
