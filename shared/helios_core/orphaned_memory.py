"""Freeing of shared memory whose process was killed while others still map it. Linux only.

Zenoh removes the memory of a killed process when the next process starts, but not memory that a
live subscriber maps, and a subscriber maps what it once received until it ends. So each process
names its memory in a record, which it locks. The kernel drops the lock of a dead process; another
process then gives the pages back. Subscribers that still map them read zeros.
"""

from __future__ import annotations

import fcntl
import logging
import mmap
import os
import threading
import uuid
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

log = logging.getLogger(__name__)

FOLDER = Path("/dev/shm")
SUFFIX = ".helios"  # of records
SEGMENT = ".zenoh"  # of Zenoh's memory
GRACE_S = 10.0  # a subscriber may still have messages of the dead process in its queue


class MemoryRecord:
    """Record of memory of this process, which lasts as long as the process or until `close`."""

    def __init__(self, segments: Iterable[Path]) -> None:
        """Raises OSError if the record cannot be written."""
        self._path = FOLDER / f"{uuid.uuid4().hex[:12]}{SUFFIX}"
        self._file = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600)
        fcntl.flock(self._file, fcntl.LOCK_EX)
        os.write(self._file, "\n".join(segment.name for segment in segments).encode())

    def close(self) -> None:
        """Remove the record. Call it when the memory has been freed."""
        with suppress(OSError):
            try:
                self._path.unlink()
            finally:
                os.close(self._file)


def mapped_segments() -> set[Path]:
    """Zenoh's shared memory that this process maps; empty where the system does not tell."""
    try:
        lines = Path("/proc/self/maps").read_text().splitlines()
    except OSError:
        return set()
    paths = (Path(line.split(maxsplit=5)[-1]) for line in lines if line.endswith(SEGMENT))
    return {path for path in paths if path.parent == FOLDER}


def orphans() -> list[Path]:
    """Records of this user's dead processes."""
    return [path for path in FOLDER.glob(f"*{SUFFIX}") if _names_of_dead(path) is not None]


def free(record: Path) -> int:
    """Give back the memory that the record of a dead process names. Returns the bytes freed."""
    names = _names_of_dead(record)
    if names is None:  # seen before its process had locked it
        return 0
    segments = [n for n in names if n == Path(n).name and n.endswith(SEGMENT)]
    freed = sum(_emptied(FOLDER / name) for name in segments)
    with suppress(OSError):
        record.unlink()
    return freed


def free_orphans_later() -> None:
    """Free the memory of the processes that are dead now, after GRACE_S."""
    found = orphans()
    if not found:
        return

    def run() -> None:
        freed = sum(map(free, found))
        log.info("freed %.0f MB of shared memory of killed processes", freed / 1e6)

    timer = threading.Timer(GRACE_S, run)
    timer.daemon = True
    timer.start()


def _names_of_dead(record: Path) -> list[str] | None:
    """Content of the record of a dead process of this user; None for any other file.

    Every user may write to the folder, and a record of another user may name memory in use.
    """
    try:
        with open(os.open(record, os.O_RDWR | os.O_NOFOLLOW), "rb") as file:
            if os.fstat(file.fileno()).st_uid != os.getuid():
                return None
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return file.read().decode(errors="replace").split()
    except OSError:  # locked, gone, a link, or not readable
        return None


def _emptied(segment: Path) -> int:
    """Return the pages of a segment to the system; processes that map it read zeros."""
    try:
        with segment.open("r+b") as file, mmap.mmap(file.fileno(), 0) as memory:
            size = os.fstat(file.fileno()).st_blocks * 512
            memory.madvise(mmap.MADV_REMOVE)
        segment.unlink()
    except (OSError, ValueError):  # Zenoh has removed it
        return 0
    return size
