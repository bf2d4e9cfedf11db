"""Imports of bosdyn's generated modules in one place; they have no types, hence Any."""

from __future__ import annotations

from importlib import import_module
from typing import Any


def _load(name: str) -> Any:
    return import_module(f"bosdyn.{name}")


arm = _load("api.arm_command_pb2")
auth = _load("api.auth_pb2")
basic = _load("api.basic_command_pb2")
directory = _load("api.directory_pb2")
estop = _load("api.estop_pb2")
geometry = _load("api.geometry_pb2")
header = _load("api.header_pb2")
image = _load("api.image_pb2")
lease = _load("api.lease_pb2")
license = _load("api.license_pb2")
manipulation = _load("api.manipulation_api_pb2")
power = _load("api.power_pb2")
robot_command = _load("api.robot_command_pb2")
robot_id = _load("api.robot_id_pb2")
robot_state = _load("api.robot_state_pb2")
spot_command = _load("api.spot.robot_command_pb2")
time_sync = _load("api.time_sync_pb2")

SERVICERS = {
    name: _load(f"api.{module}_service_pb2_grpc")
    for name, module in {
        "AuthService": "auth",
        "DirectoryService": "directory",
        "EstopService": "estop",
        "ImageService": "image",
        "LeaseService": "lease",
        "ManipulationApiService": "manipulation_api",
        "PowerService": "power",
        "RobotCommandService": "robot_command",
        "RobotIdService": "robot_id",
        "RobotStateService": "robot_state",
        "TimeSyncService": "time_sync",
    }.items()
}

math_helpers = _load("client.math_helpers")
frame_helpers = _load("client.frame_helpers")
channel = _load("client.channel")
util = _load("util")


def servicer(name: str) -> Any:
    """The generated base class of a service."""
    return getattr(SERVICERS[name], f"{name}Servicer")


def answer(reply: Any, request: Any, robot_ns: int) -> Any:
    """Fill in the header that every service of the robot sends; the reply."""
    reply.header.request_header.CopyFrom(request.header)
    util.set_timestamp_from_nsec(reply.header.request_received_timestamp, robot_ns)
    util.set_timestamp_from_nsec(reply.header.response_timestamp, robot_ns)
    reply.header.error.code = header.CommonError.CODE_OK
    return reply
