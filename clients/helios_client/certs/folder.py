"""Folder of certificates: `ca.pem`, `ca.key`, `names.toml`, `router.json5`, `sessions/NAME.json5`.

`router.json5` and each session file are complete Zenoh configurations. They contain their
certificate and key, so that one file is all that a machine needs.
"""

from __future__ import annotations

import base64
import datetime as dt
import json
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from helios_core.access_control import access_control
from helios_core.atomic_file import write_file
from helios_core.errors import Conflict, InvalidInput
from helios_core.private_file import FILE_MODE, FOLDER_MODE, alone_in
from helios_core.router_link import ROUTER_FILE, SESSIONS, check_readable
from helios_core.zenoh_config import Credentials, client_values, router_values

from helios_client.certs.authority import (
    KeyPair,
    common_name,
    expiry,
    new_authority,
    new_client,
    new_router,
)
from helios_client.certs.names import ROUTER, Names, from_toml, to_toml
from helios_client.usage_errors import UsageError

AUTHORITY, AUTHORITY_KEY, NAMES = "ca.pem", "ca.key", "names.toml"
LOOPBACK = ("localhost", "127.0.0.1", "::1")  # `helios up` connects to the router by these
LISTEN = "tls/0.0.0.0"
WARN_DAYS = 30


@dataclass(frozen=True)
class Validity:
    """One certificate of a folder."""

    name: str
    file: Path
    until: dt.datetime  # UTC

    def days_left(self, now: dt.datetime) -> float:
        return (self.until - now) / dt.timedelta(days=1)


def create(folder: Path, names: Names, ca_days: int, now: dt.datetime) -> None:
    """Create the folder, complete or not at all, with an authority and all certificates.

    Raises Conflict if it exists and is not empty, InvalidInput if it cannot be written.
    """
    target = folder.resolve()
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        if target.exists() and not target.is_dir():
            raise Conflict(f"{folder} is a file; choose another folder")
        if target.exists() and any(target.iterdir()):
            raise Conflict(
                f"{folder} is not empty; choose another folder, or change the certificates there "
                "with helios certs add or renew"
            )
        draft = Path(tempfile.mkdtemp(prefix=f".{target.name}.", dir=target.parent))  # mode 0700
        try:
            authority = new_authority(ca_days, now)
            _write(draft / AUTHORITY_KEY, authority.key)
            _write(draft / AUTHORITY, authority.certificate, mode=0o644)
            _issue(draft, authority, names, None, now)
            draft.rename(target)  # fails if another process has filled it
        except BaseException:
            shutil.rmtree(draft, ignore_errors=True)
            raise
    except OSError as error:
        raise _unusable(folder, error) from error


