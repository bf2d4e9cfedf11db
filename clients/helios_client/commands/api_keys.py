"""API keys of the gateway: generated here, stored as hashes in a TOML file that only its owner
reads."""

from __future__ import annotations

import hashlib
import json
import re
import secrets
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from helios_core.atomic_file import unwritable_reason, write_file
from helios_core.errors import Conflict, InvalidInput
from helios_core.private_file import FILE_MODE, alone_in

from helios_client.usage_errors import UsageError

BYTES = 32
HASH = re.compile(r"[0-9a-f]{64}")
SCOPES = ("read", "task", "robot", "admin")
OLD_SCOPE = "operate"  # in earlier versions; files may still have it


def checked_scope(scope: str) -> str:
    """The scope itself. Raises UsageError for another word."""
    if scope in SCOPES:
        return scope
    if scope == OLD_SCOPE:
        raise UsageError(
            "the scope operate has two parts now: --scope task gives tasks, --scope robot also "
            "drives by hand, sends frames and clears a stop"
        )
    raise UsageError(f"no scope is called {scope!r}; wanted {', '.join(SCOPES)}")


def add_key(file: Path, name: str, scope: str) -> str:
    """Generate a key and add its hash to the file, from which the key cannot be recovered.

    Raises UsageError for an unprintable name or a missing folder, Conflict if the file has a key of
    that name, InvalidInput if the file cannot be used.
    """
    if not (name.strip() and name.isprintable()):
        raise UsageError(f"the name of a key is {name!r}; wanted printable text, such as tablet")
    key, digest = _new_key()
    quoted = json.dumps(name, ensure_ascii=False)  # such a JSON string is also a TOML string
    entry = f'[[key]]\nname = {quoted}\nscope = "{scope}"\nsha256 = "{digest}"\n'

    def added(text: str, entries: list[dict[str, Any]]) -> str:
        if name in [entry.get("name") for entry in entries]:
            raise Conflict(
                f"{file} already has a key {name!r}; use --replace or --remove, or choose another "
                "name"
            )
        return text + ("\n" if text else "") + entry

    _change(file, added)
    return key


def replace_key(file: Path, name: str) -> str:
    """Generate a new key for a name in the file; the old one is not accepted any more.

    Raises UsageError without such a name, InvalidInput if the file cannot be used.
    """
    key, digest = _new_key()

    def replaced(text: str, entries: list[dict[str, Any]]) -> str:
        out = text.replace(_hash(file, name, entries), digest)
        wanted = [e | {"sha256": digest} if e.get("name") == name else e for e in entries]
        if tomllib.loads(out).get("key", []) != wanted:
            raise ValueError(f"another entry has the name or the sha256 of {name!r}")
        return out

    _change(file, replaced)
    return key


def remove_key(file: Path, name: str) -> None:
    """Remove the key of a name. Raises as `replace_key`."""

    def removed(text: str, entries: list[dict[str, Any]]) -> str:
        at = text.index(_hash(file, name, entries))
        tables = [found.start() for found in re.finditer(r"^\s*\[\[", text, re.MULTILINE)]
        start = max((place for place in tables if place < at), default=0)
        end = min((place for place in tables if place > at), default=len(text))
        before, after = text[:start].rstrip("\n"), text[end:].lstrip("\n")
        out = f"{before}\n\n{after}" if before and after else after or (before and f"{before}\n")
        wanted = [entry for entry in entries if entry.get("name") != name]
        if tomllib.loads(out).get("key", []) != wanted:
            raise ValueError(f"the entry of {name!r} is not a block of its own")
        return out

    _change(file, removed)


def _new_key() -> tuple[str, str]:
    """A new key and its hash."""
    key = secrets.token_urlsafe(BYTES)
    return key, hashlib.sha256(key.encode()).hexdigest()


def _hash(file: Path, name: str, entries: list[dict[str, Any]]) -> str:
    """Hash of the key of a name. Raises UsageError without such a key, InvalidInput if its entry
    has no hash."""
    found = [entry.get("sha256") for entry in entries if entry.get("name") == name]
    if not found:
        names = ", ".join(str(entry.get("name")) for entry in entries) or "none"
        raise UsageError(f"{file} has no key {name!r}; it has: {names}")
    if not (isinstance(found[0], str) and HASH.fullmatch(found[0])):
        came = "no sha256" if found[0] is None else f"the sha256 {str(found[0])[:80]!r}"
        raise InvalidInput(
            f"the key {name!r} in {file} has {came}; wanted 64 digits 0-9 and a-f; remove its "
            "[[key]] entry with an editor, then add the key anew with helios key"
        )
    return found[0]


def _change(file: Path, change: Callable[[str, list[dict[str, Any]]], str]) -> None:
    """Replace the file's text by `change(text, entries)`, under a lock; a failure leaves it
    unchanged. Raises UsageError, InvalidInput, and what `change` raises."""
    if why := unwritable_reason(file):
        raise UsageError(why)
    try:
        with alone_in(file.parent):
            write_file(file, _changed(file, change), mode=FILE_MODE)
    except OSError as error:
        raise InvalidInput(f"{file} cannot be written: {error.strerror}") from error


def _changed(file: Path, change: Callable[[str, list[dict[str, Any]]], str]) -> str:
    try:
        text = file.read_text(encoding="utf-8") if file.exists() else ""
        entries = tomllib.loads(text).get("key", [])
        for entry in entries:
            entry.get("name")  # an entry that is no table raises
        out = change(text, entries)
        tomllib.loads(out)  # fails for `key = []`, which takes no more entries
    except (OSError, ValueError, AttributeError, TypeError) as error:
        raise InvalidInput(
            f"{file} is not a valid key file: {error}; correct it, or name another with --file"
        ) from error
    return out
