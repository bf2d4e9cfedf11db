"""Homes of plan files for a run: one .sh3d file, or the files of a folder in turn.

The seed of an episode selects its file (seed modulo the number of files, in the order of their
names), the household things in it and the task. The name of the kind carries a digest of all files,
so results of different plans never mix.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

from helios_client.usage_errors import UsageError
from helios_core.errors import HeliosError
from helios_sim.home import Home
from helios_sim.plans import PlanSource, drawn_home, home_of_plan
from helios_sim.plans.plan_source import MARK

SUFFIX = ".sh3d"
_DIGITS = 12


@dataclass(frozen=True)
class PlanHomes:
    """Plan files of a run, at least one. `kind` stands where a preset has its name."""

    kind: str
    sources: tuple[PlanSource, ...]

    @property
    def digest(self) -> str:
        """Digest of everything that determines the homes."""
        if len(self.sources) == 1:
            return self.sources[0].digest
        text = "\n".join(f"{s.path.name} {s.digest}" for s in self.sources)
        return hashlib.sha256(text.encode()).hexdigest()

    def source_of(self, seed: int) -> PlanSource:
        """Plan of a seed."""
        return self.sources[seed % len(self.sources)]

    def home_of(self, seed: int) -> Home:
        """Home of a seed. Raises InvalidInput if its file has changed."""
        return home_of_plan(self.source_of(seed), seed)

    def label_of(self, seed: int) -> str:
        """File of a seed as a record names it: name, SHA-256, and the level if one is named."""
        source = self.source_of(seed)
        level = f" level:{source.level}" if source.level else ""
        things = f" things:{source.things_sha256}" if source.things_sha256 else ""
        return f"{source.path.name} sha256:{source.sha256}{level}{things}"


def level_in(label: str) -> str:
    """Level that a label of `PlanHomes.label_of` names; "" if it names none."""
    _, _, rest = label.partition(" level:")
    return rest.partition(" things:")[0]


def is_plan_kind(kind: str) -> bool:
    """True for the name of homes of plans, such as flat.sh3d@1a2b3c4d5e6f."""
    return MARK in kind


def plan_homes(path: Path, level: str = "") -> PlanHomes:
    """Homes of a plan file or a folder of them, after a check that each can be used.

    level: the level to take, instead of the one with the most rooms. Raises UsageError.
    """
    try:
        if not path.is_dir():
            sources = (PlanSource.of(path, level),)
        else:
            files = sorted(p for p in path.iterdir() if p.suffix.lower() == SUFFIX)
            if not files:
                raise UsageError(f"--homes {path}: the folder holds no {SUFFIX} file; add some")
            sources = tuple(PlanSource.of(p, level) for p in files)
        for source in sources:
            drawn_home(source)
    except HeliosError as error:
        raise UsageError(f"--homes: {error.message}") from error
    except OSError as error:
        raise UsageError(f"--homes {path} cannot be read ({error.strerror or error})") from error
    homes = PlanHomes("", sources)
    name = path.resolve().name if path.is_dir() else sources[0].path.name
    return PlanHomes(f"{name}{MARK}{homes.digest[:_DIGITS]}", sources)
