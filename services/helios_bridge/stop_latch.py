"""File that keeps a stop over restarts of the bridge, for drivers whose stop ends with them."""

from __future__ import annotations

import logging
from pathlib import Path

from helios_core.atomic_file import write_file
from helios_core.printable_text import printable

log = logging.getLogger(__name__)

FILE_NAME = "stopped.txt"
UNREADABLE = "a stop from before the restart, whose reason cannot be read"


class StopLatch:
    """Stop reason in the folder `directory`; None keeps nothing.

    A disk that refuses a write never prevents a stop or its end: the fault goes to the log.
    """

    def __init__(self, directory: Path | None) -> None:
        self._path = directory / FILE_NAME if directory else None

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
        """Keep a stop until `clear`."""
        if self._path is None:
            return
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            write_file(self._path, f"{reason}\n")
        except OSError as error:
            log.error(
                "the stop is not on the disk (%s), so a restart of the bridge would lose it; make "
                "room there, or make the folder writable",
                error,
            )

    def clear(self) -> None:
        """Forget the stop."""
        if self._path is None:
            return
        try:
            self._path.unlink(missing_ok=True)
        except OSError as error:
            log.error("%s cannot be removed (%s); the next start is stopped", self._path, error)
