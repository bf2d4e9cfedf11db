"""A plan file as a source of homes: its path, its level, and the digest of its content."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

from helios_core.errors import InvalidInput

from helios_sim.plans.household_file import path_beside

_DIGITS = 12
MARK = "@"  # between name and digest in the name of a kind of homes; no preset has it


@dataclass(frozen=True)
class PlanSource:
    """One level of a plan file. `sha256` is that of the file, `things_sha256` of the file beside
    it, empty without one; both are checked when the home is built."""

    path: Path
    sha256: str
    level: str = ""
    things_sha256: str = ""

    @classmethod
    def of(cls, path: Path, level: str = "") -> PlanSource:
        """Source of a file as it is now. Raises InvalidInput if it cannot be read."""
        if path.is_dir() or not path.is_file():
            what = "is a folder" if path.is_dir() else "does not exist"
            raise InvalidInput(f"{path} {what}; name a .sh3d file")
        beside = path_beside(path)
        return cls(
            path.resolve(),
            file_sha256(path),
            level,
            file_sha256(beside) if beside.is_file() else "",
        )

    @property
    def digest(self) -> str:
        """SHA-256 of everything that determines the homes of this source."""
        if not self.level and not self.things_sha256:
            return self.sha256
        text = "\n".join((self.sha256, self.level, self.things_sha256))
        return hashlib.sha256(text.encode()).hexdigest()

    @property
    def kind(self) -> str:
        """Name of these homes where presets have theirs: flat.sh3d@1a2b3c4d5e6f."""
        return f"{self.path.name}{MARK}{self.digest[:_DIGITS]}"


def file_sha256(path: Path) -> str:
    """SHA-256 of a file. Raises InvalidInput if it cannot be read."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise InvalidInput(f"{path} cannot be read ({error.strerror or error})") from error
