"""Start and stop `helios up` in tests, and leave no process behind even if the test fails."""

from __future__ import annotations

import os
import subprocess
import sys
import uuid
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import httpx
import psutil

from tests.support import ENDS_WITHIN_S, LOOPBACK, free_port

MARK = "HELIOS_TEST_MARK"  # environment variable of all started processes, one value per start


@dataclass
class Up:
    """A running `helios up`."""

    process: subprocess.Popen[bytes]
    port: int
    router_port: int
    state: Path  # its state folder; `up.log` in it is its output

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    @property
    def router(self) -> str:
        return f"tcp/127.0.0.1:{self.router_port}"

    def ready(self) -> bool:
        """Return whether a task can be done. Raises AssertionError if the process has ended."""
        ended = self.process.poll()
        assert ended is None, f"ended with {ended}: {(self.state / 'up.log').read_text()[-2000:]}"
        return is_ready(self.port)


U = TypeVar("U", bound=Up)

# Limits of services that may wait for a core: tests share the machine.
PATIENT = {
    "HELIOS_BRIDGE_STOP_TIMEOUT_S": "10",
    "HELIOS_GATEWAY_STOP_TIMEOUT_S": "20",
    "HELIOS_GATEWAY_CALL_TIMEOUT_S": "30",
}


def is_ready(port: int) -> bool:
    """Return whether the gateway reports ready; False where no gateway answers."""
    try:
        return LOOPBACK.get(f"http://127.0.0.1:{port}/readyz").status_code == 200
    except httpx.TransportError:
        return False


@contextmanager
def helios_up(
    state: Path, *flags: str, kind: type[U] = Up, environment: Mapping[str, str] | None = None
) -> Iterator[U]:
    """Start `helios up` on free ports. Does not wait until it is ready."""
    port, router_port = free_port(), free_port()
    argv = [
        sys.executable, "-m", "helios_client", "up", *flags, "--port", str(port),
        "--router-port", str(router_port), "--state", str(state),
    ]  # fmt: skip
    variables = PATIENT | {"MUJOCO_GL": "egl"} | dict(environment or {})
    with started(argv, state / "up.log", variables) as process:
        yield kind(process, port, router_port, state)


@contextmanager
def started(
    argv: Sequence[str], log: Path, environment: Mapping[str, str], cwd: Path | None = None
) -> Iterator[subprocess.Popen[bytes]]:
    """Run a command that starts other processes; stop it after the block.

    Prints the output if the block fails. Raises AssertionError if the command leaves a process
    behind, TimeoutExpired if it does not stop on SIGTERM. Kills all its processes in any case.
    """
    mark = uuid.uuid4().hex
    log.parent.mkdir(parents=True, exist_ok=True)
    with log.open("wb") as out:
        process = subprocess.Popen(
            argv,
            stdout=out,
            stderr=subprocess.STDOUT,
            cwd=cwd,
            env=os.environ | dict(environment) | {MARK: mark},
        )
    try:
        yield process
    except BaseException:
        print(log.read_text(errors="replace"))
        raise
    finally:
        _end(process, mark)


def left_of(mark: str) -> list[psutil.Process]:
    """Return all running processes with this mark."""
    return [p for p in psutil.process_iter() if _environment(p).get(MARK) == mark]


def _end(process: subprocess.Popen[bytes], mark: str) -> None:
    left: list[psutil.Process] = []
    try:
        process.terminate()
        process.wait(ENDS_WITHIN_S)
    finally:
        left = left_of(mark)
        for other in left:
            with suppress(psutil.NoSuchProcess):
                other.kill()
        process.wait()
    assert left == [], "it left processes behind"


def _environment(process: psutil.Process) -> dict[str, str]:
    try:
        return process.environ()
    except psutil.Error:  # the process has ended, or belongs to another user
        return {}
