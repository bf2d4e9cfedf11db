"""Playback of a recording, frame by frame, once the maps are ready.

An unreadable frame is skipped, counted and reported, so that one bad file among thousands does not
cost the others. `strict` ends the playback at that frame.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable

from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.errors import HeliosError, InvalidInput
from helios_core.robot import EndOfRecording, Observe, RobotDriver
from helios_core.topics import ANY_STATUS, CONTEXT

from helios_bridge.bridge_health import BridgeHealth
from helios_bridge.frame_publisher import FramePublisher

log = logging.getLogger(__name__)

VIEWERS = frozenset({"detector", "objectmap", "map2d"})
UNREADABLE = "unreadable_frames"  # the counter's name
AFTER_UNREADABLE_S = 0.01  # limits the CPU load of a source with only bad frames


class RecordingPlayer:
    """Player of the driver's recording, one keyframe after the other."""

    def __init__(
        self,
        bus: Bus,
        driver: RobotDriver,
        publisher: FramePublisher,
        turn: threading.Lock,
        health: BridgeHealth,
        brings_contexts: bool,
        strict: bool,
    ) -> None:
        """turn: lock on the driver. strict: see the module.

        brings_contexts: the recording contains search contexts; otherwise the player waits for one.
        """
        self._driver, self._publisher, self._turn, self._health = driver, publisher, turn, health
        self._strict = strict
        self._ready: set[str] = set()
        self._context_known = threading.Event()
        if brings_contexts:
            self._context_known.set()
        bus.subscribe(CONTEXT, lambda _: self._context_known.set())
        bus.subscribe(ANY_STATUS, self._note)

    def run(self, ending: threading.Event, publish_state: Callable[[], None]) -> None:
        """Play until the recording or the bridge ends. publish_state: called after each change."""
        while not (self._context_known.is_set() and self._ready >= VIEWERS):
            missing = ", ".join(sorted(VIEWERS - self._ready))
            self._health.ready(f"the recording waits for {missing or 'a search context'}")
            if ending.wait(0.05):
                return
        self._health.ready()
        shot, unreadable = 0, ""
        while not ending.is_set():
            shot += 1
            try:
                with self._turn:
                    self._driver.act(Observe(), f"play-{shot}")
                    self._publisher.capture_and_wait(keyframe=True)
            except EndOfRecording:
                break
            except InvalidInput as error:
                if self._strict:
                    self._fail(error.message)
                    return
                unreadable = error.message
                log.warning("a frame is left out: %s", unreadable)
                self._health.count(UNREADABLE)
                self._health.ready(f"a frame was left out: {unreadable}")
                ending.wait(AFTER_UNREADABLE_S)
            except HeliosError as error:
                self._fail(error.message)
                return
            except Exception as error:  # an internal error
                log.exception("a keyframe could not be made")
                self._fail(f"the bridge failed ({type(error).__name__}: {error})")
                return
            publish_state()
        if unreadable:
            self._health.ready(f"some frames were left out, the last: {unreadable}")
        publish_state()

    def _fail(self, why: str) -> None:
        log.error("the recording cannot go on: %s", why)
        self._health.degraded(f"the recording cannot go on: {why}")

    def _note(self, status: pb.ServiceStatus) -> None:
        if status.state in ("ready", "degraded"):  # a degraded service works, with a known fault
            self._ready.add(status.service)
        else:
            self._ready.discard(status.service)
