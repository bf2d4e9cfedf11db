"""Helpers for all tests."""

from __future__ import annotations

import contextlib
import importlib
import itertools
import os
import re
import socket
import threading
import time
from collections.abc import Callable, Iterable
from pathlib import Path

import httpx
from helios_core.settings import ServiceSettings

# `httpx.get` loads the CA certificates at every call: 25 ms of processor time per request.
LOOPBACK = httpx.Client(
    verify=False, trust_env=False, timeout=60, limits=httpx.Limits(max_keepalive_connections=0)
)


FIRST_PORT, PORTS = 10_000, 1_000  # below the ports that the system hands out


_first = FIRST_PORT + PORTS * int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
_ports = itertools.cycle(_first + (os.getpid() + i) % PORTS for i in range(PORTS))


def free_port() -> int:
    """Return a free TCP port on loopback. Parallel test processes get others."""
    for port in itertools.islice(_ports, PORTS):
        with socket.socket() as s, contextlib.suppress(OSError):
            s.bind(("127.0.0.1", port))
            return port
    raise AssertionError(f"none of {PORTS} ports is free")


def read_to_the_end(lines: Iterable[object]) -> threading.Event:
    """Read a stream in a thread of its own; the event tells that it has ended."""
    over = threading.Event()

    def read() -> None:
        for _ in lines:
            pass
        over.set()

    threading.Thread(target=read, daemon=True).start()
    return over


LONGEST_POLL_S = 1.0
ENDS_WITHIN_S = 30.0  # limit for a process to stop; beyond it, it hangs, also on a busy machine


def wait_until(condition: Callable[[], object], timeout_s: float, what: str) -> None:
    """Poll until the condition holds; fail after the deadline with the text `what`.

    A process that was paused does not lose its time: each poll counts as at most
    `LONGEST_POLL_S`.
    """
    left_s, last_s = timeout_s, time.monotonic()
    while not condition():
        if left_s < 0:
            raise AssertionError(f"waited {timeout_s:g} s in vain until {what}")
        time.sleep(0.02)
        now_s = time.monotonic()
        left_s -= min(now_s - last_s, LONGEST_POLL_S)
        last_s = now_s


def settings_of(module: str) -> type[ServiceSettings]:
    """Return the settings class that the package of a service declares."""
    declared = vars(importlib.import_module(f"{module}.settings")).values()
    [own] = (
        d
        for d in declared
        if isinstance(d, type) and issubclass(d, ServiceSettings) and d is not ServiceSettings
    )
    return own


def python_blocks(page: Path) -> list[str]:
    """Return the Python code blocks of a documentation page, in order."""
    return re.findall(r"```python\n(.*?)```", page.read_text(), re.DOTALL)
