"""File that keeps a stop over restarts of the bridge, for drivers whose stop ends with them."""

from __future__ import annotations

import logging
import threading
from pathlib import Path

from helios_core.atomic_file import write_file
from helios_core.printable_text import printable

from helios_bridge.driver_executor import DriverExecutor

log = logging.getLogger(__name__)

FILE_NAME = "stopped.txt"
UNREADABLE = "a stop from before the restart, whose reason cannot be read"


class StopLatch:
    """Stop reason in the folder `directory`; None keeps nothing. Thread-safe.

    A thread of its own writes the newest reason, so that a slow disk delays no stop. A disk that
    refuses a write never prevents a stop or its end: the fault goes to the log.
    """

    def __init__(self, directory: Path | None, executor: DriverExecutor) -> None:
        self._path = directory / FILE_NAME if directory else None
        self._executor = executor
        self._changed = threading.Condition()
        self._newest, self._asked = "", 0  # newest reason and its number
        self._tried = 0  # number of the last reason that was written, or that the disk refused
        self._writing = False

    def read(self) -> str:
        """Reason of the stop that holds; empty without one. An unreadable file counts as a stop."""
        if self._path is None:
            return ""
        try:
            return printable(self._path.read_text().strip()) or UNREADABLE
        except FileNotFoundError:
            return ""
        except (OSError, UnicodeError) as error:
            log.error("%s cannot be read (%s); the robot stays stopped", self._path, error)
            return UNREADABLE

    def keep(self, reason: str) -> None:
        """Begin to write a stop, or to forget it if `reason` is empty. Does not wait."""
        if self._path is None:
            return
        with self._changed:
            self._newest, self._asked = reason, self._asked + 1
            if self._writing:
                return
            self._writing = True
        path = self._path
        self._executor.start("writing of the stop", lambda: self._write_newest(path))

    def wait(self, within_s: float) -> None:
        """Wait until the disk has taken or refused the newest reason; log it if it has not."""
        with self._changed:
            asked = self._asked
            if self._changed.wait_for(lambda: self._tried >= asked, within_s):
                return
        log.error(
            "the disk has not taken the newest state of the stop yet; a restart of the bridge now "
            "would begin with the state before it"
        )

    def _write_newest(self, path: Path) -> None:
        """Write until the newest reason is written."""
        while True:
            with self._changed:
                if self._tried == self._asked:
                    self._writing = False
                    return
                reason, number = self._newest, self._asked
            if reason:
                _write(path, reason)
            else:
                _remove(path)
            with self._changed:
                self._tried = number
                self._changed.notify_all()


def _write(path: Path, reason: str) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_file(path, f"{reason}\n")
    except (OSError, UnicodeError) as error:
        log.error(
            "the stop is not on the disk (%s), so a restart of the bridge would lose it; make "
            "room there, or make the folder writable",
            error,
        )


def _remove(path: Path) -> None:
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        log.error("%s cannot be removed (%s); the next start is stopped", path, error)
