"""Storage of tasks and decisions over restarts: SQLite in the state directory.

Rows hold the published messages, so that later responses equal what was published.

A change that must outlive a restart is on the disk before it is published. If the disk refuses a
write (it is full), `fault` holds the reason from then until `mend` has written everything, and
`write_proof.py` shows the next planner that data may be missing.
"""

from __future__ import annotations

import json
import logging
import sqlite3
import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import astuple, dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from google.protobuf.message import DecodeError
from helios_core import proto as pb
from helios_core.errors import Unavailable
from helios_core.types import WorldId

from helios_planner.refuted_things import KEPT_S, RefutedThing
from helios_planner.tasks.database import MAKE_ROOM, has_room, opened, remedy, shorten_log
from helios_planner.tasks.write_proof import WriteProof

Checkpoint = dict[str, Any]  # JSON
log = logging.getLogger(__name__)
_PUT = "INSERT OR REPLACE INTO tasks VALUES (?, ?, ?, ?)"
_SETTLE = "DELETE FROM journal WHERE task_id = ?"
Statement = tuple[str, tuple]
Row = TypeVar("Row", pb.Task, pb.Decision)


@dataclass(frozen=True)
class Entry:
    """Journal of one task. `life` counts its resumptions. A request without result has
    an unknown outcome."""

    life: int = 0
    request: pb.ActionRequest | None = None
    result: pb.ActionResult | None = None
    checkpoint: Checkpoint = field(default_factory=dict)
    epoch: tuple[str, int] | None = None  # world of its poses: (boot id, world epoch)


