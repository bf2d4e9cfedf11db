"""The newest messages of a robot, kept in memory, and the recordings that are made of them.

The handlers of the bus only queue messages. One thread encodes them, drops old ones, and writes a
recording when its time is over. Images are thinned to one per second, so that a few megabytes hold
the whole time.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from google.protobuf.message import Message
from helios_core import proto as pb
from helios_core.errors import HeliosError
from helios_core.image_messages import ImageMessage, apart
from helios_core.recording_format import channel_of
from helios_core.topics import FRAME, KEYFRAME, PREVIEW
from helios_core.viewing.bus_messages import is_retained, without_pixels
from helios_core.viewing.entry import Entry
from helios_core.viewing.message_entries import Entries
from helios_core.viewing.message_queue import Item, MessageQueue

from helios_gateway.faults.box_file import BoxMessage, compressed, mcap_bytes
from helios_gateway.faults.findings import DOWN_S  # the longest time to a confirmation

log = logging.getLogger(__name__)

MB = 1_000_000
BEFORE_S = 20.0  # before a fault was raised, which is before it was confirmed
AFTER_S = 5.0
LONGEST_S = 60.0  # of one recording, if faults keep coming
IMAGE_EVERY_S = 1.0  # pixels of a frame; previews come at their own rate
QUEUE_BYTES, RING_BYTES, RECORDING_BYTES = 32 * MB, 24 * MB, 48 * MB
JPEG_QUALITY = 80
IDLE_S = 0.2
CLOSE_WITHIN_S = 1.0
_IMAGES = frozenset({channel_of(FRAME), channel_of(KEYFRAME)})
_DROPPABLE = _IMAGES | {channel_of(PREVIEW)}


@dataclass
class _Recording:
    """Recording that is being made; clock: monotonic nanoseconds of the log times."""

    name: str
    began_ns: int
    ends_ns: int
    about: dict[str, str]
    messages: list[BoxMessage] = field(default_factory=list)
    bytes: int = 0
    left_out: int = 0

    def add(self, message: BoxMessage) -> None:
        if self.bytes + message.size > RECORDING_BYTES:
            self.left_out += 1
        else:
            self.messages.append(message)
            self.bytes += message.size


class _Ring:
    """Newest messages, limited by age and by size. Of a retained channel it also keeps the message
    that was valid when the ring begins."""

    def __init__(self) -> None:
        self._messages: deque[BoxMessage] = deque()
        self._before: dict[str, BoxMessage] = {}  # by channel
        self._bytes = 0

    def add(self, message: BoxMessage) -> None:
        self._messages.append(message)
        self._bytes += message.size
        oldest_ns = message.log_time_ns - int((BEFORE_S + DOWN_S) * 1e9)
        while self._messages[0].log_time_ns < oldest_ns or self._bytes > RING_BYTES:
            gone = self._messages.popleft()
            self._bytes -= gone.size
            if is_retained(gone.channel):
                self._before[gone.channel] = gone
            if not self._messages:
                return

    def content(self) -> list[BoxMessage]:
        """All messages in order; those from before the ring get the time of its begin."""
        if not self._messages:
            return list(self._before.values())
        begin_ns = self._messages[0].log_time_ns
        return [*(m.at(begin_ns) for m in self._before.values()), *self._messages]


class BlackBox:
    """See the module. `save` gets the name and the bytes of each finished recording."""

    def __init__(self, save: Callable[[str, bytes], None]) -> None:
        self._save = save
        self._queue = MessageQueue(QUEUE_BYTES)
        self._entries = Entries(JPEG_QUALITY, lossless_keyframes=False)
        self._ring = _Ring()
        self._lock = threading.Lock()  # guards `_ring` and `_recording`
        self._recording: _Recording | None = None
        self._image_s = self._keyframe_s = -IMAGE_EVERY_S  # monotonic; newest kept ones
        self._clock_ns = time.time_ns() - time.monotonic_ns()  # as the queue's: it never jumps
        self._thread = threading.Thread(target=self._run, name="black box", daemon=True)
        self._thread.start()

    def put(self, channel: str, message: Message | ImageMessage) -> None:
        """Take a message of the bus. Never blocks; a full queue drops it."""
        is_image = channel in _IMAGES
        if is_image and not self._is_due(channel, time.monotonic()):
            return
        self._queue.put(channel, _plain(message, is_image), channel in _DROPPABLE)

    def record(self, name: str, about: Mapping[str, str]) -> str:
        """Begin a recording, or prolong the present one. Returns the name of the file that will
        hold it."""
        now_ns = self._now_ns()
        ends_ns = now_ns + int(AFTER_S * 1e9)
        with self._lock:
            present = self._recording
            if present is not None:
                latest_ns = present.began_ns + int(LONGEST_S * 1e9)
                present.ends_ns = min(max(present.ends_ns, ends_ns), latest_ns)
                return present.name
            begun = _Recording(name, now_ns, ends_ns, dict(about))
            for message in self._ring.content():
                begun.add(message)
            self._recording = begun
            return name

    def close(self) -> None:
        """End the present recording now."""
        self._queue.close()
        self._thread.join(CLOSE_WITHIN_S)

    def _run(self) -> None:
        while not self._queue.closed:
            try:
                item = self._queue.take(IDLE_S)
                if item is not None:
                    self._take(item)
                self._finish_if_due(self._now_ns())
            except Exception:  # one bad message must not end the black box
                log.exception("a message could not be kept for recordings of faults")
        self._finish_if_due(None)

    def _is_due(self, channel: str, now_s: float) -> bool:
        """True if an image is to be kept. A stream frame is left out soon after a keyframe."""
        is_keyframe = channel == channel_of(KEYFRAME)
        newest_s = self._keyframe_s if is_keyframe else max(self._image_s, self._keyframe_s)
        if now_s - newest_s < IMAGE_EVERY_S:
            return False
        if is_keyframe:
            self._keyframe_s = now_s
        else:
            self._image_s = now_s
        return True

    def _now_ns(self) -> int:
        return self._clock_ns + time.monotonic_ns()

    def _take(self, item: Item) -> None:
        message = item.message
        if isinstance(message, pb.Observation):  # the frame's pixels come as keyframes
            message = without_pixels(apart(message))
        try:
            entries = list(self._entries.of(item.channel, message, item.log_time_ns))
        except HeliosError as error:  # an unreadable image
            log.debug("%s: %s", item.channel, error.message)
            return
        for entry in entries:
            self._keep(entry, item.log_time_ns)

    def _keep(self, entry: Entry, log_time_ns: int) -> None:
        message = compressed(entry, log_time_ns)
        with self._lock:
            self._ring.add(message)
            if self._recording is not None:
                self._recording.add(message)

    def _finish_if_due(self, now_ns: int | None) -> None:
        """Write the recording whose time is over. now_ns: None ends it in any case."""
        with self._lock:
            done = self._recording
            if done is None or (now_ns is not None and now_ns < done.ends_ns):
                return
            self._recording = None
        about = done.about | ({"left_out": str(done.left_out)} if done.left_out else {})
        self._save(done.name, mcap_bytes(done.messages, about))


def _plain(message: Message | ImageMessage, pixels: bool) -> Message:
    """The message as protobuf; if it has its images apart, only with them if `pixels` is set."""
    if not isinstance(message, ImageMessage):
        return message
    return message.whole() if pixels else message.head
