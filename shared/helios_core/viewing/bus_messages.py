"""Every topic of the bus and the content of the maps, put into a queue for a slow reader.

The handlers only put messages, so that no sender waits. Stream topics are subscribed without
dropping; the queue drops them if it is full.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Protocol

from google.protobuf.message import Message

from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.image_messages import ImageMessage
from helios_core.recording_format import MAPS, channel_of, head_of
from helios_core.topics import (
    ANY_STATUS,
    CONTEXT,
    FRAME,
    MAP2D_ACK,
    OBJECTMAP_ACK,
    OBSERVATION,
    PREVIEW,
    RELOCALISATION,
    RETIRED,
    TOPICS,
    QoS,
    Topic,
    status_topic,
)
from helios_core.viewing.entry import Entry
from helios_core.viewing.map_polling import MapPoller

DROPPABLE = frozenset({FRAME.name, PREVIEW.name})
CHANGES = {  # topic -> maps that change after its messages
    MAP2D_ACK.name: ("map2d",),
    OBJECTMAP_ACK.name: ("objectmap",),
    RETIRED.name: ("objectmap",),
    CONTEXT.name: ("map2d", "objectmap"),
    RELOCALISATION.name: ("map2d", "objectmap"),  # also after a reset, a load or a restart of map2d
}


RETAINED = frozenset(channel_of(t) for t in TOPICS if t.qos is QoS.RETAINED)


def is_retained(channel: str) -> bool:
    """True if the last message of a channel stays valid, so that a late reader needs it."""
    return channel in RETAINED or channel.startswith(MAPS)


def without_pixels(message: ImageMessage[pb.Observation]) -> pb.Observation:
    """The observation with the head of its frame only."""
    out = message.head
    out.frame.CopyFrom(head_of(out.frame))  # removes compressed images, too
    return out


class Put(Protocol):
    """Receiver of the messages. It must not block."""

    def __call__(self, channel: str, message: Message, droppable: bool) -> None: ...


class BusMessages:
    """Subscriptions of every topic, with the polling of the maps: see the module."""

    def __init__(
        self, bus: Bus, map_period_s: float, put: Put, count: Callable[[str], None]
    ) -> None:
        """map_period_s: least time between two polls of the maps; 0: never. count: increments a
        named counter of missing or unreadable answers of the maps."""
        self._put = put
        self._maps: MapPoller | None = None
        if map_period_s > 0:
            self._maps = MapPoller(bus, map_period_s, self._put_map, count)
        for topic in TOPICS:
            self._subscribe(bus, topic)
        bus.subscribe(ANY_STATUS, self._on_status)

    def close(self) -> None:
        """Stop the polling; no content of the maps follows. Closing the bus ends the rest."""
        if self._maps is not None:
            self._maps.close()

    def _subscribe(self, bus: Bus, topic: Topic) -> None:
        channel, droppable = channel_of(topic), topic.name in DROPPABLE
        heard = replace(topic, qos=QoS.NEVER_DROP) if topic.qos is QoS.LATEST_WINS else topic

        def keep(message: Message) -> None:
            self._put(channel, message, droppable)
            self._note_change(topic, message)

        if topic is OBSERVATION:  # without its pixels, which the keyframe already has
            bus.subscribe_in_place(heard, lambda message: keep(without_pixels(message)))
        else:
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
