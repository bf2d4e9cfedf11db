"""Entry point `python -m helios_ros2`: publishes maps, objects and tasks to ROS."""

from __future__ import annotations

import sys

from helios_core.service_process import run_service

from helios_ros2.output_service import OutputService
from helios_ros2.settings import Ros2Settings

if __name__ == "__main__":
    settings = Ros2Settings.load()
    sys.exit(
        run_service("ros2", settings, lambda bus, health: OutputService(bus, settings, health))
    )
