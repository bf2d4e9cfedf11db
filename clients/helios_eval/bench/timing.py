"""Median times of two workloads, measured alternately so that machine drift affects both alike."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Row:
    """One line of the benchmark. `ratio` is peer_ms / ours_ms, the speed-up of our code.

    The spreads are median absolute deviations: of the repeats, and of the ratios of the pairs that
    ran one after the other.
    """

    name: str
    size: str
    ours_ms: float
    peer: str
    peer_ms: float
    repeats: int
    ours_spread_ms: float
    peer_spread_ms: float
    ratio_spread: float

    @property
    def ratio(self) -> float:
        return self.peer_ms / self.ours_ms

    def as_dict(self) -> dict[str, object]:
        return {
            "name": self.name,
            "size": self.size,
            "ours_ms": round(self.ours_ms, 4),
            "peer": self.peer,
            "peer_ms": round(self.peer_ms, 4),
            "ratio": round(self.ratio, 3),
            "repeats": self.repeats,
            "ours_spread_ms": round(self.ours_spread_ms, 4),
            "peer_spread_ms": round(self.peer_spread_ms, 4),
            "ratio_spread": round(self.ratio_spread, 3),
        }


def compare(
    name: str,
    size: str,
    ours: Callable[[int], object],
    peer_name: str,
    peer: Callable[[int], object],
    runs: int = 15,
) -> Row:
    """Median times of `ours(i)` and `peer(i)` over `runs` after one warm-up of each."""
    ours(0)
    peer(0)
    times: dict[int, list[float]] = {0: [], 1: []}
    for i in range(1, runs + 1):
        for which, work in enumerate((ours, peer)):
            began = time.perf_counter()
            work(i)
            times[which].append((time.perf_counter() - began) * 1e3)
    ratios = [theirs / own for own, theirs in zip(times[0], times[1], strict=True)]
    return Row(
        name,
        size,
        statistics.median(times[0]),
        peer_name,
        statistics.median(times[1]),
        runs,
        deviation(times[0]),
        deviation(times[1]),
        deviation(ratios),
    )


def deviation(values: Sequence[float]) -> float:
    """Median absolute deviation."""
    middle = statistics.median(values)
    return statistics.median(abs(v - middle) for v in values)
