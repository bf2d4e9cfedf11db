"""`supervisor.json`: state of the services on disk, readable while the gateway is down.

{"ready": bool, "services": [{"name", "state", "reason", "restarts", "pid"}], "address": str,
 "router": str, "certs": str | null, "robot": str, "robots": [str],
 "supervisor_pid": int, "updated_s": float, "state_dir": str}
"""

from __future__ import annotations

import fcntl
import json
import os
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from helios_core.atomic_file import write_file

FILE_NAME = "supervisor.json"
LOCK_NAME = "supervisor.lock"
STALE_S = 15.0  # the supervisor writes at least every two seconds


def default_state_dir(port: int) -> Path:
    """Folder `$XDG_STATE_HOME/helios/<port>`, or under `~/.local/state`."""
    return _root() / str(port)


def running_ports() -> list[int]:
    """Ports of the stacks of this user that run on this machine."""
    try:
        found = [folder for folder in _root().iterdir() if folder.name.isdecimal()]
    except OSError:
        return []
    return sorted(int(folder.name) for folder in found if read(folder) is not None)


def _root() -> Path:
    base = os.environ.get("XDG_STATE_HOME", "")
    root = Path(base) if os.path.isabs(base) else Path.home() / ".local" / "state"
    return root / "helios"


class StateDirLocked(Exception):
    """Another supervisor has locked the directory."""


def lock(directory: Path) -> ExitStack:
    """Lock the directory until the result is closed or this process ends. Raises StateDirLocked,
    and OSError."""
    directory.mkdir(parents=True, exist_ok=True)
    held = ExitStack()
    file = held.enter_context((directory / LOCK_NAME).open("a"))
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        held.close()
        raise StateDirLocked(str(directory)) from None
    return held


def write(directories: Sequence[Path], status: dict[str, Any]) -> None:
    """Replace the file in each directory; a reader never sees a partial file."""
    text = json.dumps(status | {"supervisor_pid": os.getpid(), "updated_s": time.time()}, indent=1)
    for directory in directories:
        directory.mkdir(parents=True, exist_ok=True)
        write_file(directory / FILE_NAME, text, sync=False)  # short-lived: need not survive a crash


def read(directory: Path) -> dict[str, Any] | None:
    """Content of the file of a living supervisor; None if there is none."""
    try:
        status = json.loads((directory / FILE_NAME).read_text())
        fresh = time.time() - status["updated_s"] < STALE_S
        return status if fresh and _is_alive(status["supervisor_pid"]) else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def remove(directories: Sequence[Path]) -> None:
    """Remove the files at the end of the supervisor."""
    for directory in directories:
        (directory / FILE_NAME).unlink(missing_ok=True)


def _is_alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True
