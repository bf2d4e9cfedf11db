"""The task store: bounded, read back unchanged, and robust against full and damaged disks."""

from __future__ import annotations

import logging
import os
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from helios_core import proto as pb
from helios_core.errors import Unavailable
from helios_planner.task import State
from helios_planner.tasks.messages import task_from_proto, task_to_proto
from helios_planner.tasks.store import Entry, Store
from planner_disk import refuse
from planner_tasks import a_task

from tests.full_disk import fill, small_disk


def decisions(store: Store, count: int) -> list[int]:
    for k in range(count):
        store.add(pb.Decision(task_id="a", index=k))
    return [d.index for d in store.decisions("a")]


def test_only_the_newest_decisions_of_a_task_are_kept(tmp_path: Path) -> None:
    store = Store(tmp_path, most_decisions=3)
    assert decisions(store, 5) == [2, 3, 4]
    assert store.last_number("a") == 4
    assert store.last_number("b") == -1
    store.close()


def test_a_journal_entry_is_read_back_unchanged(tmp_path: Path) -> None:
    store = Store(tmp_path)
    request = pb.ActionRequest(action_id="a-1", action=pb.Action(turn=pb.Action.Turn(angle_rad=1)))
    result = pb.ActionResult(action_id="a-1", succeeded=True)
    for entry in (
        Entry(),
        Entry(life=2, request=request, checkpoint={"looked": [[1.5, 2.0]]}, epoch=("boot", 3)),
        Entry(life=2, request=request, result=result, epoch=("boot", 3)),
    ):
        store.keep("a", entry)
        again = store.entry("a")
        assert again is not None
        assert (again.life, again.request, again.result, again.checkpoint, again.epoch) == (
            entry.life,
            entry.request,
            entry.result,
            entry.checkpoint,
            entry.epoch,
        )
    store.finish(pb.Task(id="a", state="failed"))
    assert store.entry("a") is None
    store.close()


@pytest.mark.parametrize("seen", [True, False, None])
def test_seen_at_goal_is_stored_and_reported(seen: bool | None) -> None:
    task = a_task(state=State.SUCCEEDED).with_(seen_at_goal=seen)
    reported = pb.Task.FromString(task_to_proto(task).SerializeToString())
    assert task_from_proto(reported) == task


def test_the_newest_time_when_the_planner_was_alive_is_kept(tmp_path: Path) -> None:
    store = Store(tmp_path)
    assert store.alive_s() == 0
    store.note_alive(5.0)
    store.note_alive(7.5)
    assert store.alive_s() == 7.5
    store.close()


def test_a_forgotten_task_leaves_no_decisions_and_no_journal(tmp_path: Path) -> None:
    store = Store(tmp_path)
    store.put(pb.Task(id="a", state="failed"))
    store.keep("a", Entry())
    decisions(store, 2)
    store.forget("a")
    assert (store.tasks(), store.decisions("a"), store.entry("a")) == ([], [], None)
    store.close()


