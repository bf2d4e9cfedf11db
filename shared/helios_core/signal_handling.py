"""Signal handling in a separate thread, where it is safe to take locks.

A Python signal handler runs in the main thread, between two of its instructions. The main thread
may then hold the lock of the Event that the handler sets; and while it waits inside a library, the
handler does not run. So the handler does nothing: the interpreter writes the signal's number into a
pipe at once, and a thread reads it.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterable


def on_signals(numbers: Iterable[int], then: Callable[[], None]) -> None:
    """Call `then` in a separate thread on each of the signals. Call this once per process, from the
    main thread."""
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
