"""Comparison of two runs of `helios bench`: which rows got slower by more than noise."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from helios_core.errors import InvalidInput

from helios_eval.bench.timing import deviation

DEVIATIONS = 3.0  # standard deviations of the difference that count as noise
SIGMA = 1.4826  # standard deviation of normal noise with a median absolute deviation of 1
LEAST_RUNS = 3  # of which the spread tells how much two runs of one version differ
OF_MEDIAN = 1.2533  # standard error of a median over that of a mean, for normal noise
LEAST = 0.1  # smaller relative changes never count: two runs on one machine differ this much
UNKNOWN = 0.2  # the same for a row without spreads, as older files have


@dataclass(frozen=True)
class Change:
    """Ratio of a row before and now."""

    name: str
    size: str
    before: float
    now: float
    noise: float  # largest fall of the ratio that is not significant

    @property
    def slower(self) -> bool:
        return self.before - self.now > self.noise

    @property
    def sentence(self) -> str:
        """What changed, for people."""
        return (
            f"{self.name} ({self.size}): ratio {self.before:.2f} before, {self.now:.2f} now; "
            f"noise is {self.noise:.2f}"
        )


def changes(
    before: Iterable[Mapping[str, Any]], now: Iterable[Mapping[str, Any]]
) -> tuple[list[Change], list[str]]:
    """(changes of the rows that both runs have, names of rows that only one has).

    Ratios are compared, since times depend on the machine and its load. Rows of one name are
    matched by their order.
    """
    old, new = _by_place(before), _by_place(now)
    both = [_change(old[key], new[key]) for key in new if key in old]
    return both, sorted({name for name, _ in old.keys() ^ new.keys()})


def read_run(path: Path) -> tuple[str, list[dict[str, Any]]]:
    """Machine and rows of a file of `helios bench --json`. Raises InvalidInput for any other."""
    try:
        document = json.loads(path.read_text())
        rows, machine = document["rows"], str(document.get("machine", ""))
        for row in rows:
            if not (isinstance(row["name"], str) and float(row["ratio"]) > 0):
                raise ValueError(f"a row has the ratio {row['ratio']!r}")
            float(row.get("ratio_spread", 0))
            int(row.get("repeats", 1))
            [float(ratio) for ratio in row.get("ratios", ())]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InvalidInput(
            f"{path} is no result of helios bench ({type(error).__name__}: {error}); give a file "
            "that `helios bench --json FILE` wrote"
        ) from error
    return machine, rows


def _by_place(rows: Iterable[Mapping[str, Any]]) -> dict[tuple[str, int], Mapping[str, Any]]:
    seen: Counter[str] = Counter()
    out = {}
    for row in rows:
        out[row["name"], seen[row["name"]]] = row
        seen[row["name"]] += 1
    return out


def _change(old: Mapping[str, Any], new: Mapping[str, Any]) -> Change:
    before, now = float(old["ratio"]), float(new["ratio"])
    known = "ratio_spread" in old and "ratio_spread" in new
    error = math.hypot(_error(old), _error(new)) if known else 0.0
    noise = max(DEVIATIONS * error, (LEAST if known else UNKNOWN) * before)
    return Change(new["name"], new.get("size", ""), before, now, noise)


def _error(row: Mapping[str, Any]) -> float:
    """Standard error of the ratio of a row: by its repeats within a run, or by its runs, whichever
    is larger."""
    within = _of_median(float(row["ratio_spread"]), max(int(row.get("repeats", 1)), 1))
    ratios = [float(ratio) for ratio in row.get("ratios", ())]
    if len(ratios) < LEAST_RUNS:
        return within
    return max(within, _of_median(deviation(ratios), len(ratios)))


def _of_median(spread: float, count: int) -> float:
    """Standard error of the median of values with this median absolute deviation."""
    return SIGMA * spread * (1.0 if count == 1 else OF_MEDIAN / math.sqrt(count))
