"""Central import of bosdyn-client. Its generated messages have no types, hence Any."""

from __future__ import annotations

from importlib import import_module
from typing import Any


def _load(name: str) -> Any:
    try:
        return import_module(f"bosdyn.{name}")
    except ImportError as error:
        raise ImportError(
            f"Spot needs bosdyn-client: pip install 'helios-ovmm[spot]' ({error})"
        ) from error


client = _load("client")
channel_common = _load("client.common")
exceptions = _load("client.exceptions")
frame_helpers = _load("client.frame_helpers")
math_helpers = _load("client.math_helpers")

auth = _load("client.auth")
estop = _load("client.estop")
image = _load("client.image")
lease = _load("client.lease")
manipulation = _load("client.manipulation_api_client")
power = _load("client.power")
robot = _load("client.robot")
robot_command = _load("client.robot_command")
robot_state = _load("client.robot_state")
time_sync = _load("client.time_sync")

arm_command_pb2 = _load("api.arm_command_pb2")
basic_command_pb2 = _load("api.basic_command_pb2")
geometry_pb2 = _load("api.geometry_pb2")
image_pb2 = _load("api.image_pb2")
manipulation_api_pb2 = _load("api.manipulation_api_pb2")
robot_state_pb2 = _load("api.robot_state_pb2")
