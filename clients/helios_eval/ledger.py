"""Ledger of the homes that were played: which, by whom, when, at which commit, and why.

Seeds below 1000 are for development. A figure counts as unseen only if nobody had played its homes
before. So `helios eval` appends a line to `docs/results/ledger.jsonl` before it plays any home from
seed 1000 on, also if the run is stopped later. An installation outside a source checkout has no
ledger.
"""

from __future__ import annotations

import getpass
import json
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from helios_core.errors import InvalidInput, Unavailable
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from helios_eval.episodes.episode_record import append_line
from helios_eval.episodes.episode_spec import EpisodeSpec
from helios_eval.provenance import LEDGER, checkout

FIRST_SEED = 1000  # seeds below are for development
AFTERWARDS = "entered afterwards"  # `by` of runs that are older than the ledger


class Entry(BaseModel):
    """One line of the ledger: the homes that one command was about to play."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    at: str = Field(
        description="time of the start, ISO 8601, UTC, to the second; of a line that was entered "
        "afterwards, the time of the commit"
    )
    by: str = Field(description="account that ran the command, or `AFTERWARDS`")
    commit: str
    why: str = Field(description="reason that the command gave; empty: none")
    benchmark: str
    preset: str
    first_seed: int
    last_seed: int
    homes: int = Field(description="homes of this range that the command was about to play")
    agents: tuple[str, ...]
    out: str = Field(description="folder of the results")
    semantics: str | None = Field(default=None, description="None in lines that lack it")
    noise: dict[str, Any] | None = Field(
        default=None, description="noise of the detector; None also in lines that lack it"
    )
    settings: dict[str, Any] | None = Field(
        default=None, description="what differs from the defaults; None in lines that lack it"
    )


def ledger_path() -> Path | None:
    """File of the ledger; None outside a source checkout."""
    root = checkout()
    return None if root is None else root / LEDGER


def enter(specs: Sequence[EpisodeSpec], out: Path, commit: str, why: str) -> Entry | None:
    """Append a line for the specified episodes; None without a home from seed 1000 on.

    Raises Unavailable if the file cannot be written, so that no such home is played unrecorded.
    """
    kept = [spec for spec in specs if spec.seed >= FIRST_SEED]
    path = ledger_path()
    if not kept or path is None:
        return None
    seeds, noise = {spec.seed for spec in kept}, kept[0].noise
    entry = Entry(
        at=datetime.now(UTC).isoformat(timespec="seconds"), by=_account(), commit=commit, why=why,
        benchmark=kept[0].benchmark, preset=kept[0].preset, first_seed=min(seeds),
        last_seed=max(seeds), homes=len(seeds),
        agents=tuple(dict.fromkeys(spec.agent for spec in kept)), out=str(out),
        semantics=kept[0].semantics, noise=noise.model_dump() if noise else None,
        settings=dict(sorted(item for spec in kept for item in spec.settings.items())),
    )  # fmt: skip
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        append_line(path, entry.model_dump_json())
    except OSError as error:
        raise Unavailable(
            f"the ledger {path} cannot be written ({error}), and homes from seed {FIRST_SEED} on "
            "are not played without it; free the disk or make the file writable"
        ) from error
    return entry


def read(path: Path) -> list[Entry]:
    """Lines of a ledger, in the order of the file; none if the file is missing.

    Raises InvalidInput for a damaged line, and Unavailable if the file cannot be read.
    """
    if not path.exists():
        return []
    try:
        lines = path.read_bytes().splitlines()
    except OSError as error:
        raise Unavailable(
            f"the ledger {path} cannot be read ({error}); make the file readable"
        ) from error
    entries = []
    for number, line in enumerate(lines, 1):
        try:
            fields: dict[str, Any] = json.loads(line)
            entries.append(Entry.model_validate(fields))
        except (ValueError, ValidationError) as error:
            raise InvalidInput(
                f"{path}, line {number} is no entry of the ledger ({error}); restore the file "
                "from the repository"
            ) from error
    return entries


def _account() -> str:
    try:
        return getpass.getuser()
    except (OSError, KeyError):  # an account without a name, as in some containers
        return "unknown"
