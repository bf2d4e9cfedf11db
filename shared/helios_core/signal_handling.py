"""Signal handling in a separate thread, where it is safe to take locks.

A Python signal handler runs in the main thread, between two of its instructions. The main thread
may then hold the lock of the Event that the handler sets; and while it waits inside a library, the
handler does not run. So the handler does nothing: the interpreter writes the signal's number into a
pipe at once, and a thread reads it.
"""

from __future__ import annotations

import logging
import os
import signal
import threading
import time
from collections.abc import Callable, Iterable

log = logging.getLogger(__name__)

STOP_WITHIN_S = 2.0
ALARM_AFTER_S = 10.0  # the interpreter may take seconds to end on a busy machine


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


def ending_signals() -> tuple[int, ...]:
    """Signals that end a process: SIGTERM, SIGINT, and SIGHUP (sent when a terminal session
    closes), except for a process started with `nohup`."""
    hangup = getattr(signal, "SIGHUP", None)  # missing on some systems
    if hangup is None or signal.getsignal(hangup) is signal.SIG_IGN:
        return (signal.SIGTERM, signal.SIGINT)
    return (signal.SIGTERM, signal.SIGINT, hangup)


def stop_on_signals(stopped: threading.Event) -> None:
    """Set `stopped` on `ending_signals`, and when the parent process ends.

    The process exits two seconds later at the latest, also during a long start or if a library
    hangs while it closes. If no Python thread can run, even after `main` has returned, SIGALRM ends
    the process after ALARM_AFTER_S.
    """
    on_signals(ending_signals(), stopped.set)
    parent = os.getppid()

    def watch_parent() -> None:
        while not stopped.wait(0.5):
            if os.getppid() != parent:
                stopped.set()

    def leave() -> None:
        stopped.wait()
        signal.setitimer(signal.ITIMER_REAL, ALARM_AFTER_S)  # SIGALRM ends the process
        time.sleep(STOP_WITHIN_S)
        log.error("did not stop within %.1f s; leaving", STOP_WITHIN_S)
        os._exit(1)

    threading.Thread(target=watch_parent, name="watch parent", daemon=True).start()
    threading.Thread(target=leave, name="leave", daemon=True).start()
