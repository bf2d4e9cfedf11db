"""Tasks and decisions that outlive the process: SQLite in the state directory.

Rows hold the messages as they travel, so that what is told later is what was told then.
"""

from __future__ import annotations

import json
import logging
import sqlite3
import threading
import time
from pathlib import Path

from helios_core import proto as pb
from helios_core.errors import Unavailable

from helios_planner.tasks.journal import Entry

log = logging.getLogger(__name__)

_SCHEMA = """
CREATE TABLE IF NOT EXISTS tasks (
    id TEXT PRIMARY KEY, created_s REAL NOT NULL, state TEXT NOT NULL, message BLOB NOT NULL
);
CREATE TABLE IF NOT EXISTS decisions (
    task_id TEXT NOT NULL, number INTEGER NOT NULL, message BLOB NOT NULL,
    PRIMARY KEY (task_id, number)
);
CREATE TABLE IF NOT EXISTS journal (
    task_id TEXT PRIMARY KEY, life INTEGER NOT NULL, request BLOB, result BLOB,
    memory TEXT NOT NULL, epoch TEXT NOT NULL, saved_s REAL NOT NULL
);
CREATE TABLE IF NOT EXISTS pulse (one INTEGER PRIMARY KEY CHECK (one = 1), at_s REAL NOT NULL);
"""


class Store:
    """Safe from any thread. Raises Unavailable where the file cannot be used at the start.

    Of each task the newest `most_decisions` stay; `forget` takes a task out.
    """

    def __init__(self, directory: Path, most_decisions: int = 2000) -> None:
        self._lock = threading.Lock()
        self._most_decisions = most_decisions
        self._said = ""  # the last error of writing
        self.path = directory / "tasks.sqlite"
        try:
            directory.mkdir(parents=True, exist_ok=True)
            self._db = sqlite3.connect(self.path, check_same_thread=False)
            with self._db:
                self._db.executescript(_SCHEMA)
            self._db.execute("PRAGMA journal_mode=WAL")
            self._db.execute("PRAGMA synchronous=NORMAL")
        except (OSError, sqlite3.Error) as error:
            raise Unavailable(
                f"tasks cannot be kept in {self.path}: {error}; give another --state-dir, or move "
                "the file away"
            ) from error

    def put(self, task: pb.Task) -> None:
        """Keep a task as it is now."""
        row = (task.id, task.created_s, task.state, task.SerializeToString())
        self._write(("INSERT OR REPLACE INTO tasks VALUES (?, ?, ?, ?)", row))

    def add(self, decision: pb.Decision) -> None:
        """Keep a decision under its task and number, and let go of the oldest one too many."""
        row = (decision.task_id, decision.index, decision.SerializeToString())
        over = (decision.task_id, decision.index - self._most_decisions)
        self._write(
            ("INSERT OR REPLACE INTO decisions VALUES (?, ?, ?)", row),
            ("DELETE FROM decisions WHERE task_id = ? AND number <= ?", over),
        )

    def forget(self, id: str) -> None:
        """Let go of a task and all that is kept of it."""
        self._write(
            ("DELETE FROM decisions WHERE task_id = ?", (id,)),
            ("DELETE FROM journal WHERE task_id = ?", (id,)),
            ("DELETE FROM tasks WHERE id = ?", (id,)),
        )

    def tasks(self) -> list[pb.Task]:
        """All tasks, oldest first."""
        with self._lock:
            rows = self._db.execute("SELECT message FROM tasks ORDER BY created_s").fetchall()
        return [pb.Task.FromString(row[0]) for row in rows]

    def decisions(self, task_id: str) -> list[pb.Decision]:
        """A task's decisions in order."""
        with self._lock:
            rows = self._db.execute(
                "SELECT message FROM decisions WHERE task_id = ? ORDER BY number", (task_id,)
            ).fetchall()
        return [pb.Decision.FromString(row[0]) for row in rows]

    def last_number(self, task_id: str) -> int:
        """Number of a task's newest decision; -1 for none."""
        with self._lock:
            row = self._db.execute(
                "SELECT MAX(number) FROM decisions WHERE task_id = ?", (task_id,)
            ).fetchone()
        return -1 if row[0] is None else int(row[0])

    # --- the journal ---------------------------------------------------------------------------
    def keep(self, task_id: str, entry: Entry) -> None:
        """Keep what a running task needs to go on."""
        request = entry.request.SerializeToString() if entry.request is not None else None
        result = entry.result.SerializeToString() if entry.result is not None else None
        row = (task_id, entry.life, request, result, json.dumps(entry.memory),
               json.dumps(entry.epoch), time.time())  # fmt: skip
        self._write(("INSERT OR REPLACE INTO journal VALUES (?, ?, ?, ?, ?, ?, ?)", row))

    def entry(self, task_id: str) -> Entry | None:
        """What was kept of a running task."""
        with self._lock:
            row = self._db.execute(
                "SELECT life, request, result, memory, epoch FROM journal WHERE task_id = ?",
                (task_id,),
            ).fetchone()
        if row is None:
            return None
        life, request, result, memory, epoch = row
        boot = json.loads(epoch)
        return Entry(
            life,
            None if request is None else pb.ActionRequest.FromString(request),
            None if result is None else pb.ActionResult.FromString(result),
            json.loads(memory),
            None if boot is None else (str(boot[0]), int(boot[1])),
        )

    def settle(self, task_id: str) -> None:
        """The task has ended: its journal is needed no more."""
        self._write(("DELETE FROM journal WHERE task_id = ?", (task_id,)))

    # --- the planner itself --------------------------------------------------------------------
    def pulse(self, at_s: float) -> None:
        """The planner was alive then; 0: it was stopped."""
        self._write(("INSERT OR REPLACE INTO pulse VALUES (1, ?)", (at_s,)))

    def alive_s(self) -> float:
        """When a planner was alive last; 0: it was stopped, or there was none."""
        with self._lock:
            row = self._db.execute("SELECT at_s FROM pulse").fetchone()
        return float(row[0]) if row else 0.0

    def close(self) -> None:
        with self._lock:
            self._db.close()

    def _write(self, *statements: tuple[str, tuple]) -> None:
        """All or nothing. A full disk ends no task: what could not be kept is said once."""
        try:
            with self._lock, self._db:
                for statement, values in statements:
                    self._db.execute(statement, values)
        except sqlite3.Error as error:
            if str(error) != self._said:
                log.error("cannot keep tasks in %s: %s; the task goes on", self.path, error)
            self._said = str(error)
        else:
            self._said = ""
