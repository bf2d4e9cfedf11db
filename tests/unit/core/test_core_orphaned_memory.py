"""Shared memory of dead processes is freed, and only by records of the same user."""

from __future__ import annotations

import fcntl
import os
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from helios_core import orphaned_memory
from helios_core.orphaned_memory import SEGMENT, SUFFIX, MemoryRecord, free, orphans

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="only Linux has this folder")

IMAGE = b"an image" * 4096


@pytest.fixture
def folder(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    with tempfile.TemporaryDirectory(dir=orphaned_memory.FOLDER) as made:
        monkeypatch.setattr(orphaned_memory, "FOLDER", Path(made))
        yield Path(made)


@pytest.fixture
def segment(folder: Path) -> Path:
    out = folder / f"1{SEGMENT}"
    out.write_bytes(IMAGE)
    return out


@pytest.fixture
def record(folder: Path, segment: Path) -> Path:
    out = folder / f"1{SUFFIX}"
    out.write_text(segment.name)
    return out


def test_the_memory_that_the_record_of_a_dead_process_names_is_freed(
    record: Path, segment: Path
) -> None:
    assert orphans() == [record]
    with segment.open("rb") as mapped:
        assert free(record) == len(IMAGE)
        assert mapped.read() == bytes(len(IMAGE))
    assert not segment.exists()
    assert not record.exists()


def test_a_record_of_another_user_frees_nothing(
    record: Path, segment: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    another = os.getuid() + 1
    monkeypatch.setattr(os, "getuid", lambda: another)
    assert orphans() == []
    assert free(record) == 0
    assert segment.read_bytes() == IMAGE


def test_a_link_to_a_file_of_this_user_frees_nothing(
    record: Path, segment: Path, tmp_path: Path
) -> None:
    own = tmp_path / "notes"
    own.write_text(record.read_text())
    record.unlink()
    record.symlink_to(own)
    assert orphans() == []
    assert free(record) == 0
    assert segment.read_bytes() == IMAGE


def test_a_record_that_a_process_holds_frees_nothing(record: Path, segment: Path) -> None:
    with record.open() as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        assert orphans() == []
        assert free(record) == 0
    assert segment.read_bytes() == IMAGE


@pytest.mark.parametrize("name", ["../1.zenoh", "/tmp/1.zenoh", "1.other", "\0.zenoh"])
def test_a_record_frees_only_segments_in_its_own_folder(
    name: str, record: Path, segment: Path
) -> None:
    record.write_bytes(name.encode() + b"\xff")
    assert free(record) == 0
    assert segment.read_bytes() == IMAGE
    assert not record.exists()


def test_a_record_that_somebody_has_removed_is_closed_all_the_same(folder: Path) -> None:
    record = MemoryRecord([])
    (path,) = folder.iterdir()
    path.unlink()
    record.close()
    with pytest.raises(OSError, match="Bad file descriptor"):
        os.fstat(record._file)
