"""Signals, handled where locks may be taken and whatever the main thread does.

A Python signal handler runs in the main thread, between two of its instructions: also while that
thread holds the lock of the very Event that the handler wants to set, and not at all while it
waits inside a library. So nothing is done there: the interpreter itself writes the signal's number
into a pipe the moment it comes, and a thread does the rest.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterable


def on_signals(numbers: Iterable[int], then: Callable[[], None]) -> None:
    """Call `then` in a thread of its own whenever one of the signals comes. In the main thread,
    once in a process."""
    wanted = set(numbers)
    read, write = os.pipe()
    os.set_blocking(write, False)

    def pass_on() -> None:
        while came := os.read(read, 1):
            if came[0] in wanted:
                then()

    threading.Thread(target=pass_on, name="signals", daemon=True).start()
    signal.set_wakeup_fd(write, warn_on_full_buffer=False)
    for number in wanted:
        signal.signal(number, lambda *_: None)
