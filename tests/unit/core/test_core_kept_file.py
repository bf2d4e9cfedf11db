"""The autosaved map file: complete after every crash, retried after every failed write."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import pytest
from helios_core.map_autosave import AutosavedFile, WriteOutcome

from tests.full_disk import fill, small_disk
from tests.support import wait_until


class Map:
    """A map that changes, and a listener for problems with its autosave."""

    def __init__(self, path: Path, period_s: float = 3600.0) -> None:
        self.version, self.data = 0, b""
        self.said: list[str] = []
        self.fails: Exception | None = None
        self.kept = AutosavedFile(path, period_s, self.newer, self.said.append)

    def change(self, data: bytes) -> None:
        self.version, self.data = self.version + 1, data

    def newer(self, version: int) -> tuple[int, bytes] | None:
        if self.fails is not None:
            raise self.fails
        return None if version == self.version else (self.version, self.data)


def test_a_change_is_written_once(tmp_path: Path) -> None:
    map = Map(tmp_path / "a" / "m.map")
    assert not map.kept.write()
    map.change(b"one")
    assert map.kept.write()
    assert not map.kept.write()
    assert [p.name for p in (tmp_path / "a").iterdir()] == ["m.map"]
    found = map.kept.found()
    assert found is not None
    assert found.data == b"one"
    assert found.written.startswith(time.strftime("%Y-"))


def test_a_failed_write_is_reported_and_retried_without_a_further_change(
    tmp_path: Path,
) -> None:
    (tmp_path / "state").write_text("no folder")
    map = Map(tmp_path / "state" / "m.map")
    map.change(b"one")
    assert not map.kept.write()
    assert "another --state-dir" in map.said[-1]
    (tmp_path / "state").unlink()
    assert map.kept.write()
    assert map.said[-1] == ""
    assert (tmp_path / "state" / "m.map").read_bytes() == b"one"


def test_a_write_tells_nothing_newer_from_a_failure(tmp_path: Path) -> None:
    map = Map(tmp_path / "m.map")
    map.change(b"one")
    assert map.kept.write() is WriteOutcome.WRITTEN
    assert map.kept.write() is WriteOutcome.UNCHANGED
    map.fails = OSError(28, "No space left on device")
    assert map.kept.write() is WriteOutcome.FAILED


def test_an_exception_while_encoding_the_map_does_not_end_the_autosave(tmp_path: Path) -> None:
    map = Map(tmp_path / "m.map", period_s=0.01)
    map.fails = MemoryError()
    map.change(b"one")
    map.kept.start()
    wait_until(lambda: any("MemoryError" in said for said in map.said), 60, "it is said")
    map.fails = None
    wait_until((tmp_path / "m.map").exists, 60, "it is written after all")
    map.kept.close()


def test_closing_writes_pending_changes(tmp_path: Path) -> None:
    map = Map(tmp_path / "m.map")
    map.kept.start()
    map.change(b"last")
    map.kept.close()
    assert (tmp_path / "m.map").read_bytes() == b"last"


def test_closing_does_not_wait_for_a_write_that_hangs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("helios_core.map_autosave.CLOSE_WITHIN_S", 0.05)
    writing, go = threading.Event(), threading.Event()

    def hangs(version: int) -> tuple[int, bytes]:
        writing.set()
        go.wait(30)
        return version + 1, b"map"

    kept = AutosavedFile(tmp_path / "m.map", 0.01, hangs, lambda _: None)
    kept.start()
    assert writing.wait(30)
    closing = threading.Thread(target=lambda: (kept.close(), kept.write()))
    closing.start()
    closing.join(10)
    assert not closing.is_alive()
    assert "may lack the newest changes of the map" in caplog.text
    go.set()
    wait_until((tmp_path / "m.map").exists, 60, "the write ends after all")


def test_files_moved_aside_never_overwrite_each_other(tmp_path: Path) -> None:
    map = Map(tmp_path / "m.map")
    for data in (b"bad", b"worse"):
        (tmp_path / "m.map").write_bytes(data)
        assert map.kept.put_aside().startswith("put aside as")
    assert {p.read_bytes() for p in tmp_path.glob("m.map.refused-*")} == {b"bad", b"worse"}
    assert map.kept.found() is None


def test_a_file_that_cannot_be_moved_aside_is_reported_at_its_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    map = Map(tmp_path / "m.map")
    monkeypatch.setattr(Path, "replace", refuse)
    assert map.kept.put_aside() == f"left at {tmp_path / 'm.map'}, for it cannot be moved " + (
        "(Permission denied)"
    )


def test_a_forgotten_map_is_not_found_again(tmp_path: Path) -> None:
    map = Map(tmp_path / "m.map")
    map.change(b"one")
    map.kept.write()
    map.kept.forget()
    assert map.kept.found() is None
    assert map.kept.write()  # the present map is written again


def test_on_a_real_full_disk_the_saved_map_stays_until_its_successor_can_be_written(
    tmp_path: Path,
) -> None:
    with small_disk(tmp_path / "disk") as disk:
        map = Map(disk / "m.map")
        map.change(b"one")
        map.kept.write()
        filler = fill(disk)
        map.change(b"two" * 10_000)
        assert not map.kept.write()
        assert "No space left" in map.said[-1]
        assert (disk / "m.map").read_bytes() == b"one"
        filler.unlink()
        assert map.kept.write()
        assert (disk / "m.map").read_bytes() == map.data


def test_a_half_written_file_of_a_killed_process_is_removed(tmp_path: Path) -> None:
    (tmp_path / ".m.0a1b2c3d.new.map").write_bytes(b"half")
    assert Map(tmp_path / "m.map").kept.found() is None
    assert not list(tmp_path.iterdir())


def test_a_map_that_takes_long_to_write_is_written_less_often(tmp_path: Path) -> None:
    writes: list[float] = []

    def slow(version: int) -> tuple[int, bytes]:
        writes.append(time.monotonic())
        time.sleep(0.05)
        return version + 1, b"map"

    kept = AutosavedFile(tmp_path / "map", 0.01, slow, lambda _: None)
    kept.start()
    wait_until(lambda: len(writes) > 1, 60, "the map is written again")
    kept.close()
    assert writes[1] - writes[0] >= 20 * 0.05
