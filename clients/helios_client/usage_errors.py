"""Wrong use of the command line: its error type, and a check of output files."""

from __future__ import annotations

import os
from pathlib import Path

from helios_core.atomic_file import unwritable_reason
from helios_core.errors import HeliosError


class UsageError(HeliosError):
    """Wrong use of a command: exit status 2."""


def check_writable(path: Path) -> None:
    """Make the folder of a file that a long run writes at its end. Raises UsageError if the file
    cannot be written."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(
            f"the folder {path.parent} cannot be made: {error.strerror}; choose another"
        ) from error
    if why := unwritable_reason(path):
        raise UsageError(why)
    if not os.access(path.parent, os.W_OK):
        raise UsageError(f"you may not write to the folder {path.parent}; choose another")
