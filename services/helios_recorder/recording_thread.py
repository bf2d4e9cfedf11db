"""Writer thread: moves messages from the inbox to one file after the other.

Each disk error stops the recording, is reported, and is retried. Messages that arrive meanwhile are
dropped and counted.
"""

from __future__ import annotations

import errno
import logging
import threading
import time
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path

from google.protobuf.message import Message
from helios_core.errors import HeliosError
from helios_core.health import Health
from helios_core.recording_format import SUFFIX
from helios_core.viewing.entry import Entry
from helios_core.viewing.message_entries import Entries
from helios_core.viewing.message_queue import Item, MessageQueue

from helios_recorder.mcap_writer import DiskFull, RecordingFile
from helios_recorder.settings import MB, Settings

log = logging.getLogger(__name__)

IDLE_S = 0.2
CLOSE_WITHIN_S = 1.5


class Recording:
    """Writer thread with its inbox: see the module.

    `retained`: True if the last message of a channel is repeated at the start of every file.
    """

    def __init__(self, settings: Settings, health: Health, retained: Callable[[str], bool]) -> None:
        self._settings, self._health, self._retained = settings, health, retained
        self.inbox = MessageQueue(settings.queue_mb * MB)
        self._entries = Entries(settings.jpeg_quality)
        self._last: dict[str, tuple[Message, int]] = {}  # newest message per retained channel
        self._file: RecordingFile | None = None
        self._trouble = ""
        self._again_s = 0.0  # time of the next attempt
        self._files = 0
        self._unwritten = 0  # messages that no chunk on the disk contains yet
        self._dropped = self._logged_dropped = 0
        self._stamp = datetime.now(UTC).strftime("%Y%m%d-%H%M%S")
        self._thread = threading.Thread(target=self._run, name="write", daemon=True)
        self._thread.start()

    def put(self, channel: str, message: Message, droppable: bool, counter: str) -> None:
        """Queue a message, or count it as dropped. Never blocks."""
        if not self.inbox.put(channel, message, droppable):
            self._health.count(counter)
            self._dropped += 1

    @property
    def path(self) -> Path | None:
        """Path of the current file."""
        return self._file.path if self._file else None

    def close(self) -> None:
        """Write the queue within 1.5 s and finish the file. Reports messages that are lost."""
        self.inbox.close()
        self._thread.join(CLOSE_WITHIN_S)
        if self._thread.is_alive():
            log.error(
                "the disk is too slow: %.1f MB that waited are lost, and %s has no end (what is "
                "in it can be read)",
                self.inbox.bytes / MB,
                self.path,
            )

    def _run(self) -> None:
        while not self.inbox.closed:
            item = self.inbox.take(IDLE_S)
            try:
                self._step(item)
            except (OSError, DiskFull) as error:
                self._stop(error)
            except Exception:  # one bad message must not stop the recording
                log.exception("%s could not be recorded", item.channel if item else "nothing")
                self._health.count("unrecordable_messages")
        if self._file is not None:
            try:
                self._file.finish()
            except OSError as error:
                self._stop(error)

    def _step(self, item: Item | None) -> None:
        keep = item is not None and self._retained(item.channel)
        entries = self._entries_of(item) if item is not None and keep else None
        self._unwritten += item is not None
        file = self._current(item, entries or ())
        if file is None:
            self._count_lost()
            return
        before = file.bytes
        if item is not None:
            self._write(file, item, self._entries_of(item) if entries is None else entries)
        tended = file.flush_if_due()
        if file.bytes > before:
            self._unwritten = 0
        if tended:
            file.check_room()
        self._health.set("file_mb", round(file.bytes / MB, 3))
        self._health.set("queue_mb", round(self.inbox.bytes / MB, 3))
        self._health.set("writer_cpu_s", round(time.thread_time(), 3))
        if tended and self._dropped != self._logged_dropped:  # a changed note is sent at once
            self._tell(file)

    def _current(self, item: Item | None, entries: Sequence[Entry]) -> RecordingFile | None:
        """Current file; None while the disk accepts nothing.

        entries: known entries of the item, which a new file need not repeat.
        """
        if self._file is not None and self._file.is_over:
            self._file.finish()
            self._file, self._unwritten = None, int(item is not None)
        if self._file is None and time.monotonic() >= self._again_s:
            self._file = RecordingFile(self._next_path(), self._settings)
            self._files += 1
            self._trouble = ""
            self._health.set("files", self._files)
            self._tell(self._file)
            self._repeat(self._file, item, {entry.channel for entry in entries})
        return self._file

    def _next_path(self) -> Path:
        """First free path. A failed attempt uses up no number."""
        number = self._files
        while (path := self._settings.out / f"{self._stamp}-{number:03d}{SUFFIX}").exists():
            number += 1
        return path

    def _tell(self, file: RecordingFile) -> None:
        self._logged_dropped = self._dropped
        lost = f"; {self._logged_dropped} messages were dropped" if self._logged_dropped else ""
        self._health.ready(f"recording to {file.path}{lost}")

    def _repeat(self, file: RecordingFile, item: Item | None, coming: set[str]) -> None:
        """Repeat the retained messages, so that each file is complete by itself.

        coming: channels that the item writes anyway. A repetition is logged later than it was
        published: by this a reader tells it from a new message.
        """
        for channel, (message, log_time_ns) in self._last.items():
            if channel not in coming:
                now_ns = 0 if item is None else item.log_time_ns
                file.write(Entry(channel, message), max(now_ns, log_time_ns + 1), log_time_ns)

    def _entries_of(self, item: Item) -> Sequence[Entry]:
        """Entries of an item; empty for a message that cannot be recorded, which is counted."""
        try:
            entries = list(self._entries.of(item.channel, item.message, item.log_time_ns))
        except HeliosError as error:
            self._health.count("unrecordable_messages")
            log.warning("%s: %s", item.channel, error.message)
            return ()
        for entry in entries:
            if self._retained(entry.channel):
                self._last[entry.channel] = (entry.message, item.log_time_ns)
        return entries

    def _write(self, file: RecordingFile, item: Item, entries: Sequence[Entry]) -> None:
        for entry in entries:
            file.write(entry, item.log_time_ns, item.log_time_ns)
        if entries:
            self._health.count("messages")

    def _stop(self, error: OSError | DiskFull) -> None:
        """Report the error, finish the file if there is room, and count the lost messages."""
        self._again_s = time.monotonic() + self._settings.retry_s
        if self._file is not None:
            if isinstance(error, DiskFull) and _finished(self._file):
                self._unwritten = 0
            else:
                self._file.abandon()
            self._file = None
        self._count_lost()
        said = f"the recording stopped: {_reason(error, self._settings.out)}"
        if said != self._trouble:
            log.error("%s", said)
        self._trouble = said
        self._health.degraded(said)

    def _count_lost(self) -> None:
        self._health.count("dropped_while_stopped", self._unwritten)
        self._unwritten = 0


def _reason(error: OSError | DiskFull, folder: Path) -> str:
    """Why nothing can be written to the folder of the recordings, and what to do."""
    if isinstance(error, FileExistsError | NotADirectoryError):
        return f"{folder} is no folder ({error}); move the file in its way, or choose another"
    if isinstance(error, DiskFull) or error.errno in (errno.ENOSPC, errno.EDQUOT):
        return f"the disk is full ({error}); make room in {folder}"
    return f"the disk cannot be written ({error}); allow writing to {folder}, or choose another"


def _finished(file: RecordingFile) -> bool:
    """Finish the file. True if the disk took the rest of it, including the indexes."""
    try:
        file.finish()
    except OSError:
        return False
    return True
