"""The Python interpreter of the processes that use ROS 2, and what their environment adds."""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
import sys
from pathlib import Path

from helios_client.usage_errors import UsageError

BESIDE = ".venv-ros2"
IMPORT_WITHIN_S = 30.0


def chosen_ros2_python(by_zenoh: bool = False) -> str:
    """Interpreter by the settings of ROS 2. by_zenoh: the process may do without rclpy.

    Raises UsageError, and InvalidInput for wrong settings.
    """
    from helios_ros2.settings import Ros2Settings

    settings = Ros2Settings.read()
    if by_zenoh and settings.transport == "zenoh":
        return sys.executable
    program = ros2_python(settings.python)
    if program != sys.executable:
        check_packages(program)
    return program


def check_packages(program: str) -> None:
    """Raise UsageError if an interpreter cannot import rclpy and HELIOS."""
    try:
        done = subprocess.run(
            [program, "-c", "import rclpy, helios_ros2.settings"],
            capture_output=True,
            text=True,
            timeout=IMPORT_WITHIN_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return  # a slow machine; the process will say what is wrong
    if done.returncode:
        why = (done.stderr.strip().splitlines() or ["it said nothing"])[-1]
        raise UsageError(
            f"{program} cannot run HELIOS with ROS 2: {why}; run `make ros2-env`, which installs "
            "rclpy and HELIOS, or name another Python with HELIOS_ROS2_PYTHON"
        )


def ros2_python(chosen: str) -> str:
    """Interpreter with rclpy: the chosen one, else this one, else that of `.venv-ros2`.

    chosen: HELIOS_ROS2_PYTHON. Raises UsageError that says what to install.
    """
    if chosen:
        program = shutil.which(chosen)
        if program is None:
            raise UsageError(f"HELIOS_ROS2_PYTHON names {chosen}, but there is no such program")
        return program
    if importlib.util.find_spec("rclpy") is not None:  # also from a sourced ROS
        return sys.executable
    for folder in (Path(sys.prefix).parent, Path.cwd()):
        program = folder / BESIDE / "bin/python"
        if program.is_file():
            return str(program)
    raise UsageError(
        f"ROS 2 needs rclpy, which neither {sys.executable} nor a {BESIDE} beside it has; run "
        "`make ros2-env`, or name a Python that has rclpy and HELIOS with HELIOS_ROS2_PYTHON, or "
        "source your ROS 2"
    )
