"""API keys: a TOML file of names, scopes and the SHA-256 of each key.

    [[key]]
    name = "tablet"
    scope = "task"
    sha256 = "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08"

`helios key` writes such entries. Only the owner of the file may read it. It is read again when it
changes, so the removal or replacement of an entry takes effect at once. If a read fails, the keys
of before stay valid, and every request tries to read the file again. If the file or its last entry
is removed, no key is accepted.
"""

from __future__ import annotations

import hashlib
import logging
import threading
import tomllib
from enum import IntEnum
from pathlib import Path
from typing import Literal

from helios_core.errors import InvalidInput
from helios_core.printable_text import plain_error
from helios_core.private_file import check_private
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

log = logging.getLogger(__name__)

_Stamp = tuple[int, int, int]  # modification time (ns), size, mode

ScopeName = Literal["read", "task", "robot", "admin"]


class Scope(IntEnum):
    """Permission of a key; each scope includes the ones before it."""

    READ = 1  # read everything but settings, and stop the robot
    TASK = 2  # tasks, also those that only drive somewhere
    ROBOT = 3  # driving by hand, frames, clear-stop
    ADMIN = 4  # settings of the services; load and reset maps

    @property
    def label(self) -> ScopeName:
        """Name in key files and responses."""
        return _NAMES[self]


OLD_NAMES = {"operate": Scope.ROBOT}  # in files of earlier versions, with the same permissions
_NAMES: dict[Scope, ScopeName] = {
    Scope.READ: "read",
    Scope.TASK: "task",
    Scope.ROBOT: "robot",
    Scope.ADMIN: "admin",
}


class ApiKey(BaseModel):
    """One entry of the key file."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str = Field(min_length=1)
    scope: Scope
    sha256: str = Field(pattern="^[0-9a-f]{64}$")

    @field_validator("scope", mode="before")
    @classmethod
    def _by_name(cls, value: object) -> object:
        names = {name: scope for scope, name in _NAMES.items()}
        known = names | OLD_NAMES
        if not isinstance(value, str) or value not in known:
            raise ValueError(f"no scope is called {value!r}; wanted {', '.join(names)}")
        return known[value]


class _File(BaseModel):
    model_config = ConfigDict(extra="forbid")

    key: list[ApiKey] = []


class ApiKeys:
    """Accepted API keys. Thread-safe. Without a file no key is required."""

    def __init__(self, file: Path | None) -> None:
        """Raises InvalidInput for a file that is unreadable, holds no key, or can be read by
        others."""
        self._file = file
        self.required = file is not None
        self._lock = threading.Lock()
        self._seen: _Stamp | None = None  # of the last successful read; None: no file
        self._failed = ""  # message of the last failed read; empty after a successful one
        self._by_hash: dict[str, ApiKey] = {}
        if file is not None:
            self._seen = _stamp(file)
            self._by_hash = _read(file)
            if not self._by_hash:
                raise InvalidInput(f"the file {file} holds no key; make one with helios key")

    def find(self, secret: str) -> ApiKey | None:
        """Entry of a key; None if unknown. Compares only hashes: timing does not reveal the key."""
        self._refresh()
        digest = hashlib.sha256(secret.encode("utf-8", "replace")).hexdigest()
        with self._lock:
            return self._by_hash.get(digest)

    def _refresh(self) -> None:
        if self._file is None:
            return
        try:
            stamp = _stamp(self._file)
            with self._lock:
                if stamp == self._seen:
                    self._failed = ""
                    return
            fresh = {} if stamp is None else _read(self._file)
        except InvalidInput as error:
            with self._lock:
                is_new, self._failed = error.message != self._failed, error.message
            if is_new:
                log.error("the keys of before stay valid: %s", error.message)
            return
        with self._lock:
            self._seen, self._by_hash, self._failed = stamp, fresh, ""
        if fresh:
            log.info("%d keys read anew", len(fresh))
        else:
            log.warning("%s holds no key any more: none is accepted", self._file)


def _stamp(file: Path) -> _Stamp | None:
    """State of the file; None if there is no file. Raises InvalidInput."""
    try:
        status = file.stat()
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise _unreadable(file, error) from error
    return status.st_mtime_ns, status.st_size, status.st_mode


def _read(file: Path) -> dict[str, ApiKey]:
    try:
        check_private(file)
        entries = _File.model_validate(tomllib.loads(file.read_text())).key
    except OSError as error:
        raise _unreadable(file, error) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InvalidInput(f"the keys in {file} are no TOML: {error}") from error
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise InvalidInput(
            f"the keys in {file} are wrong: {where}: {plain_error(first['msg'])}"
        ) from error
    return {entry.sha256: entry for entry in entries}


def _unreadable(file: Path, error: OSError) -> InvalidInput:
    return InvalidInput(
        f"the keys in {file} cannot be read ({error.strerror}); make some with helios key"
    )
