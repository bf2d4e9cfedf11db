"""A disk that hangs delays no stop, and an answered stop is on a disk that does not hang."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from helios_bridge import stop_latch
from helios_core import proto as pb
from helios_core.atomic_file import write_file
from helios_core.errors import DeadlineExceeded
from helios_core.topics import CLEAR_STOP, STOP

from tests.unit.bridge.bridge_stage import LineRobot, Stage


class Disk:
    """Disk whose changes wait for `go_on` while it hangs; `asked`: one has begun to wait."""

    def __init__(self) -> None:
        self.asked, self.go_on = threading.Event(), threading.Event()
        self.go_on.set()

    def hang(self) -> None:
        self.asked.clear()
        self.go_on.clear()

    def delay(self) -> None:
        self.asked.set()
        self.go_on.wait(30)


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> Iterator[Disk]:
    out = Disk()

    def write(path: Path, data: str) -> None:
        out.delay()
        write_file(path, data)

    def unlink(path: Path, missing_ok: bool = False) -> None:
        out.delay()
        path.rename(path.with_suffix(".removed"))

    monkeypatch.setattr("helios_bridge.service.CLOSE_WITHIN_S", 30.0)
    monkeypatch.setattr(stop_latch, "write_file", write)
    monkeypatch.setattr(Path, "unlink", unlink)
    yield out
    out.go_on.set()


def stop(stage: Stage, reason: str) -> None:
    stage.other.call(STOP, pb.StopRequest(reason=reason), 10)


def test_a_stop_reaches_the_driver_while_the_disk_hangs_in_a_clear(
    tmp_path: Path, disk: Disk
) -> None:
    stage = Stage(state_dir=tmp_path, stop_timeout_s=1)
    stop(stage, "a child")
    disk.hang()
    clearing = threading.Thread(target=lambda: stage.other.call(CLEAR_STOP, pb.Empty(), 10))
    clearing.start()
    assert disk.asked.wait(10)
    stop(stage, "a dog")
    assert not disk.go_on.is_set()
    assert stage.robot.stopped == "a dog"
    assert stage.bridge.state().stopped
    disk.go_on.set()
    clearing.join(10)
    assert stage.bridge.close() == []
    assert (tmp_path / stop_latch.FILE_NAME).read_text() == "a dog\n"


def test_a_stop_is_answered_although_the_disk_hangs_and_the_log_tells_that_it_is_not_kept(
    tmp_path: Path, disk: Disk, caplog: pytest.LogCaptureFixture
) -> None:
    stage = Stage(state_dir=tmp_path, stop_timeout_s=1)
    disk.hang()
    stop(stage, "a child")
    assert not disk.go_on.is_set()
    assert stage.robot.stopped == "a child"
    assert "the disk has not taken the newest state of the stop yet" in caplog.text
    assert not (tmp_path / stop_latch.FILE_NAME).exists()
    disk.go_on.set()
    assert stage.bridge.close() == []
    assert (tmp_path / stop_latch.FILE_NAME).read_text() == "a child\n"


def test_the_newest_of_several_states_reaches_a_disk_that_comes_back(
    tmp_path: Path, disk: Disk
) -> None:
    stage = Stage(state_dir=tmp_path, stop_timeout_s=1)
    disk.hang()
    stop(stage, "a child")
    stage.other.call(CLEAR_STOP, pb.Empty(), 10)
    stop(stage, "a dog")
    stage.other.call(CLEAR_STOP, pb.Empty(), 10)
    disk.go_on.set()
    assert stage.bridge.close() == []
    assert stop_latch.StopLatch(tmp_path, stage.bridge._executor).read() == ""


def test_an_answered_stop_and_an_answered_clear_are_on_a_slow_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def write_slowly(path: Path, data: str) -> None:
        time.sleep(0.2)  # the slow disk
        write_file(path, data)

    def remove_slowly(path: Path) -> None:
        time.sleep(0.2)
        path.unlink()

    monkeypatch.setattr(stop_latch, "write_file", write_slowly)
    monkeypatch.setattr(stop_latch, "_remove", remove_slowly)
    stage = Stage(state_dir=tmp_path, stop_timeout_s=30.0)
    stop(stage, "a child")
    assert (tmp_path / stop_latch.FILE_NAME).read_text() == "a child\n"
    stage.other.call(CLEAR_STOP, pb.Empty(), 10)
    assert not (tmp_path / stop_latch.FILE_NAME).exists()


def test_a_driver_whose_stop_fails_leaves_the_stop_on_the_disk(tmp_path: Path) -> None:
    class Away(LineRobot):
        def stop(self, reason: str) -> None:
            raise DeadlineExceeded("no answer from the robot")

    stage = Stage(Away(), state_dir=tmp_path)
    with pytest.raises(DeadlineExceeded, match="no answer"):
        stop(stage, "a child")
    assert (tmp_path / stop_latch.FILE_NAME).read_text() == "a child\n"
