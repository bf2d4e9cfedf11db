"""Which map has answered which keyframe: fed by subscriptions, waited for by the worker."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence

from helios_core import proto as pb
from helios_core.codec import frame_id_from_proto
from helios_core.types import FrameId

# Who answers each part of a keyframe; all but the occupancy come by way of the detector.
PARTS = {
    "detections": "detector",
    "occupancy": "map2d",
    "value": "map2d (or the detector before it)",
    "objects": "objectmap (or the detector before it)",
}
REMEMBERED = 64


class AckBook:
    """Thread-safe."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._answers: dict[FrameId, dict[str, pb.Ack]] = {}

    def add(self, ack: pb.Ack) -> None:
        with self._changed:
            self._answers.setdefault(frame_id_from_proto(ack.id), {})[ack.part] = ack
            while len(self._answers) > REMEMBERED:
                del self._answers[next(iter(self._answers))]
            self._changed.notify_all()

    def wait(
        self, id: FrameId, parts: Sequence[str], timeout_s: float, ending: threading.Event
    ) -> tuple[dict[str, pb.Ack], list[str]]:
        """(answers, parts that are missing) when all came, time is over, or `ending` is set."""
        deadline = time.monotonic() + timeout_s
        with self._changed:
            while True:
                answers = {p: a for p, a in self._answers.get(id, {}).items() if p in parts}
                missing = [part for part in parts if part not in answers]
                left = deadline - time.monotonic()
                if not missing or left <= 0 or ending.is_set():
                    return answers, missing
                self._changed.wait(min(left, 0.2))
