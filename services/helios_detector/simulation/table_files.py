"""Files of tables of the simulated detector and scorer: TOML, shipped or given by path.

A file may name another table as its `base`. It then needs only the entries that differ: sections
are joined entry by entry, at every depth, and any other value replaces the base's. Lists are
replaced whole. A base may have a base.
"""

from __future__ import annotations

import hashlib
import os
import tomllib
from dataclasses import dataclass
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from helios_core.errors import InvalidInput


@dataclass(frozen=True)
class Tables:
    """Tables of one kind. kind: as messages name it; folder: of those that are shipped."""

    kind: str
    folder: str

    def shipped(self, name: str) -> Traversable:
        """File of a shipped table, whether or not it exists."""
        return resources.files("helios_detector").joinpath(self.folder, f"{name}.toml")


NOISE = Tables("noise table", "noise_tables")
SCORERS = Tables("scorer table", "scorer_tables")


def shipped_tables(tables: Tables = NOISE) -> list[str]:
    """Sorted names of the shipped tables."""
    folder = resources.files("helios_detector").joinpath(tables.folder)
    names = [file.name for file in folder.iterdir()]
    return sorted(name.removesuffix(".toml") for name in names if name.endswith(".toml"))


def read_table(name_or_path: str, tables: Tables = NOISE) -> tuple[dict[str, Any], str]:
    """(entries with those of the bases, digest of all files) of a table.

    The digest is 16 hexadecimal digits. Raises InvalidInput for a file or base that is missing or
    is no TOML, and for a table that is based on itself.
    """
    return _read(name_or_path, Path(), (), tables)


def _read(
    said: str, folder: Path, above: tuple[str, ...], tables: Tables
) -> tuple[dict[str, Any], str]:
    """Read a table; `above`: the tables that are based on it, from the one asked for.

    folder: of the file that names the table; `said` may be a path from there.
    """
    shipped = tables.shipped(said)
    path = folder / said
    name = said if shipped.is_file() else os.path.abspath(path)
    if name in above:
        raise InvalidInput(
            f"the {tables.kind} {above[0]!r} is based on itself ({' > '.join((*above, name))}); "
            "the entry base must name another table; remove it from one of these files"
        )
    try:
        data = shipped.read_bytes() if shipped.is_file() else path.read_bytes()
    except (OSError, ValueError) as error:  # ValueError: no possible path
        raise InvalidInput(_missing(said, name, above, tables)) from error
    try:
        table = tomllib.loads(data.decode())
    except ValueError as error:
        raise InvalidInput(
            f"the {tables.kind} {name!r} is no TOML ({type(error).__name__}: {error}); correct the "
            "file, or start from a shipped one"
        ) from error
    digest = hashlib.sha256(data)
    if "base" in table:
        base = table.pop("base")
        if not isinstance(base, str):
            raise InvalidInput(
                f"base in the {tables.kind} {name!r} is {base!r}; wanted the name of a table in "
                f"quotes ({', '.join(shipped_tables(tables))}), or of a file in the same folder"
            )
        under, under_digest = _read(base, path.parent, (*above, name), tables)
        table = joined(under, table)
        digest.update(under_digest.encode())
    return table, digest.hexdigest()[:16]


def joined(base: dict[str, Any], own: dict[str, Any]) -> dict[str, Any]:
    """The entries of `base`, overridden by `own`; sections are joined entry by entry."""
    out = dict(base)
    for key, value in own.items():
        under = base.get(key)
        if isinstance(value, dict) and isinstance(under, dict):
            value = joined(under, value)
        out[key] = value
    return out


def _missing(said: str, name: str, above: tuple[str, ...], tables: Tables) -> str:
    names = ", ".join(shipped_tables(tables))
    if above:
        return (
            f"the {tables.kind} {above[-1]!r} has the base {said!r}, which is neither shipped nor "
            f"a file ({name}); name one that is shipped ({names}) or a file in the same folder"
        )
    return f"there is no {tables.kind} {said!r}; name one that is shipped ({names}) or give a file"
