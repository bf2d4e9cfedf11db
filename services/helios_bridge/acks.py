"""Which maps have answered which keyframe."""

from __future__ import annotations

import threading

from helios_core import proto as pb
from helios_core.codec import frame_id_from_proto
from helios_core.types import FrameId

PARTS = frozenset({"objectmap/objects", "map2d/occupancy", "map2d/value"})


class AckBook:
    """Fed with every Ack; thread-safe. Remembers the newest frames only."""

    def __init__(self, remembered: int = 16) -> None:
        self._changed = threading.Condition()
        self._answered: dict[FrameId, set[str]] = {}
        self._remembered = remembered

    def add(self, ack: pb.Ack) -> None:
        with self._changed:
            id = frame_id_from_proto(ack.id)
            self._answered.setdefault(id, set()).add(f"{ack.service}/{ack.part}")
            while len(self._answered) > self._remembered:
                del self._answered[next(iter(self._answered))]
            self._changed.notify_all()

    def wait(self, id: FrameId, timeout_s: float) -> frozenset[str]:
        """The parts that have not answered `id` when all have, or the time is over."""
        with self._changed:
            self._changed.wait_for(lambda: not self._missing(id), timeout_s)
            return self._missing(id)

    def _missing(self, id: FrameId) -> frozenset[str]:
        return PARTS - self._answered.get(id, set())
