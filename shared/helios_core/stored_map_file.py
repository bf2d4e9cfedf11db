"""File of a stored map: one of another world, kept until the robot has found its place in it."""

from __future__ import annotations

import logging
import threading
from pathlib import Path

from helios_core.atomic_file import write_file

log = logging.getLogger(__name__)


class StoredMapFile:
    """A file beside the map file of a service; without a folder nothing is kept.

    New content is in memory until it is written. Write it before the map file of the service, which
    may hold that map until then. Safe to use from several threads.
    """

    def __init__(self, map_file: Path | None, prefix: str = "stored") -> None:
        """map_file: file of the present map; prefix: of the file's name."""
        self._path = None if map_file is None else map_file.with_name(f"{prefix}-{map_file.name}")
        self._unwritten: bytes | None = None
        self._turn = threading.Lock()

    @property
    def exists(self) -> bool:
        return self.unwritten or (self._path is not None and self._path.exists())

    @property
    def unwritten(self) -> bool:
        """True while there is content that is in memory alone."""
        return self._unwritten is not None

    def read(self) -> bytes | None:
        """Content; None if there is no stored map. Raises OSError."""
        unwritten = self._unwritten
        if unwritten is not None or self._path is None or not self._path.exists():
            return unwritten
        return self._path.read_bytes()

    def put(self, data: bytes) -> None:
        """Replace the content; `write` writes it."""
        if self._path is None:
            return
        with self._turn:
            self._unwritten = data

    def write(self) -> None:
        """Write new content, if any. Raises OSError; then the content stays in memory, for another
        try."""
        with self._turn:
            if self._path is None or self._unwritten is None:
                return
            self._path.parent.mkdir(parents=True, exist_ok=True)
            write_file(self._path, self._unwritten)
            self._unwritten = None

    def remove(self) -> None:
        if self._path is None:
            return
        with self._turn:
            self._unwritten = None
            try:
                self._path.unlink(missing_ok=True)
            except OSError as error:
                log.error("%s cannot be removed: %s", self._path, error)
