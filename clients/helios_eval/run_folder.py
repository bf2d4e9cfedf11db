"""Access to the output folder of a run: exclusive lock, and clear errors where writing fails."""

from __future__ import annotations

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from helios_client.usage_errors import UsageError
from helios_core.errors import Conflict, Unavailable

LOCK = "run.lock"


@contextmanager
def locked_folder(folder: Path) -> Iterator[None]:
    """Create the folder if necessary and lock it for the duration of the block.

    The lock ends with the process, even if it is killed. Two runs at once would play the same
    episodes. Raises Conflict while another run holds the folder, UsageError if the path is a file,
    and Unavailable if the folder cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError) as error:
        raise UsageError(f"{folder} cannot be a folder: a file is there; take another") from error
    except OSError as error:
        raise _unwritable(folder, error) from error
    with write_errors_as_unavailable(folder):
        file = (folder / LOCK).open("a")
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise Conflict(
                f"another run plays into {folder}; wait until it has ended, or take another folder"
            ) from None
        yield


@contextmanager
def write_errors_as_unavailable(folder: Path) -> Iterator[None]:
    """Convert an OSError within the block to Unavailable with a clear message."""
    try:
        yield
    except OSError as error:
        raise _unwritable(folder, error) from error


def _unwritable(folder: Path, error: OSError) -> Unavailable:
    return Unavailable(
        f"cannot write to {folder} ({error.strerror or error}); mend that, then give the same "
        "command again"
    )
