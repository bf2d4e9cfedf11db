"""Choice of a subscription's quality of service from what the publishers offer. No I/O."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Qos:
    """Quality of service, as far as it decides whether two endpoints match."""

    reliable: bool = True
    retained: bool = False  # durability transient local

    def __str__(self) -> str:
        kept = ", transient local" if self.retained else ""
        return ("reliable" if self.reliable else "best effort") + kept


def matching(offered: Sequence[Qos]) -> Qos:
    """The strongest quality that every publisher offers.

    A subscription that asks for more than a publisher offers never receives from it.
    """
    return Qos(all(q.reliable for q in offered), all(q.retained for q in offered))
