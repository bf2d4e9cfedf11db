"""Checksums of files, as publishers and the lock file give them."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

from helios_core.models.model_folder import FIRST_DOWNLOAD, PUBLISHER, LockedFile, LockedModel

BLOCK = 1 << 20


@dataclass(frozen=True)
class Published:
    """What a publisher says about a file. `git_sha1` is the id of small files in its history."""

    name: str
    bytes: int | None = None
    sha256: str | None = None
    git_sha1: str | None = None


def locked(path: Path, published: Published) -> LockedFile:
    """Entry of a downloaded file. Raises ValueError if it is not what the publisher says."""
    size = path.stat().st_size
    if published.bytes is not None and size != published.bytes:
        raise ValueError(f"it has {size} bytes, the publisher says {published.bytes}")
    sha256 = digest(path, "sha256")
    if published.sha256 is not None and sha256 != published.sha256:
        raise ValueError(f"its SHA-256 is {sha256}, the publisher says {published.sha256}")
    if published.sha256 is None and published.git_sha1 is not None:
        sha1 = digest(path, "sha1", f"blob {size}\0".encode())
        if sha1 != published.git_sha1:
            raise ValueError(f"its git id is {sha1}, the publisher says {published.git_sha1}")
    by = PUBLISHER if published.sha256 or published.git_sha1 else FIRST_DOWNLOAD
    return LockedFile(size, sha256, by)


def problems(place: Path, model: LockedModel) -> list[str]:
    """What is wrong with the files of a model; empty if they are as fetched."""
    out = []
    for name, file in model.files.items():
        path = place / name
        if not path.is_file():
            out.append(f"{name} is missing")
        elif path.stat().st_size != file.bytes:
            out.append(f"{name} has {path.stat().st_size} bytes, wanted {file.bytes}")
        elif digest(path, "sha256") != file.sha256:
            out.append(f"{name} has another SHA-256 than when it was fetched")
    return out


def digest(path: Path, kind: str, begin: bytes = b"") -> str:
    """Hexadecimal digest of `begin` and the file."""
    hashed = hashlib.new(kind, begin, usedforsecurity=kind != "sha1")
    with path.open("rb") as file:
        while block := file.read(BLOCK):
            hashed.update(block)
    return hashed.hexdigest()