class Store:
    """Store of the tasks. Thread-safe. Raises Unavailable if the file cannot be used at the start.

    Methods that write return True if the data is stored; those that read raise Unavailable if the
    file is damaged. Of each task the newest `most_decisions` stay; `forget` deletes a task.
    `proven`: True if the previous store held all that was published. `said`: message about its
    file.
    """

    def __init__(self, directory: Path, most_decisions: int = 2000) -> None:
        self._lock = threading.Lock()
        self._most_decisions = most_decisions
        self.path = directory / "tasks.sqlite"
        self._db, self.said = opened(self.path)
        self._proof = WriteProof(directory / "tasks.complete")
        self.proven = self._proof.holds and not self.said
        self._fault, self._fault_since_s = "", 0.0
        self._closed = False
        self._on_fault: Callable[[], None] = lambda: None

    def watch(self, on_fault: Callable[[], None]) -> None:
        """on_fault: called from the writing thread when `fault` has changed."""
        self._on_fault = on_fault

    @property
    def fault(self) -> str:
        """Why tasks cannot be stored, and the remedy; empty while they can."""
        return self._fault

    @property
    def fault_s(self) -> float:
        """Duration of the present fault."""
        return time.monotonic() - self._fault_since_s if self._fault else 0.0

    # --- tasks and decisions -------------------------------------------------------------------
    def put(self, task: pb.Task, safe: bool = False) -> bool:
        """Store a task as it is now; safe: also against a loss of power."""
        return self._write((_PUT, _row(task)), safe=safe)

    def finish(self, task: pb.Task) -> bool:
        """Store the end of a task and delete its journal, both safe against a loss of power."""
        return self._write((_PUT, _row(task)), (_SETTLE, (task.id,)), safe=True)

    def add(self, decision: pb.Decision) -> bool:
        """Store a decision under its task and number, and delete the oldest beyond the limit."""
        return self._write(*self._additions(decision))

    def _additions(self, decision: pb.Decision) -> tuple[Statement, Statement]:
        row = (decision.task_id, decision.index, decision.SerializeToString())
        over = (decision.task_id, decision.index - self._most_decisions)
        return (
            ("INSERT OR REPLACE INTO decisions VALUES (?, ?, ?)", row),
            ("DELETE FROM decisions WHERE task_id = ? AND number <= ?", over),
        )

    def forget(self, id: str) -> bool:
        """Delete a task and all its data."""
        return self._write(
            ("DELETE FROM decisions WHERE task_id = ?", (id,)),
            (_SETTLE, (id,)),
            ("DELETE FROM tasks WHERE id = ?", (id,)),
        )

    def tasks(self) -> list[pb.Task]:
        """All tasks that can be read, oldest first."""
        rows = self._rows("SELECT id, message FROM tasks ORDER BY created_s")
        return [task for id, row in rows if (task := _decoded(pb.Task, row, f"task {id}"))]

    def decisions(self, task_id: str) -> list[pb.Decision]:
        """The readable decisions of a task, in order."""
        sql = "SELECT message FROM decisions WHERE task_id = ? ORDER BY number"
        rows = self._rows(sql, task_id)
        what = f"a decision of task {task_id}"
        return [d for row in rows if (d := _decoded(pb.Decision, row[0], what))]

    def last_number(self, task_id: str) -> int:
        """Number of a task's newest decision; -1 without any."""
        (row,) = self._rows("SELECT MAX(number) FROM decisions WHERE task_id = ?", task_id)
        return -1 if row[0] is None else int(row[0])

    # --- the journal ---------------------------------------------------------------------------
    def keep(self, task_id: str, entry: Entry) -> bool:
        """Store the journal of a running task."""
        request = entry.request.SerializeToString() if entry.request is not None else None
        result = entry.result.SerializeToString() if entry.result is not None else None
        row = (
            task_id,
            entry.life,
            request,
            result,
            json.dumps(entry.checkpoint),
            json.dumps(entry.epoch),
            time.time(),
        )
        return self._write(("INSERT OR REPLACE INTO journal VALUES (?, ?, ?, ?, ?, ?, ?)", row))

    def entry(self, task_id: str) -> Entry | None:
        """Journal of a running task. Raises ValueError if it cannot be read."""
        sql = "SELECT life, request, result, memory, epoch FROM journal WHERE task_id = ?"
        try:
            rows = self._rows(sql, task_id)
            if not rows:
                return None
            life, request, result, checkpoint, epoch = rows[0]
            boot = json.loads(epoch)
            return Entry(
                life,
                None if request is None else pb.ActionRequest.FromString(request),
                None if result is None else pb.ActionResult.FromString(result),
                json.loads(checkpoint),
                None if boot is None else (str(boot[0]), int(boot[1])),
            )
        except (DecodeError, LookupError, TypeError, Unavailable) as error:
            raise ValueError(f"{type(error).__name__}: {error}") from error

    # --- things that looked wrong in the hand --------------------------------------------------
    def refuted(self, world: WorldId) -> list[RefutedThing]:
        """Refuted things of a world, oldest first."""
        rows = self._rows(
            "SELECT class, x_m, y_m, z_m, probability, unnamed, at_s FROM refuted "
            "WHERE world = ? ORDER BY at_s",
            _name(world),
        )
        return [RefutedThing(c, (x, y, z), p, bool(u), at_s) for c, x, y, z, p, u, at_s in rows]

    def keep_refuted(self, world: WorldId, things: Iterable[RefutedThing]) -> bool:
        """Replace the refuted things of a world, and delete those of others that are too old."""
        here = _name(world)
        rows = [(here, t.class_name, *t.center_m, t.probability, t.unnamed, t.at_s) for t in things]
        put = "INSERT INTO refuted VALUES (?, ?, ?, ?, ?, ?, ?, ?)"
        delete = "DELETE FROM refuted WHERE world = ? OR at_s < ?"
        return self._write((delete, (here, time.time() - KEPT_S)), *[(put, row) for row in rows])

    # --- the planner itself --------------------------------------------------------------------
    def note_alive(self, at_s: float) -> bool:
        """Store when the planner was alive; 0: it was stopped."""
        return self._write(("INSERT OR REPLACE INTO alive VALUES (1, ?)", (at_s,)))

    def alive_s(self) -> float:
        """Time when a planner was last alive; 0: it was stopped, or there was none."""
        rows = self._rows("SELECT at_s FROM alive")
        return float(rows[0][0]) if rows else 0.0

    def mend(
        self,
        open_tasks: Iterable[pb.Task],
        ended: Iterable[pb.Task],
        decisions: Iterable[pb.Decision] = (),
    ) -> bool:
        """Write everything missing, after a fault and at the start; True if all is stored now.
        open_tasks, ended: present states of tasks whose stored ones may be out of date. decisions:
        those that could not be stored."""
        if not self._has_room():
            return False
        written = self._write(
            *[(_PUT, _row(task)) for task in (*open_tasks, *ended)],
            *[(_SETTLE, (task.id,)) for task in ended],
            *[one for decision in decisions for one in self._additions(decision)],
            ("INSERT OR REPLACE INTO alive VALUES (1, ?)", (time.time(),)),
            safe=True,
        )
        if not written:
            return False
        with self._lock:
            was, missing = self._fault, self._proof.write()
            if missing:
                self._failed(missing)
            elif was:
                self._fault = ""
                log.warning("tasks are kept in %s again", self.path)
        if was != self._fault:
            self._on_fault()
        return not missing

    def _has_room(self) -> bool:
        """True if the disk has room for writes; else sets `fault`."""
        with self._lock:
            if self._closed:
                return False
            shorten_log(self._db)
            if has_room(self.path):
                return True
            changed = not self._fault and self._failed(
                f"tasks cannot be kept in {self.path}: the disk is full; {MAKE_ROOM}"
            )
        if changed:
            self._on_fault()
        return False

    def close(self) -> None:
        """Close the database. Later writes do nothing and set no fault."""
        with self._lock:
            self._closed = True
            self._db.close()

    def _rows(self, sql: str, *values: object) -> list[tuple]:
        """Rows of a query. Raises Unavailable if the file cannot be read."""
        with self._lock:
            try:
                return self._db.execute(sql, values).fetchall()
            except sqlite3.Error as error:
                raise Unavailable(
                    f"{self.path} cannot be read: {error}; {remedy(error)}"
                ) from error

    def _write(self, *statements: Statement, safe: bool = False) -> bool:
        """Write all statements or none. A repeated fault is logged once."""
        with self._lock:
            if self._closed:
                return False
            try:
                self._db.execute(f"PRAGMA synchronous={'FULL' if safe else 'NORMAL'}")
                with self._db:
                    for statement, values in statements:
                        self._db.execute(statement, values)
                return True
            except sqlite3.Error as error:
                changed = self._failed(
                    f"tasks cannot be kept in {self.path}: {error}; {remedy(error)}"
                )
        if changed:
            self._on_fault()
        return False

    def _failed(self, fault: str) -> bool:
        """Record a fault; True if it is a new one. The caller holds the lock."""
        if not self._fault:
            self._fault_since_s = time.monotonic()
            self._proof.take()
        if fault == self._fault:
            return False
        self._fault = fault
        log.error("%s; until then no task and no action is begun", fault)
        return True


def _name(world: WorldId) -> str:
    """Key of a world in the table of refuted things."""
    return json.dumps(astuple(world))


def _row(task: pb.Task) -> tuple:
    return task.id, task.created_s, task.state, task.SerializeToString()


def _decoded(kind: type[Row], row: bytes, what: str) -> Row | None:
    try:
        return kind.FromString(row)
    except DecodeError as error:
        log.error("%s cannot be read (%s): it is left out", what, error)
        return None
