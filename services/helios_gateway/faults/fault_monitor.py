"""Faults of one robot: findings go into the book, confirmed ones begin a recording."""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

from google.protobuf.message import Message
from helios_core import proto as pb
from helios_core.errors import Conflict
from helios_core.image_messages import ImageMessage

from helios_gateway.error_responses import NotFound
from helios_gateway.faults import findings
from helios_gateway.faults.black_box import BlackBox
from helios_gateway.faults.fault_files import FaultFiles, RecordingNote
from helios_gateway.faults.life_cycle import Fault, FaultRegistry, FaultState, Finding

log = logging.getLogger(__name__)

AGAIN_S = 60.0  # least time between two recordings of the same fault


class FaultMonitor:
    """Faults and recordings of one robot. Thread-safe.

    folder: for the list and the recordings; None: nothing is kept or recorded.
    tell: gets every fault that has changed.
    """

    def __init__(
        self,
        folder: Path | None,
        limit_bytes: float,
        tell: Callable[[Fault], None],
        clock: Callable[[], float] = time.time,
    ) -> None:
        self._tell, self._clock = tell, clock
        self._files = None if folder is None else FaultFiles(folder, limit_bytes)
        faults, notes = ([], []) if self._files is None else self._files.read()
        self._writing = threading.Lock()  # held while files change; taken before `_lock`
        self._lock = threading.Lock()  # guards the attributes below; never held over I/O
        self._registry = FaultRegistry(faults)
        self._notes = {note.name: note for note in notes}
        self._restarts: dict[str, int] = {}  # by process, of all supervisors
        self._told_tasks = deque((t for note in notes for t in note.tasks), maxlen=256)
        self._box = None if folder is None else BlackBox(self._on_saved)

    # --- input ---------------------------------------------------------------------------------
    def record(self, channel: str, message: Message | ImageMessage) -> None:
        """Give a message of the bus to the black box."""
        if self._box is not None:
            self._box.put(channel, message)

    def observe(self, present: Iterable[Finding]) -> None:
        """Take the conditions that are present now."""
        with self._lock:
            changed = self._registry.observe(self._clock(), present)
            self._follow(changed)
        self._publish(changed)

    def on_supervisor(self, status: pb.SupervisorStatus) -> None:
        """Take the restarts of processes."""
        with self._lock:
            found, self._restarts = findings.restarts(self._restarts, status)
            changed = [f for finding in found for f in self._registry.occur(self._clock(), finding)]
            self._follow(changed)
        self._publish(changed)

    def on_task(self, task: pb.Task) -> None:
        """Take the end of a task: a failure is a fault, a success clears the faults of tasks."""
        now_s = self._clock()
        if task.state not in ("failed", "succeeded") or now_s - task.ended_s > findings.LATE_S:
            return
        with self._lock:
            if task.id in self._told_tasks:
                return
            self._told_tasks.append(task.id)
            if task.state == "failed":
                changed = self._registry.occur(now_s, findings.failed_task(task))
                self._follow(changed, task.id)
            else:
                of_tasks = [f.id for f in self._registry.faults() if f.source == findings.TASK]
                changed = self._registry.clear(now_s, of_tasks)
                self._follow(changed)
        self._publish(changed)

    def clear(self, id: str) -> Fault:
        """Clear a fault. Raises NotFound for an unknown one, Conflict if it is still present."""
        with self._lock:
            fault = self._registry.get(id)
            if fault is None:
                raise NotFound(f"there is no fault {id[:80]!r}; list them with GET /v1/faults")
            if fault.present:
                raise Conflict(f"{id} is still present: {fault.message}; mend that first")
            changed = self._registry.clear(self._clock(), [id])
            self._follow(changed)
            fault = self._registry.get(id)
            assert fault is not None
        self._publish(changed)
        return fault

    # --- output --------------------------------------------------------------------------------
    def faults(self) -> tuple[Fault, ...]:
        with self._lock:
            return self._registry.faults()

    def recordings(self) -> tuple[RecordingNote, ...]:
        """Recordings, newest first."""
        with self._lock:
            return tuple(reversed(self._notes.values()))

    def recordings_of(self, task_id: str) -> list[str]:
        """Names of the recordings around the failure of a task."""
        with self._lock:
            return [name for name, note in self._notes.items() if task_id in note.tasks]

    @property
    def folder(self) -> Path | None:
        return None if self._files is None else self._files.folder

    def path(self, name: str) -> Path | None:
        """Path of a finished recording; None if there is none."""
        return None if self._files is None else self._files.path(name)

    def close(self) -> None:
        """End the present recording now."""
        if self._box is not None:
            self._box.close()

    # --- internals: the caller holds the lock ----------------------------------------------------
    def _follow(self, changed: list[Fault], task_id: str = "") -> None:
        """Begin the recordings of newly confirmed faults."""
        now_s = self._clock()
        for fault in changed:
            if fault.state is FaultState.CONFIRMED and (task_id or self._is_due(fault, now_s)):
                self._record(fault, task_id, now_s)

    def _is_due(self, fault: Fault, now_s: float) -> bool:
        made_s = [note.made_s for note in self._notes.values() if fault.id in note.faults]
        return not made_s or not 0 <= now_s - made_s[-1] < AGAIN_S  # the clock may have jumped

    def _record(self, fault: Fault, task_id: str, now_s: float) -> None:
        if self._box is None:
            return
        stamp = datetime.fromtimestamp(now_s, UTC).strftime("%Y%m%dT%H%M%SZ")
        about = {"fault": fault.id, "message": fault.message, "task": task_id}
        name = self._box.record(f"{stamp}-{fault.id[:80]}.mcap", about)
        note = self._notes.get(name) or RecordingNote(name, now_s)
        faults = tuple(dict.fromkeys((*note.faults, fault.id)))
        tasks = tuple(dict.fromkeys((*note.tasks, *([task_id] if task_id else []))))
        self._notes[name] = replace(note, faults=faults, tasks=tasks)

    # --- internals: the caller does not hold the lock --------------------------------------------
    def _on_saved(self, name: str, data: bytes) -> None:
        """Store a finished recording; from the thread of the black box."""
        assert self._files is not None
        with self._writing:
            with self._lock:
                made = [note for note in self._notes.values() if note.bytes]
            kept = {note.name for note in self._files.shorten(made, len(data))}
            gone = {note.name for note in made} - kept
            saved = self._files.save(name, data)
            with self._lock:
                self._notes = {n.name: n for n in self._notes.values() if n.name not in gone}
                note = self._notes.pop(name, None) or RecordingNote(name, self._clock())
                if saved:
                    self._notes[name] = replace(note, bytes=len(data))
        self._store()

    def _store(self) -> None:
        """Write the present list."""
        if self._files is None:
            return
        with self._writing:
            with self._lock:
                faults, notes = self._registry.faults(), list(self._notes.values())
            self._files.write(faults, notes)

    def _publish(self, changed: Sequence[Fault]) -> None:
        """Tell of changed faults, and store the list."""
        for fault in changed:
            log.info("fault %s %s: %s", fault.id, fault.state, fault.message)
            self._tell(fault)
        if changed:
            self._store()
