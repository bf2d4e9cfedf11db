"""Reader for Sweet Home 3D libraries: `.sh3f` archives with a catalogue, models and a licence.

The source is a folder, one archive, or Debian's package `sweethome3d-furniture`.
"""

from __future__ import annotations

import hashlib
import io
import re
import shutil
import tarfile
import tempfile
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from helios_core.errors import InvalidInput, Unavailable
from numpy.typing import NDArray

INSTALLED = Path("/usr/share/sweethome3d/furniture")
HOW_TO_GET = (
    "sudo apt install sweethome3d-furniture, or apt-get download sweethome3d-furniture and give "
    "the .deb file with --source"
)
_CATALOGUE = "PluginFurnitureCatalog.properties"
_PROPERTY = re.compile(r"\s*(\w+)#(\d+)\s*=\s*(.*)")
# (text in a library's LICENSE.TXT, short name of the licence); the first match is used.
_LICENCES = (
    ("creativecommons.org/licenses/by/3.0/us", "CC-BY-3.0-US"),
    ("creativecommons.org/licenses/by/3.0", "CC-BY-3.0"),
    ("creativecommons.org/choose/zero", "CC0-1.0"),
    ("creativecommons.org/publicdomain/zero", "CC0-1.0"),
)
LICENCE_ADDRESSES = {
    "CC-BY-3.0-US": "https://creativecommons.org/licenses/by/3.0/us/",
    "CC-BY-3.0": "https://creativecommons.org/licenses/by/3.0/",
    "CC0-1.0": "https://creativecommons.org/publicdomain/zero/1.0/",
}


@dataclass(frozen=True)
class Entry:
    """One model of a catalogue. `key` is "Library/id"; `size_m` is (width, depth, height)."""

    key: str
    name: str
    category: str
    size_m: tuple[float, float, float]
    rotation: NDArray[np.float64]  # [3, 3] from the file's axes to x right, y up, z front
    model: str  # path in the archive
    author: str
    licence: str


class Library:
    """Open `.sh3f` archive."""

    def __init__(self, path: Path) -> None:
        """Raises InvalidInput if the file is no furniture library or has an unknown licence."""
        self.name = path.stem
        try:
            self.sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
            self._archive = zipfile.ZipFile(path)
            catalogue = self._archive.read(_CATALOGUE).decode("latin-1")
            text = self._archive.read("LICENSE.TXT").decode("latin-1")
        except (OSError, KeyError, zipfile.BadZipFile) as error:
            raise InvalidInput(
                f"{path} is no furniture library ({error}); an .sh3f archive with {_CATALOGUE} and "
                f"LICENSE.TXT is wanted: {HOW_TO_GET}"
            ) from error
        self.licence = next((name for mark, name in _LICENCES if mark in text), "")
        if not self.licence:
            raise InvalidInput(
                f"the licence of {path} is none of {', '.join(LICENCE_ADDRESSES)}; leave this "
                "library out of the folder"
            )
        self.entries = {entry.key: entry for entry in self._entries(catalogue)}

    def _entries(self, catalogue: str) -> Iterator[Entry]:
        found: dict[str, dict[str, str]] = {}
        for line in catalogue.splitlines():
            match = _PROPERTY.match(line)
            if match:
                found.setdefault(match[2], {})[match[1]] = match[3].strip()
        for item in found.values():
            if {"id", "model", "width", "depth", "height"} <= item.keys():
                rotation = [float(v) for v in item.get("modelRotation", "").split()]
                width, depth, height = (float(item[k]) / 100 for k in ("width", "depth", "height"))
                yield Entry(
                    key=f"{self.name}/{item['id'].partition('#')[2] or item['id']}",
                    name=item.get("name", ""),
                    category=item.get("category", ""),
                    size_m=(width, depth, height),
                    rotation=np.array(rotation).reshape(3, 3) if rotation else np.eye(3),
                    model=item["model"].lstrip("/"),
                    author=item.get("creator", "") or self.name,
                    licence=self.licence,
                )

    def folder(self, entry: Entry) -> dict[str, io.BytesIO]:
        """Files in the folder of an entry's model, by name."""
        stem = entry.model.rpartition("/")[0] + "/"
        return {
            name[len(stem) :]: io.BytesIO(self._archive.read(name))
            for name in self._archive.namelist()
            if name.startswith(stem) and not name.endswith("/")
        }

    def close(self) -> None:
        self._archive.close()


@contextmanager
def open_libraries(source: Path | None) -> Iterator[list[Library]]:
    """Libraries of a folder, an `.sh3f`, a `.deb` or, by default, of the installed package.

    Raises Unavailable if the package is not installed, InvalidInput for any other source.
    """
    with tempfile.TemporaryDirectory() as scratch:
        libraries = [Library(path) for path in _archives(source, Path(scratch))]
        try:
            yield libraries
        finally:
            for library in libraries:
                library.close()


def _archives(source: Path | None, scratch: Path) -> list[Path]:
    if source is None and not INSTALLED.is_dir():
        raise Unavailable(f"{INSTALLED} is not there; {HOW_TO_GET}")
    source = source or INSTALLED
    if source.is_dir():
        found = sorted(source.rglob("*.sh3f"))
    elif source.suffix == ".sh3f" and source.is_file():
        found = [source]
    elif source.suffix == ".deb" and source.is_file():
        found = _unpack(source, scratch)
    else:
        raise InvalidInput(
            f"{source} came; a folder with .sh3f files, an .sh3f or a .deb file is wanted: "
            f"{HOW_TO_GET}"
        )
    if not found:
        raise InvalidInput(f"{source} holds no .sh3f file; {HOW_TO_GET}")
    return found


def _unpack(package: Path, scratch: Path) -> list[Path]:
    """Paths of the `.sh3f` files of a Debian package, unpacked into `scratch`."""
    try:
        with package.open("rb") as file, tarfile.open(fileobj=_data_member(file)) as tar:
            for member in tar:
                if member.isfile() and member.name.endswith(".sh3f"):
                    content = tar.extractfile(member)
                    assert content is not None
                    with (scratch / Path(member.name).name).open("wb") as out:
                        shutil.copyfileobj(content, out)
    except (OSError, ValueError, EOFError, tarfile.TarError) as error:
        raise InvalidInput(
            f"{package} cannot be read as a Debian package ({error}); unpack it with dpkg-deb -x "
            "FILE FOLDER and give the folder"
        ) from error
    return sorted(scratch.glob("*.sh3f"))


def _data_member(file: io.BufferedReader) -> io.BytesIO:
    """Member `data.tar.*` of an ar archive (60-byte headers, contents padded to even length)."""
    if file.read(8) != b"!<arch>\n":
        raise ValueError("no ar archive")
    while len(header := file.read(60)) == 60:
        name, size = header[:16].decode("ascii").strip().rstrip("/"), int(header[48:58])
        if name.startswith("data.tar"):
            content = file.read(size)
            if len(content) < size:
                raise ValueError("it is cut off")
            return io.BytesIO(content)
        file.seek(size + size % 2, io.SEEK_CUR)
    raise ValueError("no data.tar in it")
