"""Writer of `results.json`: means with standard errors, by agent and limit of picks.

An episode with more than N picks scores 0 in every score of the row for N picks; collisions, steps
and seconds stay unchanged. So one run without a limit gives the rows for every limit.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from helios_core.atomic_file import write_file
from helios_core.errors import InvalidInput
from numpy.typing import NDArray

from helios_eval.episodes.episode_record import EpisodeRecord
from helios_eval.report import absent_targets
from helios_eval.report.interval_statistics import mean_sem
from helios_eval.report.record_metrics import NAMES, values

RESULTS = "results.json"
UNLIMITED = "unlimited"

Picks = int | str  # a limit, or UNLIMITED


def picks_of(text: str) -> Picks:
    """Limit from "5" or "unlimited". Raises InvalidInput."""
    if text == UNLIMITED:
        return UNLIMITED
    if text.isdecimal() and int(text) > 0:
        return int(text)
    raise InvalidInput(f"picks are {text!r}; wanted a number above 0, or {UNLIMITED}")


def picks_in(run: Mapping[str, Any]) -> list[Picks]:
    """Limits in `run.json`; "unlimited" alone if it has none."""
    return [picks_of(str(p)) for p in run.get("picks") or [UNLIMITED]]


def rows(records: Iterable[EpisodeRecord], picks: Sequence[Picks]) -> list[dict[str, Any]]:
    """Entries of `results.json`, one per arm and limit of picks.

    An arm is a benchmark, agent, semantics, preset, noise and settings. Object navigation picks
    nothing and has one row.
    """
    groups: dict[str, list[EpisodeRecord]] = {}
    for record in records:
        groups.setdefault(_group(record), []).append(record)
    out = []
    for group in groups.values():
        first = group[0]
        limits = picks if first.benchmark == "ovmm" else [UNLIMITED]
        for limit in limits:
            out.append(
                {
                    "benchmark": first.benchmark,
                    "agent": first.agent,
                    "picks": limit,
                    "semantics": first.semantics,
                    "preset": first.preset,
                    "noise": first.noise.model_dump() if first.noise else None,
                    "settings": first.settings,
                    "metrics": metrics(group, limit),
                }
            )
    return out


def metrics(records: Sequence[EpisodeRecord], picks: Picks) -> dict[str, dict[str, float | None]]:
    """Metric name -> mean, its standard error (None for a single episode), number of episodes.

    All records are of one benchmark. The mean is None where n is 0: a metric of present objects, if
    every object is absent. Records with an absent object add the rates of `absent_targets.rates`.
    """
    limit = None if picks == UNLIMITED else int(picks)
    samples = {name: values(records, name, limit) for name in NAMES[records[0].benchmark]}
    samples |= absent_targets.rates(records, limit)
    return {name: _summary(sample) for name, sample in samples.items()}


def write(folder: Path, records: Iterable[EpisodeRecord], picks: Sequence[Picks]) -> None:
    """Write `results.json` atomically."""
    write_file(folder / RESULTS, json.dumps(rows(records, picks), indent=1) + "\n")


def _group(record: EpisodeRecord) -> str:
    """Key of the record without its seed."""
    return record.model_copy(update={"seed": 0}).key


def _summary(found: NDArray[np.float64]) -> dict[str, float | None]:
    if not len(found):
        return {"mean": None, "sem": None, "n": 0}
    of = mean_sem(found)
    return {"mean": of.mean, "sem": None if math.isnan(of.sem) else of.sem, "n": of.n}
