"""Recorder service: subscribes to every topic, blocks no sender, and counts the messages it loses.

Stream topics go through a queue too, instead of a buffer of one message: the handlers only put
messages into the inbox. Gaps in the frame numbers reveal frames that did not reach it.
"""

from __future__ import annotations

import threading
from dataclasses import replace
from typing import cast

from google.protobuf.message import Message
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.health import Health
from helios_core.recording_format import MAPS, channel_of, head_of
from helios_core.topics import (
    ANY_STATUS,
    CONTEXT,
    FRAME,
    KEYFRAME,
    MAP2D_ACK,
    OBJECTMAP_ACK,
    PREVIEW,
    RETIRED,
    TOPICS,
    QoS,
    Topic,
    status_topic,
)

from helios_recorder.entry import Entry
from helios_recorder.map_polling import MISSED, MapPoller
from helios_recorder.recording_thread import Recording
from helios_recorder.settings import Settings

DROPPABLE = frozenset({FRAME.name, PREVIEW.name})
CHANGES = {  # topic -> maps that change after its messages
    MAP2D_ACK.name: ("map2d",),
    OBJECTMAP_ACK.name: ("objectmap",),
    RETIRED.name: ("objectmap",),
    CONTEXT.name: ("map2d", "objectmap"),
}
LARGEST_GAP = 1000  # a larger jump is a restart of the bridge, not a loss


class RecorderService:
    """Subscribers of the recorder: see the module."""

    def __init__(self, bus: Bus, settings: Settings, health: Health) -> None:
        self._health = health
        self._gaps = Gaps()
        health.waiting("opening the recording")
        for counter in ("dropped_frames", "dropped_messages", "missed_frames", MISSED):
            health.set(counter, 0)
        self.recording = Recording(settings, health, is_retained)
        self._maps: MapPoller | None = None
        if settings.map_period_s > 0:
            self._maps = MapPoller(bus, settings, self._put_map, health.count)
        for topic in TOPICS:
            self._subscribe(bus, topic)
        bus.subscribe(ANY_STATUS, self._on_status)

    def close(self) -> None:
        """Finish the file."""
        if self._maps is not None:
            self._maps.close()
        self.recording.close()

    def _subscribe(self, bus: Bus, topic: Topic) -> None:
        channel, droppable = channel_of(topic), topic.name in DROPPABLE
        heard = replace(topic, qos=QoS.NEVER_DROP) if topic.qos is QoS.LATEST_WINS else topic
        is_frame = topic in (FRAME, KEYFRAME)

        def keep(message: Message) -> None:
            if is_frame:
                frame = cast(pb.Frame, message)
                self._health.set("missed_frames", self._gaps.add(frame.id))
            if isinstance(message, pb.Observation):  # the keyframe already has its pixels
                head = head_of(message.frame)
                message.frame.CopyFrom(head)
            self._put(channel, message, droppable)
            self._note_change(topic, message)

        bus.subscribe(heard, keep)

    def _on_status(self, status: pb.ServiceStatus) -> None:
        self._put(channel_of(status_topic(status.service)), status, False)

    def _note_change(self, topic: Topic, message: Message) -> None:
        if self._maps is None or (isinstance(message, pb.Ack) and not message.accepted):
            return
        for service in CHANGES.get(topic.name, ()):
            self._maps.notify_changed(service)

    def _put_map(self, entry: Entry) -> None:
        self._put(entry.channel, entry.message, True)

    def _put(self, channel: str, message: Message, droppable: bool) -> None:
        is_frame = channel in (channel_of(FRAME), channel_of(KEYFRAME))
        counter = "dropped_frames" if is_frame else "dropped_messages"
        self.recording.put(channel, message, droppable, counter)


RETAINED = frozenset(channel_of(t) for t in TOPICS if t.qos is QoS.RETAINED)


def is_retained(channel: str) -> bool:
    """True if the last message of a channel stays valid, so that each file begins with it."""
    return channel in RETAINED or channel.startswith(MAPS)


class Gaps:
    """Counter of frames that never arrived. Thread-safe: stream and keyframes use two threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._epoch: tuple[str, int] | None = None
        self._first = self._last = self._came = self._before = 0

    def add(self, id: pb.FrameId) -> int:
        """Note the arrival of a frame. Returns the number of missing frames so far."""
        epoch = (id.robot_boot_id, id.world_epoch)
        with self._lock:
            if epoch != self._epoch or abs(id.seq - self._last) > LARGEST_GAP:
                self._before += self._missing()
                self._epoch, self._first, self._last, self._came = epoch, id.seq, id.seq, 0
            self._first, self._last = min(self._first, id.seq), max(self._last, id.seq)
            self._came += 1
            return self._before + self._missing()

    def _missing(self) -> int:
        return max(0, self._last - self._first + 1 - self._came) if self._epoch else 0
