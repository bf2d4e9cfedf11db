"""Candidates that were believed once: what to go back to when nothing is believed any more.

A map forgets: a look from near, in which a detector names something else, takes a thing out of it
that many views had spoken for. The paper is silent on what to do when everything was searched and
no candidate is left; then the one that the most views spoke for is better than none.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Sequence

from helios_core import proto as pb
from helios_core.codec import object_from_proto, object_to_proto
from helios_core.types import ObjectInstance

MOST_WRITTEN = 16


class Remembered:
    """Candidates as they were when they were believed last, by id."""

    def __init__(self) -> None:
        self._things: dict[int, ObjectInstance] = {}

    def note(self, candidates: Iterable[ObjectInstance]) -> None:
        """Of one that is known already, what is believed now."""
        self._things |= {c.id: c for c in candidates}

    def get(self, id: int) -> ObjectInstance | None:
        return self._things.get(id)

    def best(self, allowed: Callable[[ObjectInstance], bool]) -> ObjectInstance | None:
        """The one with the largest class score times views; None where none is allowed."""
        return max(filter(allowed, self._things.values()), key=_spoken_for, default=None)

    def memory(self) -> list[str]:
        """As JSON, for `recall`: the best ones, since it is written down before every action."""
        best = heapq.nlargest(MOST_WRITTEN, self._things.values(), key=_spoken_for)
        return [object_to_proto(c).SerializeToString().hex() for c in best]

    def recall(self, memory: Sequence[str]) -> None:
        self.note(object_from_proto(pb.ObjectInstance.FromString(bytes.fromhex(m))) for m in memory)


def _spoken_for(c: ObjectInstance) -> tuple[float, int]:
    """How much the views said for it; of equals the older one."""
    return c.class_score * c.views, -c.id
