"""Tasks and decisions that outlive the process: SQLite in the state directory.

Rows hold the messages as they travel, so that what is told later is what was told then.
"""

from __future__ import annotations

import sqlite3
import threading
from pathlib import Path

from helios_core import proto as pb
from helios_core.errors import Unavailable

_SCHEMA = """
CREATE TABLE IF NOT EXISTS tasks (
    id TEXT PRIMARY KEY, created_s REAL NOT NULL, state TEXT NOT NULL, message BLOB NOT NULL
);
CREATE TABLE IF NOT EXISTS decisions (
    task_id TEXT NOT NULL, number INTEGER NOT NULL, message BLOB NOT NULL,
    PRIMARY KEY (task_id, number)
);
"""


class Store:
    """Safe from any thread. Raises Unavailable where the file cannot be used.

    Of each task the newest `most_decisions` stay; `forget` takes a task out.
    """

    def __init__(self, directory: Path, most_decisions: int = 2000) -> None:
        self._lock = threading.Lock()
        self._most_decisions = most_decisions
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
        with self._lock, self._db:
            self._db.execute("INSERT OR REPLACE INTO tasks VALUES (?, ?, ?, ?)", row)

    def add(self, decision: pb.Decision) -> None:
        """Keep a decision under its task and number, and let go of the oldest one too many."""
        row = (decision.task_id, decision.index, decision.SerializeToString())
        over = (decision.task_id, decision.index - self._most_decisions)
        with self._lock, self._db:
            self._db.execute("INSERT OR REPLACE INTO decisions VALUES (?, ?, ?)", row)
            self._db.execute("DELETE FROM decisions WHERE task_id = ? AND number <= ?", over)

    def forget(self, id: str) -> None:
        """Let go of a task and all that is kept of it."""
        with self._lock, self._db:
            self._db.execute("DELETE FROM decisions WHERE task_id = ?", (id,))
            self._db.execute("DELETE FROM tasks WHERE id = ?", (id,))

    def get(self, id: str) -> pb.Task | None:
        """A task by its id."""
        with self._lock:
            row = self._db.execute("SELECT message FROM tasks WHERE id = ?", (id,)).fetchone()
        return pb.Task.FromString(row[0]) if row else None

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

    def close(self) -> None:
        with self._lock:
            self._db.close()
