"""Wrong use of the command line: its error type, and checks of numbers and output files."""

from __future__ import annotations

import math
import os
from pathlib import Path

from helios_core.atomic_file import unwritable_reason
from helios_core.errors import HeliosError


class UsageError(HeliosError):
    """Wrong use of a command: exit status 2."""


def check_finite(option: str, value: float | None) -> None:
    """Raise UsageError if the value of an option is infinite or not a number; None: not given."""
    if value is not None and not math.isfinite(value):
        raise UsageError(f"{option} is {value}; wanted a finite number")


def check_folder(folder: Path) -> None:
    """Make a folder that a long run writes to. Raises UsageError if it cannot be made or written
    to."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(
            f"the folder {folder} cannot be made: {error.strerror}; choose another"
        ) from error
    if not os.access(folder, os.W_OK):
        raise UsageError(f"you may not write to the folder {folder}; choose another")


def check_writable(path: Path) -> None:
    """Make the folder of a file that a long run writes at its end. Raises UsageError if the file
    cannot be written."""
    check_folder(path.parent)
    if why := unwritable_reason(path):
        raise UsageError(why)
