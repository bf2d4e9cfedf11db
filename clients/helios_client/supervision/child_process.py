"""One child process with a log file of its own: started, watched, ended with its process group."""

from __future__ import annotations

import contextlib
import json
import logging
import os
import shutil
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from helios_core.errors import Unavailable

from helios_client.supervision import parent_watch
from helios_client.supervision.forked_process import ENVIRONMENT, ForkedProcess, ForkServer

log = logging.getLogger(__name__)

TAIL_BYTES = 4096
KEEP_LOG_BYTES = 8_000_000  # a larger log becomes the older one, and a new one begins
USAGE_ERROR = 2  # exit status of wrong use: a restart does not help


@dataclass(frozen=True)
class ProcessSpec:
    """Name and command line of a process."""

    name: str
    argv: tuple[str, ...]
    ends_last: bool = False  # other processes need it while they end: the router
    hosts: tuple[str, ...] = ()  # services in it; none: one with the name of the process

    @property
    def services(self) -> tuple[str, ...]:
        """Names of the services in it."""
        return self.hosts or (self.name,)


@dataclass(frozen=True)
class ProcessExit:
    """Exit status and last output line of an ended process."""

    status: int | None  # as in `subprocess`: negative for a signal; None: never started
    last_output_line: str  # last line of its output

    @property
    def usage_error(self) -> bool:
        return self.status == USAGE_ERROR

    @property
    def reason(self) -> str:
        """One clause: the signal or the exit status, and the last log line if there is one. After
        wrong use only the log line, which says what to do."""
        if self.status is None or (self.usage_error and self.last_output_line):
            return self.last_output_line
        how = (
            f"ended by {_signal_name(-self.status)}"
            if self.status < 0
            else f"exit status {self.status}"
        )
        return f"{how}; last log line: {self.last_output_line}" if self.last_output_line else how


class ChildProcess:
    """Running process in a session of its own, which a terminal's Ctrl-C does not reach."""

    def __init__(
        self, spec: ProcessSpec, log_path: Path, fork_server: ForkServer | None = None
    ) -> None:
        """Start the process. Raises OSError if that fails. Call it from a thread that outlives the
        process.

        fork_server: forks modules of this interpreter; None: each has an interpreter of its own.
        """
        self.spec = spec
        self._log_path = log_path
        log_path.parent.mkdir(parents=True, exist_ok=True)
        if log_path.exists() and log_path.stat().st_size > KEEP_LOG_BYTES:
            log_path.replace(log_path.with_suffix(".log.1"))
        with log_path.open("ab") as file:
            self._log_start = file.tell()
            self._process = _forked(spec, log_path, fork_server) or _spawned(spec, file)
        self.pid = self._process.pid

    def poll_exit(self) -> ProcessExit | None:
        """Ending of the process, None while it runs. After the end it kills the rest of the process
        group. Meanwhile it keeps the log small."""
        status = self._process.poll()
        if status is None:
            self._limit_log()
            return None
        self._kill_group()
        return ProcessExit(status, last_line(self._log_path, self._log_start))

    def terminate(self) -> None:
        """Send SIGTERM."""
        if self._process.poll() is None:
            self._process.terminate()

    def kill(self) -> None:
        """Kill the process and its process group at once."""
        self._kill_group()
        self._process.wait()

    def wait(self, timeout_s: float) -> bool:
        """True if the process ends within the timeout. Then kills the rest of its process group."""
        try:
            self._process.wait(max(0.0, timeout_s))
        except subprocess.TimeoutExpired:
            return False
        self._kill_group()
        return True

    def _limit_log(self) -> None:
        """Move a log that has become large to `.log.1`. The process has it open, so its content is
        copied and the file emptied; lines that are written meanwhile are lost."""
        try:
            if self._log_path.stat().st_size <= KEEP_LOG_BYTES:
                return
            older = self._log_path.with_suffix(".log.1")
            older.unlink(missing_ok=True)  # the disk may have no room for both
            try:
                shutil.copyfile(self._log_path, older)
            except OSError as error:
                log.warning("the older lines of %s are lost: %s", self._log_path, error)
            os.truncate(self._log_path, 0)
            self._log_start = 0
        except OSError:
            return  # somebody moved the log, or the disk fails: the process goes on

    def _kill_group(self) -> None:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self.pid, signal.SIGKILL)


def _forked(
    spec: ProcessSpec, log_path: Path, fork_server: ForkServer | None
) -> ForkedProcess | None:
    """Process of a module of this interpreter; None if it has to be spawned."""
    python, *rest = spec.argv
    if fork_server is None or python != sys.executable or rest[:1] != ["-m"]:
        return None
    try:
        return fork_server.fork(rest[1], rest[2:], log_path)
    except Unavailable as error:
        log.warning("%s starts with an interpreter of its own: %s", spec.name, error.message)
        return None


def _spawned(spec: ProcessSpec, output: IO[bytes]) -> subprocess.Popen[bytes]:
    program = shutil.which(spec.argv[0])
    if program is None:
        raise FileNotFoundError(f"there is no program {spec.argv[0]}")
    watch = (sys.executable, "-I", "-S", parent_watch.__file__, str(os.getpid()))
    return subprocess.Popen(
        (*watch, program, *spec.argv[1:]),
        stdin=subprocess.DEVNULL,
        stdout=output,
        stderr=subprocess.STDOUT,
        start_new_session=True,
        env=ENVIRONMENT | os.environ,
    )


def last_line(path: Path, start: int) -> str:
    """Last line after byte `start` of a log that is meant for a person ("helios-name: sentence"),
    or else the last line that is not blank."""
    try:
        with path.open("rb") as file:
            end = file.seek(0, os.SEEK_END)
            file.seek(max(start, end - TAIL_BYTES))
            lines = file.read().decode(errors="replace").splitlines()
    except OSError:
        return ""
    said = [line.strip() for line in reversed(lines) if line.strip()]
    chosen = next((line for line in said if line.startswith("helios-")), said[0] if said else "")
    return _message(chosen)


def _message(line: str) -> str:
    """Message in a line of JSON, as of `log_format`; any other line as it is."""
    if not line.startswith("{"):
        return line
    try:
        return str(json.loads(line)["message"])
    except (ValueError, KeyError, TypeError):
        return line


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"
