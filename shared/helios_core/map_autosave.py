"""Periodic saving of a service's map to disk, and its recovery at the next start.

An unreadable file is renamed.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from helios_core.atomic_file import remove_temporaries, write_file

log = logging.getLogger(__name__)

PAUSE_PER_WRITE = 20.0  # least pause after a write, in shares of the time that it took
CLOSE_WITHIN_S = 1.0  # longest wait at `close` for a write in progress

# Version on the disk -> (present version, file content), or None if there is nothing newer.
Newer = Callable[[int], tuple[int, bytes] | None]


def of_another_world(written: str) -> str:
    """Health note for a saved map that is unused because the robot is in another world."""
    return (
        f"the map that was kept at {written} has other coordinates than the robot has now; it is "
        "used once the robot has found its place in it: the robot restarted, or its poses jumped, "
        "and its driver names no origin (origin_id) that is still the same"
    )


class WriteOutcome(Enum):
    """Outcome of `AutosavedFile.write`. Only WRITTEN is true; after UNCHANGED, too, the file is as
    new as the map."""

    WRITTEN = "written"
    UNCHANGED = "unchanged"  # there was nothing newer
    FAILED = "failed"  # the file lacks changes

    def __bool__(self) -> bool:
        return self is WriteOutcome.WRITTEN


@dataclass(frozen=True)
class SavedMap:
    """Map file saved by an earlier process."""

    data: bytes
    written: str  # local time of writing: "2026-11-23 14:03:22"


class AutosavedFile:
    """Map file that a thread rewrites every `period_s` between `start` and `close`, and less often
    if a write takes long.

    `newer` supplies the content. After a disk error the next period retries.
    """

    def __init__(
        self, path: Path, period_s: float, newer: Newer, troubled: Callable[[str], None]
    ) -> None:
        """troubled: called with the reason of a failed write, and with "" once a write succeeds."""
        self._path, self._period_s = path, period_s
        self._newer, self._troubled = newer, troubled
        self._version = 0
        self._stopped = threading.Event()
        self._wait_until_s = math.inf  # monotonic; from `close` on no write waits longer
        self._turn = threading.Lock()
        self._thread = threading.Thread(target=self._run, name=f"keep {path.name}", daemon=True)

    def found(self) -> SavedMap | None:
        """File of an earlier process; None if there is none. Raises OSError."""
        remove_temporaries(self._path)
        try:
            written_s = self._path.stat().st_mtime
            written = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(written_s))
            return SavedMap(self._path.read_bytes(), written)
        except FileNotFoundError:
            return None

    def put_aside(self) -> str:
        """Rename an unusable file. Returns a phrase with its new location, for messages."""
        n = 1
        while (aside := self._path.with_name(f"{self._path.name}.refused-{n}")).exists():
            n += 1
        try:
            self._path.replace(aside)
        except OSError as error:
            return f"left at {self._path}, for it cannot be moved ({error.strerror})"
        return f"put aside as {aside}"

    def start(self) -> None:
        self._thread.start()

    def write(self) -> WriteOutcome:
        """Write the present version if it is newer. Waits for a write in progress; once `close` was
        called, only as long as that allows, and then it fails."""
        left_s = max(0.0, self._wait_until_s - time.monotonic())
        if not self._turn.acquire(timeout=-1 if math.isinf(left_s) else left_s):
            log.warning(
                "%s may lack the newest changes of the map, because an earlier write still runs; "
                "see whether its disk hangs",
                self._path,
            )
            return WriteOutcome.FAILED
        try:
            outcome = self._write_if_newer()
        finally:
            self._turn.release()
        if outcome is WriteOutcome.WRITTEN:
            self._troubled("")
        return outcome

    def _write_if_newer(self) -> WriteOutcome:
        """Write the present version if it is newer. The caller holds `_turn`."""
        try:
            newer = self._newer(self._version)
            if newer is None:
                return WriteOutcome.UNCHANGED
            self._replace(newer[1])
        except Exception as error:  # disk or memory: the service continues without saving
            known = isinstance(error, OSError)
            log.error("%s cannot be written: %s", self._path, error, exc_info=not known)
            self._troubled(
                f"the map cannot be kept in {self._path}: "
                f"{(error.strerror if known else '') or repr(error)}; "
                "make room there, or give another --state-dir"
            )
            return WriteOutcome.FAILED
        self._version = newer[0]
        return WriteOutcome.WRITTEN

    def forget(self) -> None:
        """Remove the file, so that a map reset on request does not return at the next start."""
        with self._turn:
            self._version = 0
            try:
                self._path.unlink(missing_ok=True)
            except OSError as error:
                self._troubled(f"the kept map {self._path} cannot be removed: {error.strerror}")

    def close(self) -> None:
        """Write a last time and end the thread. A write in progress delays it by at most
        CLOSE_WITHIN_S; if it takes longer, nothing more is written."""
        self._wait_until_s = time.monotonic() + CLOSE_WITHIN_S
        self._stopped.set()
        if self._thread.ident is not None:
            self._thread.join(CLOSE_WITHIN_S)
        self.write()

    def _replace(self, data: bytes) -> None:
        self._path.parent.mkdir(parents=True, exist_ok=True)
        write_file(self._path, data)

    def _run(self) -> None:
        wait_s = self._period_s
        while not self._stopped.wait(wait_s):
            began_s = time.monotonic()
            self.write()
            wait_s = max(self._period_s, PAUSE_PER_WRITE * (time.monotonic() - began_s))
