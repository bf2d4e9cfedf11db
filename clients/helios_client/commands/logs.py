"""`helios logs`: logs of the services, also after `helios up` has ended."""

from __future__ import annotations

import contextlib
import os
import time
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from helios_core.errors import InvalidInput, Unavailable
from helios_core.name_rules import same_name
from helios_core.settings_spelling import SERVICES, nearest

from helios_client.commands.local_address import local_port_of_url
from helios_client.commands.shared_options import chosen_address
from helios_client.supervision import state_file
from helios_client.supervision.service_specs import TOGETHER
from helios_client.usage_errors import UsageError

FOLLOW_S = 0.2
ENDING = ".log"


def log_folder(port: int | None, url: str | None, state: Path | None) -> Path:
    """Folder `STATE/logs` of the `helios up` of this port: the running one, or the last one there.

    port, url: as typed; if neither is, HELIOS_URL applies. state: wins over both. Raises UsageError
    if a URL names another machine.
    """
    if state is None:
        here, address = chosen_address(port, url)
        if here is None:
            here = local_port_of_url(address, "its logs are there; run `helios logs` on HOST")
        state = state_file.default_state_dir(here)
    return _known_folder(state)


def _known_folder(default: Path) -> Path:
    known = state_file.read(default) or {}
    return Path(known.get("state_dir", default)) / "logs"


def services_in(folder: Path) -> list[str]:
    """Names of the services that have a log there. Raises Unavailable if there are none."""
    files = folder.rglob(f"*{ENDING}")  # those of one of several robots are in a folder
    names = sorted(str(path.relative_to(folder).with_suffix("")) for path in files)
    if not names:
        raise Unavailable(
            f"there are no logs in {folder}; give the --port or --state of a helios up"
        )
    return names


def log_file(folder: Path, service: str) -> Path:
    """Newest log of a service, whose name may be in any case. Raises UsageError with the known
    names for an unknown service, and Unavailable if there are no logs."""
    names = services_in(folder)
    found = same_name(service, names)
    if found is None and TOGETHER in names and same_name(service, SERVICES):
        found = TOGETHER  # of `helios up --compact`; its lines name the service
    if found is None:
        near = nearest(service, names)
        hint = f"; did you mean {near}?" if near else ""
        raise UsageError(
            f"there is no log of a service {service!r}; logs exist for {', '.join(names)}{hint}"
        )
    return folder / f"{found}{ENDING}"


def newest_lines(file: Path, count: int) -> tuple[list[str], BinaryIO]:
    """Newest `count` lines, oldest first, and the open file, read to its end. If the file has fewer
    lines, the previous log (`.log.1`) supplies the rest. Raises InvalidInput if a file cannot be
    read."""
    lines: deque[bytes] = deque(maxlen=count)
    try:
        with contextlib.suppress(FileNotFoundError), _older(file).open("rb") as older:
            lines.extend(older)
        opened = file.open("rb")
        lines.extend(opened)
    except OSError as error:
        raise InvalidInput(f"{error.filename} cannot be read: {error.strerror}") from error
    return [_text(line) for line in lines], opened


def new_lines(file: Path, opened: BinaryIO) -> Iterator[str]:
    """Yield each further line, without end. A log that is renamed is read to its end, then the new
    one from its beginning, as is one that was emptied."""
    half = b""
    while True:
        replaced = _is_replaced(file, opened)  # checked first, so that the read below is complete
        *lines, half = (half + opened.read()).split(b"\n")
        for line in lines:
            yield _text(line)
        if replaced:
            opened.close()
            opened = file.open("rb")
        elif opened.tell() > os.fstat(opened.fileno()).st_size:
            opened.seek(0)
            half = b""
        elif not lines:
            time.sleep(FOLLOW_S)


def _text(line: bytes) -> str:
    return line.decode(errors="replace").rstrip("\r\n")


def _older(file: Path) -> Path:
    return file.with_suffix(f"{ENDING}.1")


def _is_replaced(file: Path, opened: BinaryIO) -> bool:
    try:
        return not os.path.samestat(file.stat(), os.fstat(opened.fileno()))
    except FileNotFoundError:  # renamed, and the new file is not there yet
        return False
