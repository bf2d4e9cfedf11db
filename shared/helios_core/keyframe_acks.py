"""The parts of the maps that answer keyframes, and which of them have answered which."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Collection, Iterable
from enum import StrEnum

from helios_core import proto as pb
from helios_core.codec import frame_id_from_proto
from helios_core.types import FrameId

LOOKS_S = 0.2  # whether whoever waits is ending


class MapPart(StrEnum):
    """What answers every keyframe, as `Ack.part` spells it."""

    OCCUPANCY = "occupancy"  # whether or not anything is looked for
    VALUE = "value"
    OBJECTS = "objects"

    @property
    def service(self) -> str:
        """The one that answers."""
        return "objectmap" if self is MapPart.OBJECTS else "map2d"


FROM_DETECTIONS = frozenset({MapPart.VALUE, MapPart.OBJECTS})  # made of what the detector found


def full_names(parts: Iterable[MapPart]) -> frozenset[str]:
    """With the service that answers: `map2d/occupancy`."""
    return frozenset(f"{part.service}/{part}" for part in parts)


def full_name_of(ack: pb.Ack) -> str:
    """As `full_names` spells it."""
    return f"{ack.service}/{ack.part}"


class KeyframeAcks:
    """Fed with every Ack, asked by who waits for some; thread-safe. Remembers the newest frames."""

    def __init__(
        self, part: Callable[[pb.Ack], str] = lambda ack: ack.part, remembered: int = 64
    ) -> None:
        """part: what an answer is known by; remembered: so many frames."""
        self._part, self._remembered = part, remembered
        self._changed = threading.Condition()
        self._answers: dict[FrameId, dict[str, pb.Ack]] = {}
        self.ended = False  # nobody waits any more

    def add(self, ack: pb.Ack) -> None:
        """An answer of its own part."""
        self._add(ack, {self._part(ack): ack})

    def add_for(self, ack: pb.Ack, parts: Collection[str]) -> None:
        """An answer that stands for those of `parts` that have not answered, and now cannot."""
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
        """End every wait, now and later."""
        with self._changed:
            self.ended = True
            self._changed.notify_all()

    def answers(self, id: FrameId) -> dict[str, pb.Ack]:
        """What came so far by part, in the order of its coming."""
        with self._changed:
            return dict(self._answers.get(id, {}))

    def wait(
        self,
        id: FrameId,
        parts: Collection[str],
        timeout_s: float,
        ending: threading.Event | None = None,
    ) -> list[str]:
        """Those of `parts` that have not answered when all have, the time is over, or it ends."""
        deadline = time.monotonic() + timeout_s
        with self._changed:
            while True:
                missing = [part for part in parts if part not in self._answers.get(id, {})]
                left_s = deadline - time.monotonic()
                over = self.ended or (ending is not None and ending.is_set())
                if not missing or left_s <= 0 or over:
                    return missing
                self._changed.wait(left_s if ending is None else min(left_s, LOOKS_S))
