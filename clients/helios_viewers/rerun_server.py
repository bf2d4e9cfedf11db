"""Rerun's server for viewers on this machine, as a child process, with its page for the browser.

The server inside Rerun's Python package listens on all networks, so its command-line program is
started instead, which can be bound to this machine.
"""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import threading
import time
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path

from helios_client.supervision import parent_watch
from helios_core.errors import Conflict, Unavailable

HOST = "127.0.0.1"
START_WITHIN_S = 60.0
END_WITHIN_S = 3.0
CHECK_PERIOD_S = 0.05
NO_USAGE_DATA = {"CI": "true"}  # the program sends none then


class RerunServer:
    """Rerun's server for viewers on this machine, as a child process, with its web page."""

    def __init__(self, port: int, web_port: int, stopping: threading.Event) -> None:
        """Raises Unavailable if it does not start, and Conflict for a port in use."""
        _check_free(port, "--rerun-port")
        _check_free(web_port, "--web-port")
        self.url = f"rerun+http://{HOST}:{port}/proxy"
        self.page = f"http://{HOST}:{web_port}/?url=rerun%2Bhttp%3A%2F%2F{HOST}%3A{port}%2Fproxy"
        watch = (sys.executable, parent_watch.__file__, str(os.getpid()))
        serve = (str(program()), "--serve-web", "--bind", HOST)
        ports = ("--port", str(port), "--web-viewer-port", str(web_port))
        self._process = subprocess.Popen(
            [*watch, *serve, *ports],
            env=os.environ | NO_USAGE_DATA,
            start_new_session=True,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            self._wait_for(port, stopping)
            self._wait_for(web_port, stopping)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """End the server; viewers keep what they have received."""
        self._process.terminate()
        try:
            self._process.wait(END_WITHIN_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _wait_for(self, port: int, stopping: threading.Event) -> None:
        deadline_s = time.monotonic() + START_WITHIN_S
        while not stopping.wait(CHECK_PERIOD_S):
            with suppress(OSError), socket.create_connection((HOST, port), 1.0):
                return
            if self._process.poll() is not None or time.monotonic() > deadline_s:
                raise Unavailable(
                    f"Rerun's server did not start on port {port}; run `rerun --serve-web` to see "
                    "why, or save a file with --save"
                )


def program() -> Path:
    """Rerun's program in its package. `python -m rerun` starts it as a further process, which a
    signal to the first one does not end. Raises Unavailable if it is not there."""
    found = find_spec("rerun_cli")
    folder = Path(found.origin).parent if found and found.origin else Path()
    for name in ("rerun", "rerun.exe"):
        if (folder / name).is_file():
            return folder / name
    raise Unavailable("Rerun's program is missing; pip install --force-reinstall rerun-sdk")


def _check_free(port: int, flag: str) -> None:
    with socket.socket() as s:
        s.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            s.bind((HOST, port))
        except OSError as error:
            raise Conflict(
                f"port {port} cannot be used ({error.strerror}); choose another with {flag}"
            ) from error
