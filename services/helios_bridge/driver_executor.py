"""Threads that use the driver or write the stop to the disk; their calls may never return.

A driver is external code and may hang. No thread waits for it without limit: requests have a
deadline, and threads that still hang at the end are named and abandoned. The process then exits
without the interpreter's shutdown, because a daemon thread that wakes up in a C++ or Rust library
after it aborts the process ("exception not rethrown").
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from concurrent.futures import Future


class DriverExecutor:
    """Starts jobs in daemon threads. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._threads: list[threading.Thread] = []

    def start(self, name: str, job: Callable[[], None]) -> None:
        """Run a job in its own thread."""
        thread = threading.Thread(target=job, name=name, daemon=True)
        with self._lock:
            self._threads = [t for t in self._threads if t.is_alive() or t.ident is None]
            self._threads.append(thread)
        thread.start()

    def begin(self, name: str, do: Callable[[], None]) -> Future[None]:
        """Run a job in its own thread. Returns the future of its result."""
        done: Future[None] = Future()

        def run() -> None:
            try:
                done.set_result(do())
            except BaseException as error:
                done.set_exception(error)

        self.start(name, run)
        return done

    def wait(self, within_s: float) -> list[str]:
        """Wait for the threads. Returns the names of those that have not ended in time."""
        deadline_s = time.monotonic() + within_s
        with self._lock:
            threads = [t for t in self._threads if t is not threading.current_thread()]
        for thread in threads:
            thread.join(max(0.0, deadline_s - time.monotonic()))
        return [thread.name for thread in threads if thread.is_alive()]
