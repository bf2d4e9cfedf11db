"""Archive of a Sweet Home 3D home: a zip file that is read in memory, with limits.

Nothing is unpacked to a disk. Sizes are checked before and while an entry is decompressed.
"""

from __future__ import annotations

import hashlib
import io
import zipfile
import zlib
from pathlib import Path

from helios_core.errors import InvalidInput

HOME_XML = "Home.xml"
SERIALISED = "Home"  # the only description in files of versions before 5.3
MOST_FILE_BYTES = 512 << 20
MOST_ENTRIES = 20_000
MOST_XML_BYTES = 32 << 20
MOST_ENTRY_BYTES = 16 << 20  # of a model or an image
MOST_READ_BYTES = 160 << 20  # of all models and images together
MOST_RATIO = 400  # decompressed size / compressed size
_RATIO_FROM_BYTES = 4 << 20  # smaller entries may have any ratio
SAVE_AGAIN = "open it in Sweet Home 3D 5.3 or newer, save it, and give the new file"


class PlanArchive:
    """Open archive. Close it after use."""

    def __init__(self, path: Path) -> None:
        """Raises InvalidInput if the file is no archive of a home, or exceeds a limit."""
        self.name = path.name
        self._left = MOST_READ_BYTES
        try:
            size = path.stat().st_size
            if size > MOST_FILE_BYTES:
                raise InvalidInput(
                    f"{path} has {size >> 20} MiB; files up to {MOST_FILE_BYTES >> 20} MiB are "
                    "read: save it without its textures and photos"
                )
            with path.open("rb") as file:
                self.sha256 = hashlib.file_digest(file, "sha256").hexdigest()
            self._zip = zipfile.ZipFile(path)
        except FileNotFoundError:
            raise InvalidInput(f"there is no file {path}; name an existing .sh3d file") from None
        except OSError as error:
            raise InvalidInput(
                f"{path} cannot be read ({error.strerror or error}); give a .sh3d file"
            ) from error
        except (zipfile.BadZipFile, ValueError, NotImplementedError) as error:
            raise InvalidInput(
                f"{path} is no Sweet Home 3D file or is damaged ({error}); {SAVE_AGAIN}"
            ) from error
        self._entries = {info.filename: info for info in self._zip.infolist()}
        if len(self._zip.infolist()) > MOST_ENTRIES:
            self.close()
            raise InvalidInput(
                f"{path} holds more than {MOST_ENTRIES} entries, as no home does; {SAVE_AGAIN}"
            )

    def home_xml(self) -> bytes:
        """Content of `Home.xml`. Raises InvalidInput if it is missing, damaged or too large."""
        if HOME_XML not in self._entries:
            if SERIALISED in self._entries:
                raise InvalidInput(
                    f"{self.name} comes from a version before 5.3, which wrote no {HOME_XML}; "
                    f"{SAVE_AGAIN}"
                )
            raise InvalidInput(
                f"{self.name} is a zip file without {HOME_XML}, so no home of Sweet Home 3D; "
                "give a .sh3d file"
            )
        return self._content(HOME_XML, MOST_XML_BYTES)

    def names(self) -> tuple[str, ...]:
        """Names of all entries."""
        return tuple(self._entries)

    def content(self, name: str) -> bytes:
        """Content of a model or an image. Raises InvalidInput as `home_xml` does."""
        if name not in self._entries:
            raise InvalidInput(f"{self.name} holds no entry {name!r}")
        data = self._content(name, min(MOST_ENTRY_BYTES, self._left))
        self._left -= len(data)
        return data

    def folder(self, name: str) -> dict[str, io.BytesIO]:
        """Files beside an entry, and the entry itself, by their names in its folder.

        An entry without a folder stands alone.
        """
        stem, slash, own = name.rpartition("/")
        found = {own: io.BytesIO(self.content(name))}
        for other in self._entries if slash else ():
            inner = other.removeprefix(f"{stem}/")
            if inner not in (other, own, "") and not other.endswith("/"):
                try:
                    found[inner] = io.BytesIO(self.content(other))
                except InvalidInput:
                    continue  # a material or an image; the model is drawn without it
        return found

    def _content(self, name: str, most: int) -> bytes:
        info = self._entries[name]
        grows = info.file_size > _RATIO_FROM_BYTES
        if info.file_size > most or (grows and info.file_size > MOST_RATIO * info.compress_size):
            raise self._too_large(name, most)
        try:
            with self._zip.open(info) as file:
                data = file.read(most + 1)
        except (
            zipfile.BadZipFile,
            zlib.error,
            EOFError,
            OSError,
            RuntimeError,
            NotImplementedError,
            ValueError,
        ) as error:
            raise InvalidInput(
                f"{name} in {self.name} is damaged or encrypted ({error}); {SAVE_AGAIN}"
            ) from error
        if len(data) > most:
            raise self._too_large(name, most)
        return data

    def _too_large(self, name: str, most: int) -> InvalidInput:
        return InvalidInput(
            f"{name} in {self.name} is larger than the {most >> 20} MiB that are read, or grows "
            f"more than {MOST_RATIO}-fold; {SAVE_AGAIN}"
        )

    def close(self) -> None:
        self._zip.close()

    def __enter__(self) -> PlanArchive:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
