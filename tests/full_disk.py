"""Simulate a full disk: a small file system where this user may mount, or writes that fail."""

from __future__ import annotations

import contextlib
import errno
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest


@contextmanager
def small_disk(folder: Path, kilobytes: int = 1024) -> Iterator[Path]:
    """Mount a file system of that size; skip the test where the user may not mount."""
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", f"size={kilobytes}k", "tmpfs", str(folder)]
    try:
        mounted = subprocess.run(command, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        pytest.skip("a real full disk: there is no mount command here")
    if mounted.returncode:
        pytest.skip(f"a real full disk: this user may not mount ({mounted.stderr.strip()})")
    try:
        yield folder
    finally:
        subprocess.run(["umount", str(folder)], check=True)


def fill(folder: Path) -> Path:
    """Write until the disk is full; return the file that fills it."""
    filler = folder / "filler"
    with filler.open("wb", 0) as file, contextlib.suppress(OSError):
        while True:
            file.write(b"x" * 4096)
    return filler


def refuse_writing(monkeypatch: pytest.MonkeyPatch, beginning: str = "", ending: str = "") -> None:
    """Make writes to files whose names begin and end so fail as on a full disk: half of the data is
    written, then ENOSPC is raised."""
    write_bytes = Path.write_bytes

    def half(path: Path, data: bytes) -> int:
        if not (path.name.startswith(beginning) and path.name.endswith(ending)):
            return write_bytes(path, data)
        write_bytes(path, data[: len(data) // 2])
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", half)
