"""Import of `rclpy`, which only the processes that use ROS do."""

from __future__ import annotations

import importlib
from typing import Any

from helios_core.errors import InvalidInput

INSTALL = (
    "install it with `make ros2-env`, or `pip install 'helios-ovmm[ros2]'` in an environment of "
    "its own, or source your ROS 2; see docs/tutorials/your-ros2-robot.md"
)


def load_rclpy() -> Any:
    """The module `rclpy`. Raises InvalidInput that says what to install."""
    try:
        return importlib.import_module("rclpy")
    except ImportError as error:
        raise InvalidInput(f"ROS 2's rclpy cannot be imported ({error}); {INSTALL}") from error


def rclpy_module(name: str) -> Any:
    """Module `rclpy.<name>`. Raises InvalidInput that says what to install."""
    load_rclpy()
    return importlib.import_module(f"rclpy.{name}")


def interface(name: str) -> Any:
    """Class of a message, service or action, such as `sensor_msgs/msg/Image`.

    Raises InvalidInput for a name of another form, or that is not installed.
    """
    parts = name.split("/")
    if len(parts) != 3 or parts[1] not in ("msg", "srv", "action"):
        raise InvalidInput(
            f"{name!r} is no ROS type; wanted package/msg/Name, …/srv/… or …/action/…"
        )
    package, kind, short = parts
    try:
        return getattr(importlib.import_module(f"{package}.{kind}"), short)
    except (ImportError, AttributeError) as error:
        raise InvalidInput(
            f"the ROS type {name} is not installed ({error}); build it with `helios ros2 "
            "build-interfaces DIR`, or source a ROS 2 that has it"
        ) from error


def has_interface(name: str) -> bool:
    """True if `interface` can load this type."""
    try:
        interface(name)
    except InvalidInput:
        return False
    return True
