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
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from helios_core.atomic_file import write_file

from helios_gateway.faults.life_cycle import Fault, FaultState

log = logging.getLogger(__name__)

MOST_FILES = 100
SHARE_OF_DISK = 0.25
LIST_NAME = "faults.json"
SUFFIX = ".mcap"
NAME = re.compile(r"[0-9]{8}T[0-9]{6}Z-[a-z0-9-]{1,80}\.mcap")  # nothing else is read or removed


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
        """Faults and recordings of before; empty for a missing or damaged list."""
        path = self.folder / LIST_NAME
        try:
            stored = json.loads(path.read_text(encoding="utf-8"))
            faults = [_fault(raw) for raw in stored["faults"]]
            notes = [_note(raw) for raw in stored["recordings"]]
        except FileNotFoundError:
            return [], []
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            log.warning("%s cannot be read (%s): the list of faults begins anew", path, error)
            return [], []
        return faults, [n for n in notes if NAME.fullmatch(n.name) and self._path(n.name).is_file()]

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
    known: dict[str, Any] = {field.name: raw[field.name] for field in fields(Fault)}
    known["state"] = FaultState(raw["state"])
    return Fault(**known)


def _note(raw: dict[str, Any]) -> RecordingNote:
    return RecordingNote(
        str(raw["name"]),
        float(raw["made_s"]),
        tuple(map(str, raw["faults"])),
        tuple(map(str, raw["tasks"])),
        int(raw["bytes"]),
    )
