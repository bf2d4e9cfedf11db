"""Which maps have answered which keyframe, and what."""

from __future__ import annotations

import threading
from collections.abc import Set

from helios_core import proto as pb
from helios_core.codec import frame_id_from_proto
from helios_core.types import FrameId

OCCUPANCY = "map2d/occupancy"  # answered whether or not anything is looked for
PARTS = frozenset({"objectmap/objects", OCCUPANCY, "map2d/value"})


class AckBook:
    """Fed with every Ack; thread-safe. Remembers the newest frames only."""

    def __init__(self, remembered: int = 16) -> None:
        self._changed = threading.Condition()
        self._answered: dict[FrameId, dict[str, pb.Ack]] = {}
        self._remembered = remembered
        self.ended = False  # nobody waits any more

    def end(self) -> None:
        """End every wait, now and later."""
        with self._changed:
            self.ended = True
            self._changed.notify_all()

    def add(self, ack: pb.Ack) -> None:
        with self._changed:
            id = frame_id_from_proto(ack.id)
            self._answered.setdefault(id, {})[f"{ack.service}/{ack.part}"] = ack
            while len(self._answered) > self._remembered:
                del self._answered[next(iter(self._answered))]
            self._changed.notify_all()

    def wait(self, id: FrameId, timeout_s: float, parts: Set[str] = PARTS) -> frozenset[str]:
        """Those of `parts` that have not answered `id` when all have, or the time is over, or the
        bridge ends."""
        with self._changed:
            self._changed.wait_for(lambda: self.ended or not self._missing(id, parts), timeout_s)
            return self._missing(id, parts)

    def answers(self, id: FrameId) -> tuple[pb.Ack, ...]:
        """What came so far, in the order of its coming."""
        with self._changed:
            return tuple(self._answered.get(id, {}).values())

    def _missing(self, id: FrameId, parts: Set[str]) -> frozenset[str]:
        return frozenset(parts - self._answered.get(id, {}).keys())
