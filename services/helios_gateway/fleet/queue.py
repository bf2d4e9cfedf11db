"""Queue of the fleet in a SQLite file, so that it outlives a restart of the gateway.

Every change is on the disk before the method returns. Without a file that can be used the queue
lives in memory.
"""

from __future__ import annotations

import json
import logging
import sqlite3
import threading
import time
from collections.abc import Collection
from pathlib import Path
from typing import Any

from google.protobuf.message import DecodeError
from helios_core import proto as pb
from helios_core.damaged_database import is_damaged, put_aside
from helios_core.errors import Conflict, Unavailable

from helios_gateway.error_responses import NotFound
from helios_gateway.fleet.records import FleetTask, Stage, WithdrawnOffer

log = logging.getLogger(__name__)

MOST_ENDED = 1000  # the oldest ended tasks beyond are deleted
MOST_OPEN = 500  # a further task is refused
_SCHEMA = """
CREATE TABLE IF NOT EXISTS tasks (
    id TEXT PRIMARY KEY, stage TEXT NOT NULL, record TEXT NOT NULL, request BLOB NOT NULL,
    task BLOB NOT NULL
);
CREATE TABLE IF NOT EXISTS withdrawn (
    task_id TEXT PRIMARY KEY, robot TEXT NOT NULL, since_s REAL NOT NULL
);
"""
_PUT = "INSERT OR REPLACE INTO tasks VALUES (?, ?, ?, ?, ?)"
_WITHDRAW = "INSERT OR REPLACE INTO withdrawn VALUES (?, ?, ?)"
_PLAIN = (
    "created_s", "wanted", "robot", "task_id", "why", "end", "message", "ended_s", "cancelling",
    "returned", "refused",
)  # fmt: skip
Statement = tuple[str, tuple]
_Content = tuple[sqlite3.Connection, dict[str, FleetTask], dict[str, WithdrawnOffer]]


class FleetQueue:
    """Tasks of the fleet, by id. Thread-safe.

    Methods that write raise Unavailable, and change nothing, if the file cannot be written.
    """

    def __init__(self, file: Path | None) -> None:
        """A damaged file is replaced by a new one. If the file cannot be used, the queue is empty
        and lives in memory."""
        self._lock = threading.Lock()
        self._path = file
        self.said = ""  # that the file was damaged and is put aside
        self.fault = ""  # why the file is not used, and the remedy
        try:
            self._db, self._tasks, self._withdrawn = self._opened()
        except (OSError, sqlite3.Error) as error:
            self.fault = (
                f"the tasks of the fleet cannot be kept in {file} ({error}), so a restart loses "
                "them: make that file writable, or name another with --fleet-queue, and restart "
                "the gateway"
            )
            log.error("%s", self.fault)
            self._path = None
            self._db, self._tasks, self._withdrawn = _read(None)

    def _opened(self) -> _Content:
        """Content of the file. Raises OSError and sqlite3.Error if it cannot be used."""
        try:
            return _read(self._path)
        except sqlite3.DatabaseError as error:
            if self._path is None or not is_damaged(error):
                raise
            self.said = (
                f"the tasks of the fleet cannot be read ({error}): their file was put aside as "
                f"{put_aside(self._path)}, and the queue is empty"
            )
            log.error("%s", self.said)
            return _read(self._path)

    def close(self) -> None:
        with self._lock:
            self._db.close()

    def get(self, id: str) -> FleetTask:
        """Raises NotFound."""
        with self._lock:
            task = self._tasks.get(id)
        if task is None:
            raise NotFound(
                f"there is no task {id[:40]!r} of the fleet; list them with GET /v1/fleet/tasks"
            )
        return task

    def tasks(self) -> list[FleetTask]:
        """All tasks, oldest first."""
        with self._lock:
            return sorted(self._tasks.values(), key=lambda t: (t.created_s, t.id))

    def open_tasks(self) -> list[FleetTask]:
        """Tasks that have not ended, in the order in which robots get them."""
        return sorted(
            (task for task in self.tasks() if not task.ended), key=lambda t: -t.request.priority
        )

    def withdrawn(self) -> list[WithdrawnOffer]:
        with self._lock:
            return list(self._withdrawn.values())

    def add(self, task: FleetTask) -> None:
        """Store a new task, and delete the oldest ended ones beyond `MOST_ENDED`. Raises Conflict
        if `MOST_OPEN` have not ended."""
        with self._lock:
            if len(self._tasks) - sum(t.ended for t in self._tasks.values()) >= MOST_OPEN:
                raise Conflict(
                    f"{MOST_OPEN} tasks of the fleet wait or run, the most that it takes: cancel "
                    "some, or submit it again once they have run"
                )
            ended = sorted((t.created_s, t.id) for t in self._tasks.values() if t.ended)
            gone = [id for _, id in ended[: max(0, len(ended) - MOST_ENDED)]]
            self._write(
                (_PUT, _row(task)), *(("DELETE FROM tasks WHERE id = ?", (i,)) for i in gone)
            )
            self._tasks[task.id] = task
            for id in gone:
                del self._tasks[id]

    def change(self, id: str, stages: Collection[Stage], **changes: Any) -> FleetTask | None:
        """Change a task that is in one of these stages; None, and no change, for another one."""
        with self._lock:
            task = self._tasks.get(id)
            if task is None or task.stage not in stages:
                return None
            changed = task.with_(**changes)
            self._write((_PUT, _row(changed)))
            self._tasks[id] = changed
            return changed

    def observe(self, id: str, task_id: str, task: pb.Task) -> None:
        """Keep, in memory alone, how a begun task goes at its robot."""
        with self._lock:
            known = self._tasks.get(id)
            if known is not None and known.stage is Stage.BEGUN and known.task_id == task_id:
                self._tasks[id] = known.with_(task=task)

    def withdraw(
        self, id: str, task_id: str, stages: Collection[Stage], **changes: Any
    ) -> FleetTask | None:
        """Take a task from its robot, with the duty to cancel its offer there.

        None, and no change, if the task is in another stage or has another offer.
        """
        with self._lock:
            task = self._tasks.get(id)
            if task is None or task.stage not in stages or task.task_id != task_id:
                return None
            offer = WithdrawnOffer(task.robot, task.task_id, time.time())
            changed = task.withdrawn(**changes)
            self._write(
                (_PUT, _row(changed)), (_WITHDRAW, (offer.task_id, offer.robot, offer.since_s))
            )
            self._tasks[id] = changed
            self._withdrawn[offer.task_id] = offer
            return changed

    def forget(self, offer: WithdrawnOffer) -> None:
        """End the duty to cancel an offer."""
        with self._lock:
            self._write(("DELETE FROM withdrawn WHERE task_id = ?", (offer.task_id,)))
            self._withdrawn.pop(offer.task_id, None)

    def _write(self, *statements: Statement) -> None:
        """Write all or nothing. The caller holds the lock."""
        try:
            with self._db:
                for statement, values in statements:
                    self._db.execute(statement, values)
        except sqlite3.Error as error:
            remedy = (
                "restart the gateway, which puts the file aside"
                if is_damaged(error)
                else "make room on that disk, then try again"
            )
            raise Unavailable(
                f"the fleet's queue cannot be written to {self._path or 'memory'} ({error}); "
                f"{remedy}"
            ) from error


