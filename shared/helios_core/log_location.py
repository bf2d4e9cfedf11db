"""Location of this process's log."""

from __future__ import annotations

import os
import stat
import sys
from pathlib import Path


def log_place() -> str:
    """Path of the file that standard error goes to; "its log" if the system cannot tell it."""
    try:
        number = sys.stderr.fileno()
        path = Path(f"/proc/self/fd/{number}").readlink()
        if stat.S_ISREG(os.fstat(number).st_mode) and path.exists():
            return str(path)
    except (OSError, ValueError, AttributeError):  # no such file, closed, captured by a test
        pass
    return "its log"
