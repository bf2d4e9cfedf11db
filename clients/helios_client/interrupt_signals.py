"""SIGINT and SIGTERM of a command that has processes, threads and files to end in order.

A second Ctrl-C that raises while a session is being closed leaves its threads running, and the end
of the interpreter then aborts the process. So signals are noted here, and raised only where nothing
is open. Imports the standard library alone.
"""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager

NUMBERS = (signal.SIGINT, signal.SIGTERM)
TOGETHER_S = 0.3  # signals that follow one another so fast are one


class Bursts:
    """A signal handler that raises KeyboardInterrupt once for a burst of signals."""

    def __init__(self) -> None:
        self._last_s = -TOGETHER_S

    def __call__(self, *_: object) -> None:
        now_s = time.monotonic()
        new, self._last_s = now_s - self._last_s >= TOGETHER_S, now_s
        if new:
            raise KeyboardInterrupt


class Interrupts:
    """What has come since `noted_interrupts` was entered."""

    def __init__(self) -> None:
        self.came = False
        self._raises = False

    def check(self) -> None:
        """Raises KeyboardInterrupt when a signal has come."""
        if self.came:
            raise KeyboardInterrupt

    @contextmanager
    def raised(self) -> Iterator[None]:
        """The first signal raises KeyboardInterrupt at once: for a long computation."""
        self._raises = True
        try:
            self.check()
            yield
        finally:
            self._raises = False
        self.check()  # a finalizer may have swallowed it

    def note(self, *_: object) -> None:
        """The signal handler."""
        first, self.came = not self.came, True
        if first and self._raises:
            raise KeyboardInterrupt


@contextmanager
def noted_interrupts() -> Iterator[Interrupts]:
    """Note SIGINT and SIGTERM. Once one has come, further ones do nothing, after the block too: the
    command is ending. In the main thread."""
    interrupts = Interrupts()
    before = {number: signal.signal(number, interrupts.note) for number in NUMBERS}
    try:
        yield interrupts
    finally:
        if not interrupts.came:
            for number, handler in before.items():
                signal.signal(number, handler)


def ignore_interrupts() -> None:
    """Ctrl-C does nothing while the interpreter ends; SIGTERM ends it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
