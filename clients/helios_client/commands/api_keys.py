"""API keys of the gateway: generated here, stored as hashes in a TOML file that only its owner
reads."""

from __future__ import annotations

import hashlib
import json
import secrets
import tomllib
from pathlib import Path

from helios_core.atomic_file import unwritable_reason, write_file
from helios_core.errors import Conflict, InvalidInput
from helios_core.private_file import FILE_MODE, alone_in

from helios_client.usage_errors import UsageError

BYTES = 32


def add_key(file: Path, name: str, scope: str) -> str:
    """Generate a key and add its hash to the file, from which the key cannot be recovered.

    Raises UsageError for an unprintable name or a missing folder, Conflict if the file has a key of
    that name, InvalidInput if the file cannot be used.
    """
    if not (name.strip() and name.isprintable()):
        raise UsageError(f"the name of a key is {name!r}; wanted printable text, such as tablet")
    key = secrets.token_urlsafe(BYTES)
    digest = hashlib.sha256(key.encode()).hexdigest()
    quoted = json.dumps(name, ensure_ascii=False)  # such a JSON string is also a TOML string
    entry = f'[[key]]\nname = {quoted}\nscope = "{scope}"\nsha256 = "{digest}"\n'
    if why := unwritable_reason(file):
        raise UsageError(why)
    try:
        with alone_in(file.parent):
            _add(file, name, entry)
    except OSError as error:
        raise InvalidInput(f"{file} cannot be written: {error.strerror}") from error
    return key


def _add(file: Path, name: str, entry: str) -> None:
    """Add the entry to the file. Raises as `add_key`, and OSError if the file cannot be written; it
    is then unchanged."""
    try:
        text = file.read_text(encoding="utf-8") if file.exists() else ""
        names = [entry.get("name") for entry in tomllib.loads(text).get("key", [])]
        added = ("\n" if text else "") + entry
        tomllib.loads(text + added)  # fails for `key = []`, which takes no more entries
    except (OSError, ValueError, AttributeError, TypeError) as error:
        raise InvalidInput(
            f"{file} is not a valid key file: {error}; correct it, or name another with --file"
        ) from error
    if name in names:
        raise Conflict(f"{file} already has a key {name!r}; remove it, or choose another name")
    write_file(file, text + added, mode=FILE_MODE)
