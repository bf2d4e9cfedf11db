"""SQLite file of the tasks: opening it, setting a damaged one aside, and checking disk space.

SQLite's write-ahead log (`-wal`) is kept short: on a small disk it would take the space that a
person frees.
"""

from __future__ import annotations

import contextlib
import errno
import logging
import os
import sqlite3
from pathlib import Path

from helios_core.damaged_database import is_damaged, put_aside
from helios_core.errors import Unavailable

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
CREATE TABLE IF NOT EXISTS refuted (
    world TEXT NOT NULL, class TEXT NOT NULL, x_m REAL NOT NULL, y_m REAL NOT NULL,
    z_m REAL NOT NULL, probability REAL NOT NULL, unnamed INTEGER NOT NULL, at_s REAL NOT NULL
);
CREATE TABLE IF NOT EXISTS alive (one INTEGER PRIMARY KEY CHECK (one = 1), at_s REAL NOT NULL);
"""
ROOM_BYTES = 256 * 1024  # free space that the disk must have before writes are tried again
MAKE_ROOM = (
    f"make room on that disk, at least {ROOM_BYTES // 1024} KB, or see what is wrong with it"
)
LOG_PAGES = 64  # pages of 4 KB after which the log is written into the database
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT)


def opened(path: Path) -> tuple[sqlite3.Connection, str]:
    """The database, and a message about its file, usually empty; a damaged file is replaced by a
    new one.

    Raises Unavailable if it cannot be opened.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            return _connected(path), ""
        except sqlite3.DatabaseError as error:
            if not is_damaged(error):
                raise
            aside = put_aside(path)
            said = (
                f"the tasks of before cannot be read ({error}): their file was put aside as "
                f"{aside}, and nothing is known of them"
            )
            log.error("%s", said)
            return _connected(path), said
    except (OSError, sqlite3.Error) as error:
        raise Unavailable(
            f"tasks cannot be kept in {path}: {error}; {remedy(error)}, or give another --state-dir"
        ) from error


def remedy(error: Exception) -> str:
    """Advice for a person about an error of the database."""
    code = getattr(error, "sqlite_errorcode", 0) & 0xFF
    if is_damaged(error):
        return "restart the planner, which puts the file aside"
    if code == sqlite3.SQLITE_READONLY:
        return "make that folder writable"
    if code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
        return "end the other process that uses it"
    return MAKE_ROOM


def shorten_log(db: sqlite3.Connection) -> None:
    """Free the disk space of the write-ahead log, as far as the disk allows."""
    with contextlib.suppress(sqlite3.Error):
        db.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()


def has_room(path: Path) -> bool:
    """True if the disk of a database has `ROOM_BYTES` free. No space stays taken."""
    probe = path.with_name(f"{path.name}-room")
    try:
        with probe.open("wb") as file:
            os.posix_fallocate(file.fileno(), 0, ROOM_BYTES)
    except OSError as error:
        return error.errno not in _NO_ROOM  # other errors show when the database is written
    finally:
        with contextlib.suppress(OSError):
            probe.unlink(missing_ok=True)
    return True


def _connected(path: Path) -> sqlite3.Connection:
    db = sqlite3.connect(path, check_same_thread=False)
    try:
        with db:
            db.executescript(_SCHEMA)
        db.execute("PRAGMA journal_mode=WAL")
        db.execute("PRAGMA synchronous=NORMAL")
        db.execute(f"PRAGMA wal_autocheckpoint={LOG_PAGES}")
        db.execute("PRAGMA journal_size_limit=0")
        # Detects damage at the start.
        for table in ("tasks", "decisions", "journal", "refuted", "alive"):
            db.execute(f"SELECT * FROM {table}").fetchall()
    except BaseException:
        db.close()
        raise
    return db
