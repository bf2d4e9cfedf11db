"""A recording goes on by itself, frame by frame, once somebody is there to see it."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable

from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.errors import HeliosError
from helios_core.health import Health
from helios_core.robot import EndOfRecording, Observe, RobotDriver
from helios_core.topics import ANY_STATUS, CONTEXT

from helios_bridge.lookout import Lookout

log = logging.getLogger(__name__)

VIEWERS = frozenset({"detector", "objectmap", "map2d"})


class Player:
    """Plays the driver's recording, one keyframe after the other."""

    def __init__(
        self,
        bus: Bus,
        driver: RobotDriver,
        lookout: Lookout,
        turn: threading.Lock,
        health: Health,
        brings_contexts: bool,
    ) -> None:
        """turn: whoever holds it uses the driver. brings_contexts: the recording says itself what
        is looked for; else it waits until somebody does."""
        self._driver, self._lookout, self._turn, self._health = driver, lookout, turn, health
        self._ready: set[str] = set()
        self._context_known = threading.Event()
        if brings_contexts:
            self._context_known.set()
        bus.subscribe(CONTEXT, lambda _: self._context_known.set())
        bus.subscribe(ANY_STATUS, self._note)

    def run(self, ending: threading.Event, told: Callable[[], None]) -> None:
        """Until the recording or the bridge ends. told: called when the state has changed."""
        while not (self._context_known.is_set() and self._ready >= VIEWERS):
            missing = ", ".join(sorted(VIEWERS - self._ready))
            self._health.ready(f"the recording waits for {missing or 'a search context'}")
            if ending.wait(0.05):
                return
        self._health.ready()
        shot = 0
        while not ending.is_set():
            shot += 1
            try:
                with self._turn:
                    self._driver.act(Observe(), f"play-{shot}")
                    self._lookout.look(keyframe=True)
            except EndOfRecording:
                break
            except HeliosError as error:
                log.error("the recording cannot go on: %s", error.message)
                self._health.degraded(error.message)
                return
            except Exception as error:  # of somebody's own driver
                log.exception("the driver failed")
                self._health.degraded(
                    f"the recording cannot go on: the driver failed ({type(error).__name__}: "
                    f"{error}); mend it"
                )
                return
            told()
        told()

    def _note(self, status: pb.ServiceStatus) -> None:
        if status.state == "ready":
            self._ready.add(status.service)
        else:
            self._ready.discard(status.service)
