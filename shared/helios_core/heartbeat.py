"""Heartbeat of the sender of an action, without which the receiver ends the action.

A process that is killed, frozen or cut off sends no heartbeat. A robot would otherwise drive on
until its present action ends, up to several metres.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.errors import HeliosError
from helios_core.topics import Topic

log = logging.getLogger(__name__)

PERIOD_S = 0.15
SILENCE_S = 0.7  # default of the longest silence: the robot then stands within one second
CHECK_S = 0.03
HALTED = "its sender is silent"  # in the reason of an action that ended for it


class HeartbeatSender:
    """Sends heartbeats on a topic while an action runs."""

    def __init__(self, bus: Bus, topic: Topic[pb.Heartbeat]) -> None:
        self._bus, self._topic = bus, topic

    @contextmanager
    def beating(self, action_id: str) -> Iterator[None]:
        """Send heartbeats for an action until the block ends."""
        ended = threading.Event()
        thread = threading.Thread(target=self._beat, args=(action_id, ended), daemon=True)
        thread.start()
        try:
            yield
        finally:
            ended.set()

    def _beat(self, action_id: str, ended: threading.Event) -> None:
        while not ended.wait(PERIOD_S):
            try:
                self._bus.publish(self._topic, pb.Heartbeat(action_id=action_id))
            except HeliosError as error:
                log.info("no heartbeat could be sent: %s", error.message)


class HeartbeatMonitor:
    """Calls `halt` when the sender of the running action has been silent for `silence_s`."""

    def __init__(
        self,
        bus: Bus,
        topic: Topic[pb.Heartbeat],
        silence_s: float,
        halt: Callable[[str], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """silence_s: 0 never halts. halt: gets the reason, in a thread of its own, again and
        again until the action has ended."""
        self._silence_s, self._halt, self._clock = silence_s, halt, clock
        self._lock = threading.Lock()
        self._action_id, self._heard_s = "", 0.0
        bus.subscribe(topic, self._on_beat)

    @contextmanager
    def watching(self, action_id: str, beats: bool) -> Iterator[None]:
        """Watch an action until the block ends. beats: its sender has promised heartbeats."""
        if not beats or self._silence_s <= 0:
            yield
            return
        with self._lock:
            self._action_id, self._heard_s = action_id, self._clock()
        ended = threading.Event()
        watch = threading.Thread(
            target=self._watch, args=(ended,), name="heartbeat monitor", daemon=True
        )
        watch.start()
        try:
            yield
        finally:
            ended.set()
            watch.join()  # after this, nothing calls `halt` for this action

    def _on_beat(self, beat: pb.Heartbeat) -> None:
        with self._lock:
            if beat.action_id == self._action_id:
                self._heard_s = self._clock()

    def _watch(self, ended: threading.Event) -> None:
        while not ended.wait(CHECK_S):
            with self._lock:
                silent_s = self._clock() - self._heard_s
            if silent_s > self._silence_s:
                self._halt(f"{HALTED} for {silent_s:.1f} s")
