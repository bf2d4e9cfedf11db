"""One option of a decision."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Candidate:
    """One option with its terms. kind: object, receptacle, frontier or gaze; of what a decision
    remembers: first_seen or chosen_frontier."""

    kind: str
    name: str
    position_m: tuple[float, float, float]
    terms: dict[str, float]
    id: int = 0
