"""Detector of a recording: answers each replayed keyframe with its recorded observation.

It replaces the detector on the bus. It also repeats the recorded retirements of picked objects from
the object map, each after the same keyframe as before.
"""

from __future__ import annotations

import logging
import threading
from pathlib import Path

from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.codec import frame_id_from_proto
from helios_core.errors import HeliosError, InvalidInput
from helios_core.health import Health
from helios_core.topics import (
    KEYFRAME,
    MAP2D_ACK,
    OBJECTMAP_ACK,
    OBSERVATION,
    PREVIEW,
    RETIRE,
    VOCABULARY,
)
from helios_core.types import FrameId

from helios_replay.format_detection import mcap_files
from helios_replay.mcap_index import Index, read_index

log = logging.getLogger(__name__)

CALL_S = 30.0
NAME = "recorded"


class RecordedDetector:
    """Recorded detector (see the module). `_lock` is held while a keyframe is answered, to keep the
    recorded order."""

    def __init__(self, bus: Bus, source: Path, health: Health) -> None:
        """Raises InvalidInput when the recording is unreadable or has no observation."""
        self._bus, self._health = bus, health
        self._index: Index = read_index(mcap_files(source))
        if not self._index.observations:
            raise InvalidInput(
                f"{source} holds nothing that a detector found; name one, --detector onnx:FILE"
            )
        self._order = {frame_id_from_proto(k.head.id): i for i, k in enumerate(self._index.keys)}
        self._retired = list(self._index.retired)
        self._lock = threading.RLock()
        self._began = -1  # first replayed keyframe; earlier retirements are not repeated
        bus.serve(VOCABULARY, lambda _: pb.VocabularyReply(open=True, detector=NAME, scorer=NAME))
        bus.subscribe(OBJECTMAP_ACK, self.on_ack)
        bus.subscribe(KEYFRAME, self.on_keyframe)
        health.ready()

    def close(self) -> None:
        """No effect: closing the bus ends the calls."""

    def on_keyframe(self, message: pb.Frame) -> None:
        """Publish the keyframe's recorded observation, or refuse the keyframe for the maps."""
        id = frame_id_from_proto(message.id)
        with self._lock:
            here = self._order.get(id)
            if here is not None and self._began < 0:
                self._began = here
                self._retired = [r for r in self._retired if r.after >= here]
            if here is not None:
                self._retire(here - 1)
            answer = self._index.observations.get(id)
            if answer is None:
                self._refuse(message.id, "no observation of this keyframe was recorded")
                return
            try:
                observation = self._index.message(answer.where, pb.Observation)
            except InvalidInput as error:
                self._refuse(message.id, error.message)
                return
            observation.frame.CopyFrom(message)
            self._health.count("keyframes_answered")
            self._bus.publish(OBSERVATION, observation)
            self._publish_preview(id)

    def on_ack(self, ack: pb.Ack) -> None:
        """The object map has the keyframe: repeat the retirements recorded after it."""
        here = self._order.get(frame_id_from_proto(ack.id))
        if here is not None:
            with self._lock:
                self._retire(here)

    def _retire(self, until: int) -> None:
        while self._retired and self._retired[0].after <= until:
            request = self._retired.pop(0).request
            try:
                self._bus.call(RETIRE, request, CALL_S)
                self._health.count("retired")
            except HeliosError as error:
                log.warning("object %d was not retired: %s", request.object_id, error.message)
                self._health.degraded(f"an object that was picked is still mapped: {error.message}")

    def _publish_preview(self, id: FrameId) -> None:
        where = self._index.previews.get(id)
        if where is not None:
            self._bus.publish(PREVIEW, self._index.message(where, pb.Preview))

    def _refuse(self, id: pb.FrameId, reason: str) -> None:
        """Refuse the keyframe in the maps' place, so that nothing waits for its observation."""
        self._health.count("keyframes_refused")
        log.warning("keyframe %d: %s", id.seq, reason)
        for topic, service, part in (
            (OBJECTMAP_ACK, "objectmap", "objects"),
            (MAP2D_ACK, "map2d", "value"),
        ):
            ack = pb.Ack(service=service, part=part, id=id, accepted=False, reason=reason)
            self._bus.publish(topic, ack)
