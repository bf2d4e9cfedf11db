"""An interpreter for ROS 2 that cannot run HELIOS is refused before anything starts."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from helios_client.supervision.ros2_python import check_packages, ros2_python
from helios_client.usage_errors import UsageError


def fake_python(path: Path, script: str) -> str:
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(0o755)
    return str(path)


def test_a_python_without_helios_is_refused_with_its_last_words_and_the_remedy(
    tmp_path: Path,
) -> None:
    words = "ModuleNotFoundError: No module named helios_ros2"
    program = fake_python(tmp_path / "python", f"echo 'Traceback' >&2; echo '{words}' >&2; exit 1")
    with pytest.raises(UsageError) as refused:
        check_packages(program)
    for part in (program, words, "make ros2-env", "HELIOS_ROS2_PYTHON"):
        assert part in str(refused.value)


def test_a_python_that_imports_both_is_accepted(tmp_path: Path) -> None:
    check_packages(fake_python(tmp_path / "python", "exit 0"))


def test_a_program_that_is_not_there_is_named() -> None:
    with pytest.raises(UsageError, match="/no/python"):
        ros2_python("/no/python")
    assert ros2_python(sys.executable) == sys.executable
