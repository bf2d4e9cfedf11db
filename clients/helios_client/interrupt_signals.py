"""SIGINT and SIGTERM in commands that must end processes, threads and files in order.

A second Ctrl-C that raises while a session is being closed leaves its threads running, and the exit
of the interpreter then aborts the process. So signals are noted here, and raised only where nothing
is open. Imports only the standard library.
"""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager

NUMBERS = (signal.SIGINT, signal.SIGTERM)
TOGETHER_S = 0.3  # signals closer together than this count as one


class BurstHandler:
    """Signal handler that raises KeyboardInterrupt once per burst of signals."""

    def __init__(self) -> None:
        self._last_s = -TOGETHER_S

    def __call__(self, *_: object) -> None:
        now_s = time.monotonic()
        new, self._last_s = now_s - self._last_s >= TOGETHER_S, now_s
        if new:
            raise KeyboardInterrupt


class Interrupts:
    """Record of the signals received since `noted_interrupts` was entered."""

    def __init__(self) -> None:
        self.came = False
        self._raises = False

    def check(self) -> None:
        """Raise KeyboardInterrupt if a signal has come."""
        if self.came:
            raise KeyboardInterrupt

    @contextmanager
    def raised(self) -> Iterator[None]:
        """Context in which the first signal raises KeyboardInterrupt at once: for a long
        computation."""
        self._raises = True
        try:
            self.check()
            yield
        finally:
            self._raises = False
        self.check()  # a finalizer may have swallowed the exception

    def note(self, *_: object) -> None:
        """Signal handler: note the signal, and raise if it is the first inside `raised`."""
        first, self.came = not self.came, True
        if first and self._raises:
            raise KeyboardInterrupt


@contextmanager
def noted_interrupts() -> Iterator[Interrupts]:
    """Context that notes SIGINT and SIGTERM, in the main thread. After the first one, further ones
    have no effect, even after the block: the command is ending."""
    interrupts = Interrupts()
    before = {number: signal.signal(number, interrupts.note) for number in NUMBERS}
    try:
        yield interrupts
    finally:
        if not interrupts.came:
            for number, handler in before.items():
                signal.signal(number, handler)


def ignore_interrupts() -> None:
    """Ignore Ctrl-C while the interpreter exits; SIGTERM ends it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
