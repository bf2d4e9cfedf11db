"""Metrics of an episode record by name, with a limit of picks."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from helios_eval.episodes.episode_record import EpisodeRecord


@dataclass(frozen=True)
class Metric:
    """Metric: its name, its meaning, and the function that reads it from a record."""

    name: str
    meaning: str
    of: Callable[[EpisodeRecord], float]
    binary: bool = False  # 0 or 1: has a Wilson interval
    share: bool = False  # 0 to 1, shown in percent; 0 when picks exceed the limit
    digits: int = 1
    better: int = 1  # -1: less is better
    of_present: bool = False  # only of episodes whose object is in the home


_ALL = (
    Metric("FindObj", "the robot stood at a viewpoint of an object of the asked class on a "
           "receptacle of the asked class, and saw it", lambda r: r.find_object, True, True,
           of_present=True),
    Metric("Pick", "FindObj, and the held object is one of those", lambda r: r.pick, True, True,
           of_present=True),
    Metric("FindRec", "Pick, and then the robot stood at a viewpoint of a goal receptacle and "
           "saw it", lambda r: r.find_receptacle, True, True, of_present=True),
    Metric("Place", "FindRec, and such an object came to rest on a goal receptacle",
           lambda r: r.place, True, True, of_present=True),
    Metric("SR", "success. OVMM: such an object rests on a goal receptacle in the end, whatever "
           "phases came before, and no collision in the whole episode. Object navigation: the "
           "robot said that it is there, and it was", lambda r: r.success, True, True),
    Metric("partial", "(FindObj + Pick + FindRec + SR) / 4", lambda r: r.partial_success,
           share=True, of_present=True),
    Metric("SPL", "success times the shortest path over the path that was driven",
           lambda r: r.spl, share=True),
    Metric("collisions", "steps in which the robot touched the scene", lambda r: r.collisions,
           digits=2, better=-1),
    Metric("steps", "actions carried out, of whatever kind", lambda r: r.steps, better=-1),
    Metric("seconds_per_step", "median over the steps of an episode of the time for one step",
           lambda r: r.step_ms / 1000, digits=3, better=-1),
)  # fmt: skip
METRICS = {m.name: m for m in _ALL}
NAMES = {
    "ovmm": ("FindObj", "Pick", "FindRec", "Place", "SR", "partial", "collisions", "steps",
             "seconds_per_step"),
    "objectnav": ("SR", "SPL", "collisions", "steps", "seconds_per_step"),
}  # fmt: skip
TITLES = {"ovmm": "Pick and place (OVMM)", "objectnav": "Object navigation"}


def value(record: EpisodeRecord, name: str, picks: int | None = None) -> float:
    """Metric of one episode.

    With a limit of picks, an episode that exceeds it scores 0 in every share; collisions, steps and
    time stay unchanged.
    """
    metric = METRICS[name]
    if metric.share and picks is not None and record.picks > picks:
        return 0.0
    return float(metric.of(record))


def values(
    records: Iterable[EpisodeRecord], name: str, picks: int | None = None
) -> NDArray[np.float64]:
    """Metric of many episodes [n], in their order, without those that `has_metric` leaves out. n
    may be 0."""
    found = [value(r, name, picks) for r in records if has_metric(r, name)]
    return np.array(found, dtype=np.float64)


def paired_values(
    first: Sequence[EpisodeRecord], second: Sequence[EpisodeRecord], name: str
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Metric of the same episodes of two arms, [n] each, where both have it. n may be 0."""
    both = [
        (value(a, name), value(b, name))
        for a, b in zip(first, second, strict=True)
        if has_metric(a, name) and has_metric(b, name)
    ]
    x, y = np.array(both, dtype=np.float64).reshape(-1, 2).T
    return x, y


def has_metric(record: EpisodeRecord, name: str) -> bool:
    """True if a metric counts an episode.

    A metric `of_present` leaves out an absent object. An episode that could not be played counts
    as a failure in shares; it took no steps, so the other metrics leave it out.
    """
    metric = METRICS[name]
    if metric.of_present and record.absent:
        return False
    return metric.share or record.was_played


def counts_of_causes(records: Iterable[EpisodeRecord]) -> dict[str, int]:
    """Number of episodes per cause; "" for success."""
    counts: dict[str, int] = {}
    for record in records:
        counts[record.cause] = counts.get(record.cause, 0) + 1
    return counts
