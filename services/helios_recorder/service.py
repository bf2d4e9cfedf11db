"""Recorder service: records every topic, blocks no sender, and counts the messages it loses.

Gaps in the frame numbers reveal frames that did not reach it.
"""

from __future__ import annotations

import threading
from typing import cast

from google.protobuf.message import Message
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.health import Health
from helios_core.recording_format import channel_of
from helios_core.topics import FRAME, KEYFRAME
from helios_core.viewing.bus_messages import BusMessages, is_retained
from helios_core.viewing.map_polling import MISSED

from helios_recorder.recording_thread import Recording
from helios_recorder.settings import Settings

FRAMES = frozenset({channel_of(FRAME), channel_of(KEYFRAME)})
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
        self._messages = BusMessages(bus, settings.map_period_s, self._put, health.count)

    def close(self) -> None:
        """Finish the file."""
        self._messages.close()
        self.recording.close()

    def _put(self, channel: str, message: Message, droppable: bool) -> None:
        is_frame = channel in FRAMES
        if is_frame:
            self._health.set("missed_frames", self._gaps.add(cast(pb.Frame, message).id))
        counter = "dropped_frames" if is_frame else "dropped_messages"
        self.recording.put(channel, message, droppable, counter)


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
