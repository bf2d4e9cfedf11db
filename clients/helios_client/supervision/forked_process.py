"""Services forked from a process that has imported the shared libraries already.

See `fork_server.py` and docs/decisions/0013-fork-server.md. Linux only; HELIOS_FORK=0 turns it off.
"""

from __future__ import annotations

import ctypes
import json
import logging
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from helios_core.errors import Unavailable

from helios_client.supervision import fork_server

log = logging.getLogger(__name__)

SWITCH = "HELIOS_FORK"
ANSWER_WITHIN_S = 60.0  # its imports on a busy machine
POLL_S = 0.01
PR_SET_CHILD_SUBREAPER = 36
ENVIRONMENT = {  # of the services, unless the user's has the variable
    "OPENBLAS_NUM_THREADS": "1",  # else OpenBLAS starts threads when it is imported
    "MALLOC_ARENA_MAX": "2",  # the C library keeps free memory per arena, one for each thread
}


class ForkedProcess:
    """Running service, with the part of `subprocess.Popen` that a supervisor needs."""

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self._status: int | None = None

    def poll(self) -> int | None:
        """Exit status, negative for a signal; None while it runs."""
        if self._status is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            if pid:
                self._status = os.waitstatus_to_exitcode(status)
        return self._status

    def terminate(self) -> None:
        """Send SIGTERM."""
        if self.poll() is None:
            os.kill(self.pid, signal.SIGTERM)

    def wait(self, timeout: float | None = None) -> int:
        """Exit status at the end. Raises subprocess.TimeoutExpired."""
        deadline_s = None if timeout is None else time.monotonic() + timeout
        while (status := self.poll()) is None:
            if deadline_s is not None and time.monotonic() >= deadline_s:
                raise subprocess.TimeoutExpired(str(self.pid), timeout or 0.0)
            time.sleep(POLL_S)
        return status


class ForkServer:
    """Fork server of a supervisor. It starts at once, and anew if it has ended."""

    def __init__(self) -> None:
        self._start()

    def fork(self, module: str, args: Sequence[str], log_path: Path) -> ForkedProcess:
        """Start `python -m MODULE ARG …`. Raises Unavailable, with nothing started."""
        request = {"module": module, "args": list(args), "log": str(log_path)}
        if self._process.poll() is not None:
            self.close()
            self._start()
        try:
            answer = self._ask(request)
        except OSError as error:
            self.close()  # else a late answer stays in the socket, and the next call reads it
            raise Unavailable(f"the fork server does not answer: {error}") from error
        if "pid" not in answer:
            raise Unavailable(answer["error"])
        return ForkedProcess(answer["pid"])

    def close(self) -> None:
        """End the server; the services go on."""
        self._requests.close()
        self._process.kill()
        self._process.wait()

    def _ask(self, request: dict) -> dict:
        with _adopting_orphans():
            self._requests.send(json.dumps(request).encode())
            answer = self._requests.recv(fork_server.MESSAGE_BYTES)
        if not answer:
            raise ConnectionError("it has ended")
        return json.loads(answer)

    def _start(self) -> None:
        self._requests, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._requests.settimeout(ANSWER_WITHIN_S)
        with theirs:
            fd = theirs.fileno()
            command = (sys.executable, "-m", fork_server.NAME, str(fd), str(os.getpid()))
            self._process = subprocess.Popen(
                (*command, " " * fork_server.TITLE_BYTES),
                stdin=subprocess.DEVNULL,
                pass_fds=(fd,),
                start_new_session=True,
                env=ENVIRONMENT | os.environ | fork_server.KEEP_ENVIRONMENT,
            )


def is_wanted(environment: Mapping[str, str]) -> bool:
    """True on Linux, unless HELIOS_FORK=0."""
    return sys.platform == "linux" and environment.get(SWITCH, "1") != "0"


@contextmanager
def fork_server_for(several: bool) -> Iterator[ForkServer | None]:
    """Fork server for several services, until the end of the block; None where it is not wanted."""
    if not (several and is_wanted(os.environ)):
        yield None
        return
    server = ForkServer()
    try:
        yield server
    finally:
        server.close()


@contextmanager
def _adopting_orphans() -> Iterator[None]:
    """Within the block, a descendant whose parent ends becomes a child of this process."""
    prctl = ctypes.CDLL(None).prctl
    prctl(PR_SET_CHILD_SUBREAPER, 1)
    try:
        yield
    finally:
        prctl(PR_SET_CHILD_SUBREAPER, 0)