def read_names(folder: Path) -> Names:
    """Names in the folder. Raises InvalidInput if it is none of `helios certs init`."""
    try:
        return from_toml((folder / NAMES).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise InvalidInput(
            f"{folder} has no readable {NAMES}; name the folder that helios certs init created"
        ) from error


def add(folder: Path, extend: Callable[[Names], Names], now: dt.datetime) -> tuple[str, ...]:
    """Issue the certificates by which `extend` extends the names; write the access rules anew.

    Returns the new names. Raises InvalidInput if the folder cannot be used, and what `extend`
    raises.
    """
    with _changing(folder):
        before = read_names(folder)
        names = extend(before)
        there = {c.name for c in before.certificates}
        new = tuple(c.name for c in names.certificates if c.name not in there)
        _issue(folder, _authority(folder, now), names, new, now)
    return new


def renew(
    folder: Path, which: Iterable[str], now: dt.datetime, change: Callable[[Names], Names]
) -> tuple[str, ...]:
    """Issue certificates with new keys under their old names; which: empty for all.

    change: of hosts or validity. Also writes the access rules anew. Returns the names. Raises
    UsageError for an unknown name, InvalidInput for a folder that cannot be used.
    """
    with _changing(folder):
        names = change(read_names(folder))
        known = (ROUTER, *(c.name for c in names.certificates))
        chosen = tuple(dict.fromkeys(which)) or known
        _check_known(chosen, known)
        _issue(folder, _authority(folder, now), names, chosen, now)
    return chosen


def remove(folder: Path, which: Iterable[str], now: dt.datetime) -> None:
    """Remove certificates and their rights. Copies have no rights once the router restarts.

    Raises UsageError for an unknown name, InvalidInput for a folder that cannot be used.
    """
    gone = set(which)
    with _changing(folder):
        names = read_names(folder)
        _check_known(gone, [c.name for c in names.certificates])
        kept = tuple(c for c in names.certificates if c.name not in gone)
        _issue(folder, _authority(folder, now), replace(names, certificates=kept), (), now)
        for name in gone:
            (folder / SESSIONS / f"{name}.json5").unlink(missing_ok=True)


def validities(folder: Path) -> list[Validity]:
    """All certificates in a folder, also in a copy of a part of it; the authority first.

    Raises InvalidInput for a damaged or unreadable file, and for a folder without certificates.
    """
    out: list[Validity] = []
    if (folder / AUTHORITY).is_file():
        pem = _read(folder / AUTHORITY)
        out.append(_validity(folder / AUTHORITY, pem))
    files = [folder / ROUTER_FILE] if (folder / ROUTER_FILE).is_file() else []
    files += sorted((folder / SESSIONS).glob("*.json5"))
    out += [_validity(file, credentials_of(file).certificate) for file in files]
    if not out:
        raise InvalidInput(f"{folder} has no certificates; helios certs init {folder} creates them")
    return out


def stale_rules(folder: Path) -> bool:
    """True if the router's access rules are not those of this version of HELIOS.

    Raises InvalidInput for a damaged folder. False in a copy without `names.toml`.
    """
    if not ((folder / NAMES).is_file() and (folder / ROUTER_FILE).is_file()):
        return False
    wanted = access_control(read_names(folder).identities)
    return _values(folder / ROUTER_FILE).get("access_control") != json.loads(json.dumps(wanted))


def credentials_of(file: Path) -> Credentials:
    """Certificates and key in a session file or the router's. Raises InvalidInput."""
    values = _values(file)
    try:
        tls = values["transport"]["link"]["tls"]
        kind = "listen" if "listen_certificate_base64" in tls else "connect"
        return Credentials(
            *(
                base64.b64decode(tls[field], validate=True)
                for field in (
                    "root_ca_certificate_base64",
                    f"{kind}_certificate_base64",
                    f"{kind}_private_key_base64",
                )
            )
        )
    except (KeyError, TypeError, ValueError) as error:
        raise InvalidInput(f"{file} has no certificate; helios certs renew writes it") from error


def _check_known(chosen: Iterable[str], known: Iterable[str]) -> None:
    if unknown := sorted(set(chosen) - set(known)):
        raise UsageError(
            f"no certificate is called {', '.join(unknown)}; helios certs show lists them"
        )


@contextmanager
def _changing(folder: Path) -> Iterator[None]:
    """Lock of the folder. Raises InvalidInput if that fails, or a file in it."""
    if not folder.is_dir():
        raise InvalidInput(f"there is no folder {folder}; helios certs init {folder} creates it")
    try:
        with alone_in(folder):
            yield
    except OSError as error:
        raise _unusable(folder, error) from error


def _issue(
    folder: Path,
    authority: KeyPair,
    names: Names,
    which: tuple[str, ...] | None,
    now: dt.datetime,
) -> None:
    """Write the chosen certificates (None: all), the router's file and the list of names.

    Raises InvalidInput for damaged files of the authority, OSError.
    """
    (folder / SESSIONS).mkdir(FOLDER_MODE, exist_ok=True)
    try:
        for entry in names.certificates:
            if which is None or entry.name in which:
                own = _credentials(authority, new_client(authority, entry.name, names.days, now))
                file = folder / SESSIONS / f"{entry.name}.json5"
                _write(file, _json(client_values(names.endpoints, own)))
        if which is None or ROUTER in which:
            hosts = tuple(dict.fromkeys((*names.hosts, *LOOPBACK)))
            router = _credentials(authority, new_router(authority, ROUTER, hosts, names.days, now))
        else:
            router = credentials_of(folder / ROUTER_FILE)
    except (ValueError, TypeError) as error:
        raise InvalidInput(
            f"the authority in {folder} cannot be used ({error}); restore {AUTHORITY} and "
            f"{AUTHORITY_KEY}, or start again with helios certs init"
        ) from error
    rules = access_control(names.identities)
    _write(folder / ROUTER_FILE, _json(router_values([f"{LISTEN}:{names.port}"], router, rules)))
    _write(folder / NAMES, to_toml(names).encode())


def _authority(folder: Path, now: dt.datetime) -> KeyPair:
    """Raises InvalidInput without its key, if others may read that, or after its end."""
    key = folder / AUTHORITY_KEY
    if not key.is_file():
        raise InvalidInput(
            f"{folder} has no {AUTHORITY_KEY}; run this on the machine of helios certs init, and "
            "copy the new files"
        )
    check_readable(key)
    out = KeyPair(_read(folder / AUTHORITY), key.read_bytes())
    if _validity(folder / AUTHORITY, out.certificate).until <= now:
        raise InvalidInput(
            f"the authority in {folder} has expired; start again in a new folder: helios certs init"
        )
    return out


def _credentials(authority: KeyPair, own: KeyPair) -> Credentials:
    return Credentials(authority.certificate, own.certificate, own.key)


def _validity(file: Path, pem: bytes) -> Validity:
    try:
        return Validity(common_name(pem), file, expiry(pem))
    except ValueError as error:
        raise InvalidInput(f"{file} has a damaged certificate: {error}") from error


def _values(file: Path) -> dict[str, Any]:
    check_readable(file)
    try:
        out = json.loads(_read(file))
    except (ValueError, RecursionError) as error:
        raise InvalidInput(
            f"{file} is damaged ({error}); write it again: helios certs renew"
        ) from error
    if not isinstance(out, dict):
        raise InvalidInput(f"{file} is no configuration; write it again: helios certs renew")
    return out


def _read(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except OSError as error:
        raise InvalidInput(f"{file} cannot be read: {error.strerror}") from error


def _write(file: Path, data: bytes, mode: int = FILE_MODE) -> None:
    write_file(file, data, mode=mode)


def _json(values: dict[str, Any]) -> bytes:
    return json.dumps(values, indent=1).encode() + b"\n"


def _unusable(folder: Path, error: OSError) -> InvalidInput:
    return InvalidInput(f"{folder} cannot be used: {error.strerror}; choose another folder")
