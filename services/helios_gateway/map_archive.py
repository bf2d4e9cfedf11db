"""Map file: a ZIP of the saved 2D map, the saved object map, and a note about the file."""

from __future__ import annotations

import io
import json
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import PurePosixPath

from helios_core.errors import InvalidInput
from helios_core.npz_reading import check_packing

ABOUT = "helios-map.json"
FORMAT = 1
MAP2D_SUFFIX = ".map"
OBJECTS = "objects.npz"
_UNREADABLE = (  # RuntimeError: the ZIP is encrypted
    zipfile.BadZipFile,
    zlib.error,
    EOFError,
    OSError,
    RuntimeError,
    ValueError,
)
_BEGAN = (2000, 1, 1, 0, 0, 0)  # timestamp of every entry, so that equal maps give equal files


@dataclass(frozen=True)
class MapFile:
    """Saved data of both maps."""

    map2d: bytes
    objects: bytes


def packed(maps: MapFile, robot: str) -> bytes:
    """Map file as bytes. Entries are not compressed again, because the maps already are."""
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
    """Both maps from a file that `packed` made, also if somebody unpacked and repacked it.

    Raises InvalidInput for another file, for one larger than `most_bytes` when unpacked, and for a
    compression other than deflate: the size of its content is known only after unpacking.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            entries = {PurePosixPath(e.filename).name: e for e in archive.infolist()}
            if ABOUT not in entries:
                raise InvalidInput(
                    f"the file is a ZIP without {ABOUT}; send one that helios map save wrote"
                )
            check_packing(
                entries.values(), "zip the files anew with deflate, or without compression"
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
