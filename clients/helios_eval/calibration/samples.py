"""Samples of the calibration: beliefs selected from episodes, grouped by setting.

A sample is the last recorded belief about one instance in one episode: its state when the episode
ended, or when the instance was picked up or given up. With `every_step` each recorded belief is a
sample; instances that stay long in the map then weigh more.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from helios_eval.episodes.episode_record import Belief, EpisodeRecord

# Groups of view counts: name, fewest views, most views.
VIEWS: tuple[tuple[str, int, float], ...] = (
    ("1", 0, 1),
    ("2–3", 2, 3),
    ("4–7", 4, 7),
    ("8+", 8, np.inf),
)
ROLES = ("object", "receptacle")


@dataclass(frozen=True)
class Samples:
    """Beliefs of the object map as columns, each [n]."""

    class_score: NDArray[np.float64]  # S, section 3.1.3
    score: NDArray[np.float64]  # Ψ, eq. 7
    uncertainty: NDArray[np.float64]  # U
    views: NDArray[np.int64]
    correct: NDArray[np.bool_]
    receptacle: NDArray[np.bool_]
    episode: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.correct)

    @property
    def episodes(self) -> int:
        return len(np.unique(self.episode))

    def where(self, mask: NDArray[np.bool_]) -> Samples:
        return Samples(
            self.class_score[mask],
            self.score[mask],
            self.uncertainty[mask],
            self.views[mask],
            self.correct[mask],
            self.receptacle[mask],
            self.episode[mask],
        )

    def of_role(self, role: str) -> Samples:
        """Samples of one role of ROLES."""
        return self.where(self.receptacle if role == "receptacle" else ~self.receptacle)

    def of_views(self, name: str) -> Samples:
        """Samples with a view count in the group `name` of VIEWS."""
        low, high = next((low, high) for n, low, high in VIEWS if n == name)
        return self.where((self.views >= low) & (self.views <= high))


def samples_of(records: Sequence[EpisodeRecord], every_step: bool = False) -> Samples:
    """Samples of all the episodes."""
    rows: list[tuple[int, Belief]] = []
    for k, record in enumerate(records):
        beliefs = record.beliefs if every_step else last_beliefs(record.beliefs)
        rows += [(k, belief) for belief in beliefs]
    beliefs = [belief for _, belief in rows]
    return Samples(
        class_score=np.array([b.class_score for b in beliefs], np.float64),
        score=np.array([b.score for b in beliefs], np.float64),
        uncertainty=np.array([b.uncertainty for b in beliefs], np.float64),
        views=np.array([b.views for b in beliefs], np.int64),
        correct=np.array([b.correct for b in beliefs], np.bool_),
        receptacle=np.array([b.role != "object" for b in beliefs], np.bool_),
        episode=np.array([k for k, _ in rows], np.int64),
    )


def last_beliefs(beliefs: Iterable[Belief]) -> list[Belief]:
    """Belief about each instance with the highest step; of equal steps the later one."""
    last: dict[int, Belief] = {}
    for belief in beliefs:
        known = last.get(belief.instance)
        if known is None or belief.step >= known.step:
            last[belief.instance] = belief
    return list(last.values())


def by_setting(records: Iterable[EpisodeRecord]) -> dict[str, list[EpisodeRecord]]:
    """Episodes with beliefs, by a short name of their setting.

    The name always states the noise; agent, preset and other settings only where they differ.
    Sorted: ground truth first, then by level and correlation.
    """
    with_beliefs = [(_facts(r), r) for r in records if r.beliefs]
    names = dict.fromkeys(name for facts, _ in with_beliefs for name in facts)
    differ = [
        n for n in names if len({facts.get(n, _default(n)) for facts, _ in with_beliefs} - {""}) > 1
    ]
    out: dict[str, list[EpisodeRecord]] = {}
    set_anywhere = any(r.noise and r.noise.correlation is not None for _, r in with_beliefs)
    for facts, record in sorted(with_beliefs, key=lambda pair: _order(pair[1])):
        extra = [facts.get(name, _default(name)) for name in differ]
        name = ", ".join(part for part in (_noise(record, set_anywhere), *extra) if part)
        out.setdefault(name, []).append(record)
    return out


def _noise(record: EpisodeRecord, tell_correlation: bool) -> str:
    noise = record.noise
    if record.semantics == "detector":
        return "real detector"
    if noise is None:
        return "ground truth"
    if not tell_correlation:
        return f"noise ×{noise.level:g}"
    if noise.correlation is None:
        return f"noise ×{noise.level:g}, correlation of the table"
    return f"noise ×{noise.level:g}, correlation {noise.correlation:g}"


def _order(record: EpisodeRecord) -> tuple[float, float, str, str]:
    noise = record.noise
    if noise is None:
        return -1.0, -1.0, "", record.agent
    # None sorts between 0 and 1
    correlation = 0.5 if noise.correlation is None else noise.correlation
    return noise.level, correlation, noise.table, record.agent


def _facts(record: EpisodeRecord) -> dict[str, str]:
    facts = {"agent": record.agent, "benchmark": record.benchmark, "preset": record.preset}
    if record.noise is not None:
        facts[_TABLE] = f"table {record.noise.table}"
    return facts | {name: f"{name}={value}" for name, value in sorted(record.settings.items())}


def _default(name: str) -> str:
    """Text for a fact that a record does not have; empty if it needs none."""
    return "" if name == _TABLE else f"{name}=default"


_TABLE = "noise table"
