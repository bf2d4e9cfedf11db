"""The folder of faults: a list of them, and their recordings, limited in number and size.

`faults.json` holds the faults and what each recording was made for. The recordings are MCAP files.
The oldest are removed when there are more than `MOST_FILES`, more than the given megabytes, or when
they take more than `SHARE_OF_DISK` of the space that they and the rest of the disk leave free: the
journal of the planner and the maps are on the same disk and come first.
"""

from __future__ import annotations

import json
import logging
import math
import re
import shutil
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, TypeVar

from helios_core.atomic_file import write_file

from helios_gateway.faults.life_cycle import Fault, FaultState

log = logging.getLogger(__name__)

MOST_FILES = 100
SHARE_OF_DISK = 0.25
LIST_NAME = "faults.json"
NAME = re.compile(r"[0-9]{8}T[0-9]{6}Z-[a-z0-9-]{1,80}\.mcap")  # nothing else is read or removed

T = TypeVar("T")


@dataclass(frozen=True)
class RecordingNote:
    """What a recording was made for. bytes: 0 while it is being made."""

    name: str
    made_s: float  # seconds since 1970
    faults: tuple[str, ...] = ()
    tasks: tuple[str, ...] = ()
    bytes: int = 0


class FaultFiles:
    """Files of one robot's faults; see the module. Not thread-safe. A disk error is logged once and
    otherwise ignored, because it must not stop the gateway."""

    def __init__(self, folder: Path, limit_bytes: float) -> None:
        self.folder, self._limit = folder, limit_bytes
        self._failed = ""

    def read(self) -> tuple[list[Fault], list[RecordingNote]]:
        """Faults, and notes of the recordings that are there, of before.

        An entry that cannot be read is left out. A recording without an entry counts as older than
        all others; its note has the time of its file, and no fault. Empty recordings, which a power
        cut leaves, are removed.
        """
        stored = self._stored()
        there = {note.name: note for note in self._there()}
        known = {note.name: note for note in self._entries(stored, "recordings", _note)}
        notes = [note for name, note in there.items() if name not in known]
        for name, note in known.items():
            if name in there:
                notes.append(replace(note, bytes=there[name].bytes))
        return self._entries(stored, "faults", _fault), notes

    def _stored(self) -> dict[str, Any]:
        """Content of the list; empty if it is missing or damaged."""
        path = self.folder / LIST_NAME
        try:
            stored = json.loads(path.read_text(encoding="utf-8"))
            if not isinstance(stored, dict):
                raise ValueError("it holds no JSON object")
        except FileNotFoundError:
            return {}
        except (OSError, ValueError) as error:
            log.warning("%s cannot be read (%s): the list of faults begins anew", path, error)
            return {}
        return stored

    def _entries(self, stored: dict[str, Any], key: str, read: Callable[[Any], T]) -> list[T]:
        """Entries of a part of the list that can be read."""
        raws = stored.get(key)
        out: list[T] = []
        for raw in raws if isinstance(raws, list) else ():
            try:
                out.append(read(raw))
            except (ValueError, KeyError, TypeError, AttributeError) as error:
                path = self.folder / LIST_NAME
                log.warning("an entry of %s in %s is left out: %r", key, path, error)
        return out

    def _there(self) -> list[RecordingNote]:
        """Notes of all recordings in the folder, by their files alone, the oldest first."""
        notes: list[RecordingNote] = []
        try:
            for path in self.folder.iterdir() if self.folder.is_dir() else ():
                if not NAME.fullmatch(path.name) or not path.is_file():
                    continue
                found = path.stat()
                if found.st_size:
                    notes.append(RecordingNote(path.name, found.st_mtime, bytes=found.st_size))
                else:
                    self._try(path.unlink)
        except OSError as error:
            log.warning("the recordings in %s cannot be listed: %s", self.folder, error)
        return sorted(notes, key=lambda note: (note.made_s, note.name))

    def write(self, faults: Sequence[Fault], notes: Sequence[RecordingNote]) -> None:
        content = {
            "faults": [asdict(fault) for fault in faults],
            "recordings": [asdict(note) for note in notes],
        }
        self._try(lambda: self._write(LIST_NAME, json.dumps(content, indent=1)))

    def save(self, name: str, data: bytes) -> bool:
        """Write a recording. True if it is on the disk; one for which there is no room is not."""
        if len(data) > self._share_of_disk(0):
            log.warning(
                "%s of %.1f MB was not kept: there is too little room on the disk of %s",
                name,
                len(data) / 1e6,
                self.folder,
            )
            return False
        return self._try(lambda: self._write(name, data))

    def path(self, name: str) -> Path | None:
        """Path of a recording; None if there is none of that name."""
        if not NAME.fullmatch(name):
            return None
        path = self._path(name)
        return path if path.is_file() else None

    def shorten(self, notes: Sequence[RecordingNote], coming_bytes: int = 0) -> list[RecordingNote]:
        """Remove the oldest recordings beyond the limits. Returns the notes of the others.

        notes: the oldest first. coming_bytes: size of a recording that will be saved next.
        """
        kept: list[RecordingNote] = []
        most = min(self._limit, self._share_of_disk(sum(note.bytes for note in notes)))
        size = coming_bytes
        for note in reversed(notes):
            size += note.bytes
            is_newest = not kept and not coming_bytes
            if len(kept) < MOST_FILES and (size <= most or is_newest):
                kept.append(note)
            else:
                self._try(lambda name=note.name: self._path(name).unlink(missing_ok=True))
        return kept[::-1]

    def _share_of_disk(self, own: int) -> float:
        """Largest size of all recordings by the free space, if they take `own` bytes now."""
        folder = next(f for f in (self.folder, *self.folder.absolute().parents) if f.exists())
        try:
            free = shutil.disk_usage(folder).free
        except OSError:
            return math.inf
        return SHARE_OF_DISK * (free + own)

    def _path(self, name: str) -> Path:
        return self.folder / name

    def _write(self, name: str, data: bytes | str) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        write_file(self._path(name), data, sync=False)

    def _try(self, job: Any) -> bool:
        try:
            job()
        except OSError as error:
            said = f"the faults cannot be kept in {self.folder}: {error.strerror}"
            if said != self._failed:
                log.error("%s; make room there, or choose another folder with --faults", said)
            self._failed = said
            return False
        self._failed = ""
        return True


def _fault(raw: dict[str, Any]) -> Fault:
    """Raises TypeError if a field without a default is missing."""
    known = {field.name: raw[field.name] for field in fields(Fault) if field.name in raw}
    known["state"] = FaultState(raw["state"])
    return Fault(**known)


def _note(raw: dict[str, Any]) -> RecordingNote:
    """The note without its size, which the file tells."""
    return RecordingNote(
        str(raw["name"]),
        float(raw["made_s"]),
        tuple(map(str, raw["faults"])),
        tuple(map(str, raw["tasks"])),
    )
