"""The map on disk: written every few seconds while it changes, read when the service starts.

A file is replaced as a whole, so that a process that is killed leaves the old or the new one. One
that cannot be read is kept aside under another name.
"""

from __future__ import annotations

import logging
import os
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from helios_core.health import Health

log = logging.getLogger(__name__)

FILE_NAME = "objects.npz"


@dataclass(frozen=True)
class Kept:
    """A file of an earlier process."""

    data: bytes
    age_s: float  # since it was written


class Keeper:
    """Writes what `changed` gives, in a thread of its own, until closed."""

    def __init__(
        self,
        folder: Path,
        every_s: float,
        changed: Callable[[], bytes | None],
        health: Health,
    ) -> None:
        """changed: the file as it should be now, or None where nothing changed since the last."""
        self._path = folder / FILE_NAME
        self._every_s, self._changed, self._health = every_s, changed, health
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="keep the map", daemon=True)

    def found(self) -> Kept | None:
        """The file of an earlier process; None where there is none."""
        try:
            written_s = self._path.stat().st_mtime
            return Kept(self._path.read_bytes(), max(0.0, time.time() - written_s))
        except FileNotFoundError:
            return None

    def put_aside(self) -> Path:
        """Move a file that cannot be used out of the way; returns where it is now."""
        aside = self._path.with_name(f"{FILE_NAME}.refused-{time.time_ns()}")
        self._path.replace(aside)
        return aside

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        """Write what is not written yet, and end."""
        self._stop.set()
        if self._thread.ident is not None:
            self._thread.join()
        self.write()

    def write(self) -> None:
        """Write a changed map. A disk that refuses is said, and tried again the next time."""
        try:
            data = self._changed()
            if data is None:
                return
            self._path.parent.mkdir(parents=True, exist_ok=True)
            half = self._path.with_name(f".{FILE_NAME}.{os.getpid()}")
            with half.open("wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            half.replace(self._path)
        except OSError as error:
            self._health.count("saves_failed")
            log.error("the map cannot be written to %s: %s", self._path, error)

    def _run(self) -> None:
        while not self._stop.wait(self._every_s):
            self.write()
