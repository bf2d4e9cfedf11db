"""Tests that `started` leaves no process behind, however the command ends."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from tests import helios_up
from tests.helios_up import started
from tests.support import ENDS_WITHIN_S, wait_until

# Starts a process that ignores SIGTERM, and prints its pid.
PROGRAM = """
import signal, subprocess, sys, time
stubborn = "import signal, time; signal.signal(15, signal.SIG_IGN); time.sleep(600)"
child = subprocess.Popen([sys.executable, "-c", stubborn])
print(child.pid, flush=True)
"""
STUBBORN = "signal.signal(15, signal.SIG_IGN); print('deaf', flush=True); time.sleep(600)"


def gone(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True


def test_processes_left_by_a_command_are_ended_and_reported(tmp_path: Path) -> None:
    """The command itself has already ended."""
    log = tmp_path / "log"
    with (
        pytest.raises(AssertionError, match="left processes"),
        started([sys.executable, "-c", PROGRAM], log, {}) as process,
    ):
        process.wait(ENDS_WITHIN_S)
    child = int(log.read_text())
    wait_until(lambda: gone(child), ENDS_WITHIN_S, "what it left has ended")


def test_a_command_that_does_not_end_is_killed_with_its_child_processes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(helios_up, "ENDS_WITHIN_S", 0.1)
    log = tmp_path / "log"
    with (
        pytest.raises(subprocess.TimeoutExpired),
        started([sys.executable, "-c", PROGRAM + STUBBORN], log, {}) as process,
    ):
        wait_until(lambda: "deaf" in log.read_text(), ENDS_WITHIN_S, "it runs")
    child = int(log.read_text().split()[0])
    for pid in (process.pid, child):
        wait_until(lambda pid=pid: gone(pid), ENDS_WITHIN_S, "it has ended")
