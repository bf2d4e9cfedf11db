"""The folder that a run writes into: one run at a time, and what is wrong with it in a sentence."""

from __future__ import annotations

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from helios_client.usage_errors import UsageError
from helios_core.errors import Conflict, Unavailable

LOCK = "run.lock"


@contextmanager
def held(folder: Path) -> Iterator[None]:
    """Make the folder if need be, and hold it until left; a process that is killed lets go of it.

    Two runs at once would play the same episodes. Raises Conflict while another one has the folder,
    UsageError where a file is, and Unavailable where nothing can be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError) as error:
        raise UsageError(f"{folder} cannot be a folder: a file is there; take another") from error
    except OSError as error:
        raise _unwritable(folder, error) from error
    with writing(folder):
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
def writing(folder: Path) -> Iterator[None]:
    """What is written within fails with a sentence. Raises Unavailable."""
    try:
        yield
    except OSError as error:
        raise _unwritable(folder, error) from error


def _unwritable(folder: Path, error: OSError) -> Unavailable:
    return Unavailable(
        f"cannot write to {folder} ({error.strerror or error}); mend that, then give the same "
        "command again"
    )