def _read(file: Path | None) -> _Content:
    """Open a database, or one in memory, and read it.

    Raises OSError and sqlite3.Error if it cannot be read and written.
    """
    if file is not None:
        file.parent.mkdir(parents=True, exist_ok=True)
    db = sqlite3.connect(file or ":memory:", check_same_thread=False)
    try:
        with db:
            db.executescript(_SCHEMA)
        db.execute("PRAGMA journal_mode=WAL")
        db.execute("PRAGMA synchronous=FULL")
        with db:
            db.execute("DELETE FROM withdrawn WHERE false")  # fails if the file can only be read
        tasks = {task.id: task for task in _read_tasks(db)}
        rows = db.execute("SELECT robot, task_id, since_s FROM withdrawn").fetchall()
    except BaseException:
        db.close()
        raise
    return db, tasks, {offer.task_id: offer for offer in (WithdrawnOffer(*row) for row in rows)}


def _row(task: FleetTask) -> tuple:
    record = {name: getattr(task, name) for name in _PLAIN}
    record["refused"] = dict(task.refused)
    return (
        task.id,
        task.stage.value,
        json.dumps(record),
        task.request.SerializeToString(),
        task.task.SerializeToString(),
    )


def _read_tasks(db: sqlite3.Connection) -> list[FleetTask]:
    """All tasks that can be read."""
    out = []
    rows = db.execute("SELECT id, stage, record, request, task FROM tasks").fetchall()
    for id, stage, record, request, task in rows:
        try:
            plain = json.loads(record)
            out.append(
                FleetTask(
                    id=id,
                    request=pb.SubmitRequest.FromString(request),
                    task=pb.Task.FromString(task),
                    stage=Stage(stage),
                    **{name: plain[name] for name in _PLAIN},
                )
            )
        except (DecodeError, ValueError, KeyError, TypeError) as error:
            log.error("task %s of the fleet cannot be read (%s): it is left out", id, error)
    return out
