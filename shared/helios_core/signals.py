"""Signals, handled where locks may be taken.

A Python signal handler interrupts the main thread anywhere, also while it holds the lock of the
very Event that the handler wants to set: then both wait for ever. So the handler only writes a
byte, and a thread does the rest.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterable


def on_signals(numbers: Iterable[int], then: Callable[[], None]) -> None:
    """Call `then` in a thread of its own whenever one of the signals comes. Main thread only."""
    read, write = os.pipe()
    os.set_blocking(write, False)

    def pass_on() -> None:
        while os.read(read, 1):
            then()

    def note(_number: int, _frame: object) -> None:
        os.write(write, b"!")

    threading.Thread(target=pass_on, name="signals", daemon=True).start()
    for number in numbers:
        signal.signal(number, note)