def test_a_full_disk_is_logged_once_and_ends_no_task(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    store = Store(tmp_path)
    store.put(pb.Task(id="a", state="running"))
    store._db.execute("PRAGMA max_page_count=12")
    with caplog.at_level(logging.ERROR):
        for k in range(3):
            store.add(pb.Decision(task_id="a", index=k, why="x" * 200_000))
    assert len(caplog.records) == 1
    assert "full" in caplog.text
    store.put(pb.Task(id="a", state="failed"))
    assert [t.state for t in store.tasks()] == ["failed"]
    store.close()


def test_the_store_is_not_proven_from_a_failed_write_until_all_is_written(
    tmp_path: Path,
) -> None:
    store = Store(tmp_path)
    assert not store.proven  # a new one: there is nothing to prove
    assert store.mend((), ())
    store.put(pb.Task(id="a", state="running"))
    refuse(store)
    changes: list[str] = []
    store.watch(lambda: changes.append(store.fault))
    assert not store.put(pb.Task(id="a", state="succeeded"))
    assert not store.keep("a", Entry())
    assert not store.mend((), [pb.Task(id="a", state="succeeded")])
    assert not Store(tmp_path).proven
    refuse(store, refuses=False)
    assert store.fault
    assert store.mend((), [pb.Task(id="a", state="succeeded")])
    assert (len(changes), store.fault, changes[-1]) == (2, "", "")
    assert "readonly" in changes[0]
    again = Store(tmp_path)
    assert again.proven
    assert [t.state for t in again.tasks()] == ["succeeded"]


def test_decisions_that_could_not_be_stored_are_stored_with_the_rest(tmp_path: Path) -> None:
    store = Store(tmp_path)
    made = [pb.Decision(task_id="a", index=k, why=str(k)) for k in range(3)]
    assert store.add(made[0])
    refuse(store)
    assert not store.add(made[1])
    refuse(store, refuses=False)
    assert store.add(made[2])
    assert store.mend((), (), made[1:2])
    assert store.decisions("a") == made
    store.close()


def test_a_store_without_room_to_spare_stays_at_fault(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Small writes that happen to fit do not make the store alternate between ready and fault."""
    store = Store(tmp_path)
    store._db.execute("PRAGMA max_page_count=20")
    assert not store.add(pb.Decision(task_id="a", why="x" * 200_000))
    monkeypatch.setattr("helios_planner.tasks.store.has_room", lambda _: False)
    said = store.fault
    assert store.put(pb.Task(id="a", state="running"))
    assert not store.mend((), ())
    assert "make room on that disk, at least 256 KB" in store.fault == said
    monkeypatch.undo()
    assert store.mend((), ())
    assert store.fault == ""


def test_a_proof_that_cannot_be_written_is_a_fault(tmp_path: Path) -> None:
    store = Store(tmp_path)
    (tmp_path / "tasks.complete").mkdir()
    assert not store.mend((), ())
    assert "tasks.complete cannot be written" in store.fault
    (tmp_path / "tasks.complete").rmdir()
    assert store.mend((), ())


@pytest.mark.parametrize("damage", ["a head", "the middle"])
def test_a_damaged_file_is_moved_aside_and_reported(tmp_path: Path, damage: str) -> None:
    store = Store(tmp_path)
    for k in range(300):
        store.put(pb.Task(id=f"task {k}", state="succeeded", message="x" * 300))
    assert store.mend((), ())
    store.close()
    file = tmp_path / "tasks.sqlite"
    raw = bytearray(file.read_bytes())
    at = 0 if damage == "a head" else len(raw) // 8
    raw[at : at + 9000] = b"\xa5" * 9000
    file.write_bytes(raw)
    again = Store(tmp_path)
    assert again.tasks() == []
    assert not again.proven
    assert "tasks.sqlite.damaged-1" in again.said
    assert (tmp_path / "tasks.sqlite.damaged-1").read_bytes() == bytes(raw)
    assert again.put(pb.Task(id="new"))


def test_rows_that_cannot_be_read_are_left_out(tmp_path: Path) -> None:
    store = Store(tmp_path)
    store.put(pb.Task(id="good", state="failed"))
    store.put(pb.Task(id="bad", state="failed"))
    store.keep("bad", Entry())
    with store._db:
        store._db.execute("UPDATE tasks SET message = x'ff' WHERE id = 'bad'")
        store._db.execute("UPDATE journal SET memory = 'no JSON'")
    assert [t.id for t in store.tasks()] == ["good"]
    with pytest.raises(ValueError, match="Expecting value"):
        store.entry("bad")


@pytest.mark.parametrize("epoch", ["{}", "[]", "3", "nonsense", '["boot", null]'])
def test_a_journal_that_cannot_be_read_is_a_value_error(tmp_path: Path, epoch: str) -> None:
    store = Store(tmp_path)
    store.keep("a", Entry())
    with closing(sqlite3.connect(store.path)) as other, other:
        other.execute("UPDATE journal SET epoch = ?", (epoch,))
    with pytest.raises(ValueError, match=r".+"):
        store.entry("a")


def test_a_table_that_cannot_be_read_is_reported_with_the_file_and_a_remedy(tmp_path: Path) -> None:
    store = Store(tmp_path)
    with closing(sqlite3.connect(store.path)) as other, other:
        other.execute("DROP TABLE decisions")
    with pytest.raises(Unavailable, match=r"tasks\.sqlite cannot be read: .*; .+"):
        store.decisions("a")


def test_a_write_after_close_is_no_fault_and_keeps_the_proof(tmp_path: Path) -> None:
    store = Store(tmp_path)
    assert store.mend((), ())
    store.close()
    assert not store.keep("a", Entry())
    assert store.fault == ""
    assert Store(tmp_path).proven


def free_kb(folder: Path) -> float:
    """Return the free space on the disk of a folder."""
    disk = os.statvfs(folder)
    return disk.f_bavail * disk.f_frsize / 1024


def test_a_full_store_leaves_freed_space_unused_until_there_is_enough(
    tmp_path: Path,
) -> None:
    with small_disk(tmp_path / "disk", kilobytes=4096) as disk, closing(Store(disk)) as store:
        kept = store.add(pb.Decision(task_id="a", index=0, why="x" * 30_000))
        assert kept
        filler = fill(disk)
        index = 1
        while store.add(pb.Decision(task_id="a", index=index, why="x" * 30_000)):
            index += 1
        assert "at least 256 KB" in store.fault
        os.truncate(filler, filler.stat().st_size - 150 * 1024)
        before_kb = free_kb(disk)
        assert before_kb > 100
        assert store.put(pb.Task(id="a", state="running"))  # a small write fits
        before_kb = min(before_kb, free_kb(disk))
        for _ in range(3):
            assert not store.mend([], [])
            assert free_kb(disk) >= before_kb
        assert store.fault
        filler.unlink()
        assert store.mend([], [])
        assert not store.fault


def test_the_write_ahead_log_does_not_grow_with_the_amount_written(tmp_path: Path) -> None:
    store = Store(tmp_path, most_decisions=3)
    for index in range(300):
        assert store.add(pb.Decision(task_id="a", index=index, why="x" * 10_000))
    log_kb = store.path.with_name("tasks.sqlite-wal").stat().st_size / 1024
    assert log_kb < 512
    store.close()
