"""The bridge's threads that use the driver, and calls that may never come back.

A driver is somebody else's code, which may hang. Nobody waits for it for ever: what must be
answered has a deadline, and what still hangs at the end is named and left behind. The process then
ends without the interpreter's own farewell: a daemon thread that wakes up in a library of C++ or
Rust after it aborts the process ("exception not rethrown").
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from concurrent.futures import Future


class DriverExecutor:
    """Thread-safe. All threads are daemons."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._threads: list[threading.Thread] = []

    def start(self, name: str, job: Callable[[], None]) -> None:
        """Run a job in a thread of its own."""
        thread = threading.Thread(target=job, name=name, daemon=True)
        with self._lock:
            self._threads = [t for t in self._threads if t.is_alive() or t.ident is None]
            self._threads.append(thread)
        thread.start()

    def begin(self, name: str, do: Callable[[], None]) -> Future[None]:
        """Do it in a thread of its own; what came of it, once it is over."""
        done: Future[None] = Future()

        def run() -> None:
            try:
                done.set_result(do())
            except BaseException as error:
                done.set_exception(error)

        self.start(name, run)
        return done

    def wait(self, within_s: float) -> list[str]:
        """The names of the threads that have not ended in time."""
        deadline_s = time.monotonic() + within_s
        with self._lock:
            threads = [t for t in self._threads if t is not threading.current_thread()]
        for thread in threads:
            thread.join(max(0.0, deadline_s - time.monotonic()))
        return [thread.name for thread in threads if thread.is_alive()]
