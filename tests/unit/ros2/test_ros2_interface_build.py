"""`helios ros2 build-interfaces`: what it refuses, and the package that a sourced ROS needs."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
from helios_core.errors import InvalidInput, Unavailable
from helios_ros2 import interface_build as build

ROS = build.RosPython(sys.executable, Path(sys.prefix), Path("/nowhere"), "jazzy")


def test_missing_tools_and_headers_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda tool: None if tool == "cmake" else tool)
    with pytest.raises(Unavailable, match=r"lacks cmake, Python's headers \(/nowhere/Python.h\)"):
        build.check_tools(ROS)


def test_an_interpreter_without_rclpy_of_pip_is_refused_with_the_way_out() -> None:
    with pytest.raises(InvalidInput, match=r"has no rclpy of pip.*apt install"):
        build.ros_python(sys.executable)


def test_the_package_for_colcon_is_whole(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "helios_client", "ros2", "build-interfaces", str(tmp_path),
         "--sources"], capture_output=True, text=True, timeout=60, check=True,
    )  # fmt: skip
    package = tmp_path / "src" / "helios_msgs"
    assert str(package) in done.stdout
    assert ElementTree.parse(package / "package.xml").findtext("name") == "helios_msgs"
    action = (package / "action" / "DoTask.action").read_text()
    assert action.count("\n---\n") == 2  # goal, result, feedback
    assert "action/DoTask.action" in (package / "CMakeLists.txt").read_text()
