"""Both maps in one file: a ZIP of what map2d and the object map save, and a note about it."""

from __future__ import annotations

import io
import json
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import PurePosixPath

from helios_core.errors import InvalidInput

ABOUT = "helios-map.json"
FORMAT = 1
MAP2D_SUFFIX = ".map"
OBJECTS = "objects.npz"
_UNREADABLE = (  # a RuntimeError: it wants a password
    zipfile.BadZipFile, zlib.error, EOFError, OSError, RuntimeError, ValueError,
)  # fmt: skip
_BEGAN = (2000, 1, 1, 0, 0, 0)  # of every entry: equal maps are equal files


@dataclass(frozen=True)
class MapFile:
    """What the two maps saved."""

    map2d: bytes
    objects: bytes


def packed(maps: MapFile, robot: str) -> bytes:
    """The file. The maps are compressed already, so they are only laid side by side."""
    about = {"format": FORMAT, "robot": robot}
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_STORED) as archive:
        for name, data in (
            (ABOUT, json.dumps(about).encode()),
            (f"map2d{MAP2D_SUFFIX}", maps.map2d),
            (OBJECTS, maps.objects),
        ):
            archive.writestr(zipfile.ZipInfo(name, _BEGAN), data)
    return stream.getvalue()


def unpacked(data: bytes, most_bytes: int) -> MapFile:
    """What `packed` made a file of, or who unpacked it and packed it again.

    Raises InvalidInput for another file, and one that would grow beyond `most_bytes`.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            entries = {PurePosixPath(e.filename).name: e for e in archive.infolist()}
            if ABOUT not in entries:
                raise InvalidInput(
                    f"the file is a ZIP without {ABOUT}; send one that helios map save wrote"
                )
            if sum(entry.file_size for entry in entries.values()) > most_bytes:
                raise InvalidInput(f"the maps are larger than {most_bytes} bytes unpacked")
            about = json.loads(archive.read(entries[ABOUT]))
            if not isinstance(about, dict) or about.get("format") != FORMAT:
                raise InvalidInput(
                    f"{ABOUT} says {str(about)[:80]}; this HELIOS reads format {FORMAT}"
                )
            map2d = next((e for name, e in entries.items() if name.endswith(MAP2D_SUFFIX)), None)
            if map2d is None or OBJECTS not in entries:
                raise InvalidInput(
                    f"the file holds {', '.join(sorted(entries))[:200]}; wanted "
                    f"map2d{MAP2D_SUFFIX} and {OBJECTS}"
                )
            return MapFile(archive.read(map2d), archive.read(entries[OBJECTS]))
    except _UNREADABLE as error:
        raise InvalidInput(
            f"{len(data)} bytes came that are no map file, or a damaged one ({error}); send one "
            "that helios map save wrote"
        ) from error
