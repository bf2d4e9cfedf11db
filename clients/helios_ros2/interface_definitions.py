"""Interface packages that pip does not have: the fields of their messages, per ROS distribution.

Only fields: constants and comments change neither the wire format nor the type's hash.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

DISTRIBUTIONS = ("jazzy", "kilted")


@dataclass(frozen=True)
class InterfacePackage:
    """Source of one interface package."""

    name: str
    files: Mapping[str, str]  # such as msg/TFMessage.msg -> its text
    depends: tuple[str, ...]

    @property
    def manifest(self) -> str:
        """package.xml"""
        depends = "".join(f"  <depend>{name}</depend>\n" for name in self.depends)
        return (
            '<?xml version="1.0"?>\n<package format="3">\n'
            f"  <name>{self.name}</name>\n  <version>0.0.1</version>\n"
            f"  <description>Interfaces of {self.name}, built by HELIOS</description>\n"
            '  <maintainer email="nobody@example.com">nobody</maintainer>\n'
            "  <license>Apache-2.0</license>\n"
            "  <buildtool_depend>ament_cmake</buildtool_depend>\n"
            "  <buildtool_depend>rosidl_default_generators</buildtool_depend>\n"
            f"{depends}"
            "  <exec_depend>rosidl_default_runtime</exec_depend>\n"
            "  <member_of_group>rosidl_interface_packages</member_of_group>\n</package>\n"
        )

    @property
    def build_file(self) -> str:
        """CMakeLists.txt"""
        found = "".join(f"find_package({name} REQUIRED)\n" for name in self.depends)
        files = " ".join(f'"{name}"' for name in self.files)
        return (
            f"cmake_minimum_required(VERSION 3.10)\nproject({self.name})\n"
            "find_package(ament_cmake REQUIRED)\nfind_package(rosidl_default_generators REQUIRED)\n"
            f"{found}rosidl_generate_interfaces(${{PROJECT_NAME}} {files}\n"
            f"  DEPENDENCIES {' '.join(self.depends)})\n"
            "ament_export_dependencies(rosidl_default_runtime)\nament_package()\n"
        )


TF2 = InterfacePackage(
    "tf2_msgs",
    {"msg/TFMessage.msg": "geometry_msgs/TransformStamped[] transforms\n"},
    ("builtin_interfaces", "geometry_msgs"),
)
VISION = InterfacePackage(
    "vision_msgs",
    {
        "msg/ObjectHypothesis.msg": "string class_id\nfloat64 score\n",
        "msg/ObjectHypothesisWithPose.msg": "ObjectHypothesis hypothesis\n"
        "geometry_msgs/PoseWithCovariance pose\n",
        "msg/BoundingBox3D.msg": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size\n",
        "msg/Detection3D.msg": "std_msgs/Header header\nObjectHypothesisWithPose[] results\n"
        "BoundingBox3D bbox\nstring id\n",
        "msg/Detection3DArray.msg": "std_msgs/Header header\nDetection3D[] detections\n",
    },
    ("std_msgs", "geometry_msgs"),
)
HELIOS = InterfacePackage(
    "helios_msgs",
    {
        "action/DoTask.action": "string instruction\nfloat32 time_limit_s\n---\n"
        "bool succeeded\nstring task_id\nstring state\nstring cause\nstring message\n---\n"
        "string task_id\nstring phase\nstring message\nfloat32 progress\n"
    },
    ("builtin_interfaces", "action_msgs"),
)


def nav2(distribution: str) -> InterfacePackage:
    """Nav2's behaviours, which differ between distributions."""
    check = "" if distribution == "jazzy" else "bool disable_collision_checks False\n"
    ended = "builtin_interfaces/Duration total_elapsed_time\nuint16 error_code\nstring error_msg\n"
    allowed = f"builtin_interfaces/Duration time_allowance\n{check}---\n{ended}---\n"
    straight = f"geometry_msgs/Point target\nfloat32 speed\n{allowed}float32 distance_traveled\n"
    return InterfacePackage(
        "nav2_msgs",
        {
            "action/Spin.action": f"float32 target_yaw\n{allowed}"
            "float32 angular_distance_traveled\n",
            "action/DriveOnHeading.action": straight,
            "action/BackUp.action": straight,
        },
        ("builtin_interfaces", "geometry_msgs", "action_msgs"),
    )


def packages(distribution: str) -> tuple[InterfacePackage, ...]:
    """All packages, in the order of their use: the driver's first."""
    return TF2, nav2(distribution), VISION, HELIOS
