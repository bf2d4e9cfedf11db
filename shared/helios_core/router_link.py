"""How a client reaches the router of the bus: an endpoint, and the client's certificate."""

from __future__ import annotations

import errno
import json
import os
from dataclasses import dataclass
from pathlib import Path

from helios_core.errors import InvalidInput
from helios_core.private_file import check_private

DEFAULT_ROUTER = "tcp/127.0.0.1:7447"
SESSIONS = "sessions"  # folder of the session files, in a folder of `helios certs`
ROUTER_FILE = "router.json5"
TLS = "tls/"


@dataclass(frozen=True)
class RouterLink:
    """Connection of one client to its router."""

    endpoint: str = ""  # such as tcp/127.0.0.1:7447; empty: those in the session file
    session: Path | None = None  # Zenoh session file with the client's certificate and key

    def __str__(self) -> str:
        return self.endpoint or f"the addresses in {self.session}"


def router_link(endpoint: str, certs: Path | None, service: str, robot: str) -> RouterLink:
    """Link of a service of a robot.

    endpoint: empty for those in the session file. certs: folder of `helios certs`, or the session
    file itself; None: without certificates. Raises InvalidInput if there is no session file for the
    service, if others may read it, or if the endpoint is not encrypted.
    """
    if certs is None:
        return RouterLink(endpoint)
    if endpoint and not endpoint.startswith(TLS):
        raise InvalidInput(
            f"the router {endpoint} takes no certificates; with --certs name one as {TLS}HOST:PORT"
        )
    session = certs if certs.is_file() else session_file(certs, service, robot)
    check_readable(session)
    return RouterLink(endpoint, session)


def session_file(certs: Path, service: str, robot: str) -> Path:
    """Session file of a service of a robot: its own, or else the only one of that service.

    Raises InvalidInput if there is none, or several of other robots.
    """
    own = certs / SESSIONS / f"{service}.{robot}.json5"
    if own.is_file():
        return own
    others = sorted((certs / SESSIONS).glob(f"{service}.*.json5"))
    if len(others) == 1:
        return others[0]
    if others:
        raise InvalidInput(
            f"{own} does not exist; name the right one of its neighbours with --certs FILE: "
            + ", ".join(file.name for file in others)
        )
    how = "init DIR"
    if certs.is_dir():
        how = "add DIR --simulation" if service == "world" else f"add DIR --robots {robot}"
    raise InvalidInput(
        f"{own} does not exist; create it on the machine that has ca.key (helios certs {how}), "
        "and copy it here"
    )


def listen_port(certs: Path) -> int:
    """Port on which the router of a folder of `helios certs` listens. Raises InvalidInput."""
    file = certs / ROUTER_FILE
    check_readable(file)
    try:
        [endpoint] = json.loads(file.read_bytes())["listen"]["endpoints"]
        return int(endpoint.rpartition(":")[2])
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise InvalidInput(f"{file} is damaged ({error}); see helios certs renew") from error


def check_readable(file: Path) -> None:
    """Raise InvalidInput if a file with a private key cannot be read, or can be by others."""
    try:
        check_private(file)
        if not os.access(file, os.R_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    except OSError as error:
        raise InvalidInput(
            f"{file} cannot be read ({error.strerror}); helios certs creates it"
        ) from error
