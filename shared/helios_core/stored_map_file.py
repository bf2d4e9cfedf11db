"""File of a stored map: one of another world, kept until the robot has found its place in it."""

from __future__ import annotations

import logging
from pathlib import Path

from helios_core.atomic_file import write_file

log = logging.getLogger(__name__)


class StoredMapFile:
    """A file beside the map file of a service; without a folder nothing is written."""

    def __init__(self, map_file: Path | None, prefix: str = "stored") -> None:
        """map_file: file of the present map; prefix: of the file's name."""
        self._path = None if map_file is None else map_file.with_name(f"{prefix}-{map_file.name}")

    @property
    def exists(self) -> bool:
        return self._path is not None and self._path.exists()

    def read(self) -> bytes | None:
        """Content; None if there is no stored map. Raises OSError."""
        if self._path is None or not self.exists:
            return None
        return self._path.read_bytes()

    def write(self, data: bytes) -> None:
        """Replace the content. After a disk error the stored map is in memory alone."""
        if self._path is None:
            return
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            write_file(self._path, data)
        except OSError as error:
            log.error("%s cannot be written: %s", self._path, error)

    def remove(self) -> None:
        if self._path is None:
            return
        try:
            self._path.unlink(missing_ok=True)
        except OSError as error:
            log.error("%s cannot be removed: %s", self._path, error)
