"""A proof, on disk, that the store holds all that was told of the tasks.

It is a file that is there while it does. It is removed at the first write that fails, which a full
disk allows, and made again when all is written. So a planner that finds none takes up nothing.
"""

from __future__ import annotations

import logging
import os
from pathlib import Path

from helios_core.atomic_file import write_file

log = logging.getLogger(__name__)

_TEXT = b"All that was told of the tasks is in tasks.sqlite.\n"


class WriteProof:
    """See the module. Not thread-safe: its store calls it under its lock."""

    def __init__(self, path: Path) -> None:
        self._path = path

    @property
    def holds(self) -> bool:
        return self._path.is_file()

    def give(self) -> str:
        """Put it on the disk; why that cannot be, and what to do, or nothing."""
        try:
            write_file(self._path, _TEXT)
        except OSError as error:
            self.take()
            return f"{self._path} cannot be written: {error.strerror}; make room on that disk"
        return ""

    def take(self) -> None:
        try:
            self._path.unlink(missing_ok=True)
            self._sync_folder()
        except OSError as error:
            log.error(
                "%s cannot be removed (%s); if the planner ends now, a task may be taken up again "
                "though it has ended",
                self._path, error.strerror,
            )  # fmt: skip

    def _sync_folder(self) -> None:
        folder = os.open(self._path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
