"""Proof on disk that the store holds all published data of the tasks.

The proof is a file. It is removed at the first write that fails, which a full disk allows, and
written again once everything is stored. A planner that finds none resumes no task.
"""

from __future__ import annotations

import logging
import os
from pathlib import Path

from helios_core.atomic_file import write_file

log = logging.getLogger(__name__)

_TEXT = b"All that was told of the tasks is in tasks.sqlite.\n"


class WriteProof:
    """The proof file. Not thread-safe: the store calls it under its lock."""

    def __init__(self, path: Path) -> None:
        self._path = path

    @property
    def holds(self) -> bool:
        return self._path.is_file()

    def write(self) -> str:
        """Write the proof; returns the error and its remedy, empty on success."""
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
                self._path,
                error.strerror,
            )

    def _sync_folder(self) -> None:
        folder = os.open(self._path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
