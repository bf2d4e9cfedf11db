"""A file is written whole or not at all."""

from __future__ import annotations

import os
import stat
import tempfile
from pathlib import Path

import pytest
from helios_core.atomic_file import remove_temporaries, replacing, write_file
from hypothesis import given
from hypothesis import strategies as st

from tests.full_disk import fill, refuse_writing, small_disk

MOST = 200_000  # bytes


def mode_of(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


def names_in(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


@given(contents=st.lists(st.binary(max_size=200) | st.text(max_size=50), min_size=1, max_size=4))
def test_a_file_contains_the_last_data_written(contents: list[bytes | str]) -> None:
    with tempfile.TemporaryDirectory() as name:
        file = Path(name) / "some.file"
        for data in contents:
            write_file(file, data)
        last = contents[-1]
        assert file.read_bytes() == (last.encode() if isinstance(last, str) else last)
        assert names_in(Path(name)) == {"some.file"}


@given(old=st.integers(0, MOST), new=st.integers(MOST, 3 * MOST))
def test_on_a_full_disk_the_old_file_stays_and_no_temporary_file_remains(
    old: int, new: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("disk")
        file = folder / "home.zip"
        file.write_bytes(b"o" * old)
        refuse_writing(patch)
        with pytest.raises(OSError, match="No space left"):
            write_file(file, b"n" * new)
        assert file.read_bytes() == b"o" * old
        assert names_in(folder) == {"home.zip"}


def test_on_a_real_full_disk_the_old_file_stays(tmp_path: Path) -> None:
    with small_disk(tmp_path / "disk") as disk:
        file, never = disk / "home.zip", disk / "never.zip"
        write_file(file, b"good" * 100)
        fill(disk)
        for path in (file, never):
            with pytest.raises(OSError, match="No space left"):
                write_file(path, b"x" * 500_000)
        assert file.read_bytes() == b"good" * 100
        assert names_in(disk) == {"home.zip", "filler"}
        (disk / "filler").unlink()
        write_file(file, b"x" * 500_000)
        assert file.stat().st_size == 500_000


def test_on_a_real_disk_too_small_for_both_files_the_old_one_stays(tmp_path: Path) -> None:
    with small_disk(tmp_path / "disk") as disk:
        write_file(disk / "a", b"o" * 700_000)
        with pytest.raises(OSError, match="No space left"):
            write_file(disk / "a", b"n" * 700_000)
        assert (disk / "a").read_bytes() == b"o" * 700_000
        assert names_in(disk) == {"a"}


def test_an_exception_while_a_library_writes_leaves_the_old_file(tmp_path: Path) -> None:
    file = tmp_path / "picture.png"
    file.write_bytes(b"old")

    def interrupted() -> None:
        with replacing(file) as temporary:
            assert temporary.suffix == ".png"
            temporary.write_bytes(b"half a pict")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert file.read_bytes() == b"old"
    assert names_in(tmp_path) == {"picture.png"}


def test_a_file_keeps_its_permissions(tmp_path: Path) -> None:
    file = tmp_path / "keys.toml"
    write_file(file, "one", mode=0o600)
    assert mode_of(file) == 0o600
    write_file(file, "two")
    assert mode_of(file) == 0o600
    file.chmod(0o640)
    write_file(file, "three", mode=0o600)
    assert mode_of(file) == 0o640


def test_a_new_file_has_the_default_permissions(tmp_path: Path) -> None:
    (tmp_path / "plain").write_bytes(b"")
    write_file(tmp_path / "new", b"")
    assert mode_of(tmp_path / "new") == mode_of(tmp_path / "plain")


def test_a_symbolic_link_keeps_pointing_to_its_file(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    (tmp_path / "link").symlink_to("there/file")
    for data in (b"one", b"two"):
        write_file(tmp_path / "link", data)
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "there" / "file").read_bytes() == b"two"


def test_a_device_or_a_pipe_is_written_to_and_not_replaced(tmp_path: Path) -> None:
    write_file(Path("/dev/null"), b"gone")
    assert Path("/dev/null").is_char_device()
    os.mkfifo(tmp_path / "pipe")
    reader = os.open(tmp_path / "pipe", os.O_RDONLY | os.O_NONBLOCK)
    write_file(tmp_path / "pipe", b"through")
    assert os.read(reader, 100) == b"through"
    os.close(reader)


def test_no_folder_is_created_or_replaced(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        write_file(tmp_path / "none" / "file", b"")
    (tmp_path / "folder").mkdir()
    with pytest.raises(IsADirectoryError):
        write_file(tmp_path / "folder", b"")
    assert names_in(tmp_path) == {"folder"}


def test_only_temporary_files_of_killed_processes_are_removed(tmp_path: Path) -> None:
    for name in (".m.01234567.new.map", ".m.89abcdef.new.map", "m.map", ".m.new.map", "m.other"):
        (tmp_path / name).write_bytes(b"")
    remove_temporaries(tmp_path / "m.map")
    assert names_in(tmp_path) == {"m.map", ".m.new.map", "m.other"}
    remove_temporaries(tmp_path / "no folder" / "m.map")
