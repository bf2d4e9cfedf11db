"""What the detector reported during one task; for agents that trust it."""

from __future__ import annotations

import logging
import threading

from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.codec import observation_from_proto
from helios_core.errors import HeliosError
from helios_core.keyframe_acks import AckBook
from helios_core.topics import OBSERVATION

from helios_planner.robot.sightings import Sighting, sightings_of

log = logging.getLogger(__name__)

PART = "detections"


class Inbox:
    """Collects sightings and answers each keyframe in the book. Thread-safe."""

    def __init__(self, bus: Bus, acks: AckBook, context_id: str) -> None:
        self._acks, self._context_id = acks, context_id
        self._lock = threading.Lock()
        self._sightings: list[Sighting] = []
        self._registration = bus.subscribe(OBSERVATION, self._on_observation)

    def sightings(self) -> list[Sighting]:
        """All of this task, in the order of their coming."""
        with self._lock:
            return list(self._sightings)

    def close(self) -> None:
        self._registration.close()

    def _on_observation(self, message: pb.Observation) -> None:
        ack = pb.Ack(
            service="planner", part=PART, id=message.frame.id, context_id=message.context_id,
            accepted=True,
        )  # fmt: skip
        if message.context_id == self._context_id:
            try:
                found = sightings_of(observation_from_proto(message))
            except HeliosError as error:
                log.warning("observation %d refused: %s", message.frame.id.seq, error.message)
                ack.accepted, ack.reason = False, error.message
            else:
                with self._lock:
                    self._sightings += found
        self._acks.add(ack)
