"""Map parts that acknowledge keyframes, and a record of the acknowledgements received."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Collection, Iterable
from enum import StrEnum

from helios_core import proto as pb
from helios_core.codec import frame_id_from_proto
from helios_core.types import FrameId

LOOKS_S = 0.2  # period at which `KeyframeAcks.wait` checks its `ending` event and `lost`
GRACE_S = 0.5  # for acknowledgements that are on their way


class MapPart(StrEnum):
    """Map part that acknowledges keyframes; the value is its `Ack.part`."""

    OCCUPANCY = "occupancy"  # also without a search context
    VALUE = "value"
    OBJECTS = "objects"

    @property
    def service(self) -> str:
        """Service that this part belongs to."""
        return "objectmap" if self is MapPart.OBJECTS else "map2d"


FROM_DETECTIONS = frozenset({MapPart.VALUE, MapPart.OBJECTS})  # parts that need an Observation


def full_names(parts: Iterable[MapPart]) -> frozenset[str]:
    """Names of parts with their service, such as `map2d/occupancy`."""
    return frozenset(f"{part.service}/{part}" for part in parts)


def full_name_of(ack: pb.Ack) -> str:
    """Name of an acknowledgement's part, in the form of `full_names`."""
    return f"{ack.service}/{ack.part}"


class KeyframeAcks:
    """Acknowledgements of the newest frames. Receives every Ack; thread-safe."""

    def __init__(
        self, part: Callable[[pb.Ack], str] = lambda ack: ack.part, remembered: int = 64
    ) -> None:
        """part: key of an acknowledgement; remembered: number of frames to store."""
        self._part, self._remembered = part, remembered
        self._changed = threading.Condition()
        self._answers: dict[FrameId, dict[str, pb.Ack]] = {}
        self.ended = False  # no wait blocks any more

    def add(self, ack: pb.Ack) -> None:
        """Record an acknowledgement for its own part."""
        self._add(ack, {self._part(ack): ack})

    def add_for(self, ack: pb.Ack, parts: Collection[str]) -> None:
        """Record an acknowledgement for those of `parts` that have sent none and now cannot."""
        with self._changed:
            known = self._answers.get(frame_id_from_proto(ack.id), {})
            self._add(ack, {part: ack for part in parts if part not in known})

    def _add(self, ack: pb.Ack, answers: dict[str, pb.Ack]) -> None:
        with self._changed:
            self._answers.setdefault(frame_id_from_proto(ack.id), {}).update(answers)
            while len(self._answers) > self._remembered:
                del self._answers[next(iter(self._answers))]
            self._changed.notify_all()

    def end(self) -> None:
        """End all present and future waits."""
        with self._changed:
            self.ended = True
            self._changed.notify_all()

    def answers(self, id: FrameId) -> dict[str, pb.Ack]:
        """Acknowledgements of a frame received so far, by part, in order of arrival."""
        with self._changed:
            return dict(self._answers.get(id, {}))

    def wait(
        self,
        id: FrameId,
        parts: Collection[str],
        timeout_s: float,
        ending: threading.Event | None = None,
        lost: Callable[[], bool] = lambda: False,
    ) -> list[str]:
        """Wait until all `parts` have acknowledged a frame. Returns the parts that have not.

        The wait also ends at the timeout, at `end`, when `ending` is set, and `GRACE_S` after
        `lost` has become true: what is on its way then arrives, and the rest never does.
        `ending` and `lost` are read every `LOOKS_S`.
        """
        deadline, is_lost = time.monotonic() + timeout_s, False
        with self._changed:
            while True:
                missing = [part for part in parts if part not in self._answers.get(id, {})]
                if not is_lost and lost():
                    is_lost, deadline = True, min(deadline, time.monotonic() + GRACE_S)
                left_s = deadline - time.monotonic()
                over = self.ended or (ending is not None and ending.is_set())
                if not missing or left_s <= 0 or over:
                    return missing
                self._changed.wait(min(left_s, LOOKS_S))
