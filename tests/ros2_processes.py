"""ROS 2 in tests: its interpreter, the fake robot, and a probe. All in processes of their own."""

from __future__ import annotations

import functools
import json
import os
import signal
import subprocess
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

# Limits for a robot that is a process of this machine and may wait for a core.
PATIENT: dict[str, Any] = {"silent_s": 10.0, "blocked_s": 10.0, "image_wait_s": 20.0}
ENDS_WITHIN_S = 30.0  # this module also runs where httpx is not installed

ROOT = Path(__file__).resolve().parents[1]
PYTHON = ROOT / ".venv-ros2/bin/python"
PACKAGES = (ROOT / "services", ROOT / "shared", ROOT / "clients", ROOT)

needs_ros2 = pytest.mark.skipif(
    not PYTHON.exists(), reason=f"{PYTHON} is missing: `make ros2-env` makes it (x86-64 Linux)"
)


@functools.cache
def has_interfaces(*packages: str) -> bool:
    """Return whether `.venv-ros2` has these interface packages."""
    code = f"import {', '.join(packages)}"
    return (
        PYTHON.exists()
        and subprocess.run([PYTHON, "-c", code], capture_output=True, check=False).returncode == 0
    )


def needs_interfaces(*packages: str) -> pytest.MarkDecorator:
    """Mark of a test that needs interfaces which pip does not have."""
    return pytest.mark.skipif(
        not has_interfaces(*packages),
        reason=f"no {' and '.join(packages)} in {PYTHON}: `make ros2-interfaces` builds them",
    )


def ros_environment(domain: int, settings: Mapping[str, str] | None = None) -> dict[str, str]:
    """Variables of processes that see only each other, on loopback."""
    return {
        "ROS_DOMAIN_ID": str(domain),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_PYTHON_CHECK_FIELDS": "1",  # a field of a wrong type is an error, as in older ROS 2
        "PYTHONPATH": os.pathsep.join(map(str, PACKAGES)),
        "HELIOS_ROS2_PYTHON": str(PYTHON),
        **(settings or {}),
    }


def free_domain() -> int:
    """A ROS domain for this test process: its tests run one after another."""
    return 1 + os.getpid() % 100


@contextmanager
def fake_robot(domain: int, *options: str) -> Iterator[subprocess.Popen[str]]:
    """Run the fake robot; enters when it is up."""
    env = os.environ | ros_environment(domain)
    argv = [str(PYTHON), "-m", "tests.fake_ros2", *options]
    with subprocess.Popen(argv, env=env, stdout=subprocess.PIPE, text=True) as robot:
        try:
            assert robot.stdout is not None
            assert "up" in robot.stdout.readline(), "the fake robot did not start"
            yield robot
        finally:
            robot.send_signal(signal.SIGCONT)
            robot.terminate()
            try:
                robot.wait(ENDS_WITHIN_S)
            except subprocess.TimeoutExpired:
                robot.kill()


def in_ros(
    domain: int, *argv: str, timeout_s: float = 120, settings: Mapping[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    """Run `python -m …` with ROS 2 to its end."""
    return subprocess.run(
        [str(PYTHON), "-m", *argv],
        env=os.environ | ros_environment(domain, settings),
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=timeout_s,
        check=False,
    )


def probe(domain: int, *argv: str, timeout_s: float = 120) -> Any:
    """Answer of `tests.ros2_probe`, a ROS program that knows nothing of HELIOS."""
    done = in_ros(domain, "tests.ros2_probe", *argv, timeout_s=timeout_s)
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout.splitlines()[-1])


def contract(domain: int, *pytest_args: str, settings: Mapping[str, str]) -> str:
    """Run the contract suite on the driver. Returns its output; fails if a test fails."""
    args = ("--forward-m", "0.3", "--", *pytest_args)
    patient = {f"HELIOS_ROS2_{name.upper()}": str(value) for name, value in PATIENT.items()}
    chosen = patient | dict(settings)
    done = in_ros(domain, "helios_contract", "ros2", *args, timeout_s=800, settings=chosen)
    assert done.returncode == 0, done.stdout[-6000:] + done.stderr[-2000:]
    return done.stdout
