"""Helpers for all tests."""

from __future__ import annotations

import importlib
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
    verify=False, trust_env=False, timeout=10, limits=httpx.Limits(max_keepalive_connections=0)
)


def free_port() -> int:
    """Return a TCP port on loopback that was free a moment ago."""
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return int(s.getsockname()[1])


def read_to_the_end(lines: Iterable[object]) -> threading.Event:
    """Read a stream in a thread of its own; the event tells that it has ended."""
    over = threading.Event()

    def read() -> None:
        for _ in lines:
            pass
        over.set()

    threading.Thread(target=read, daemon=True).start()
    return over


ENDS_WITHIN_S = 30.0  # limit for a process to stop; beyond it, it hangs, also on a busy machine


def wait_until(condition: Callable[[], object], timeout_s: float, what: str) -> None:
    """Poll until the condition holds; fail after the deadline with the text `what`."""
    deadline = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > deadline:
            raise AssertionError(f"waited {timeout_s:g} s in vain until {what}")
        time.sleep(0.02)


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
