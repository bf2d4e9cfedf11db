"""Checks of the robot's set-up from the bridge's keyframes, in a thread of their own.

The first keyframes of every search are checked, and those after a restart by `helios doctor
--robot`. What is wrong appears in the bridge's health; the robot stays ready.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Sequence

from helios_core import proto as pb
from helios_core.robot import Capture
from helios_core.robot_checks.checks import SETTLED, RobotChecks
from helios_core.robot_checks.finding import Finding, warning
from helios_core.robot_checks.routine import MoveLimits, free_ahead_m
from helios_core.types import RobotDescription

from helios_bridge.bridge_health import BridgeHealth

log = logging.getLogger(__name__)

PER_SEARCH = 24  # keyframes that are checked after the start of a search
PER_RESTART, ACTIVE_S = 200, 300.0  # keyframes and time that a restart checks
MOST_WAITING = 16  # keyframes that wait for the thread; later ones are left out
WATCHED_TURNS, WATCH_HZ = 4, 12.0  # turns with images during them after a restart, and their rate
IDLE_S = 1.0


class SetupMonitor:
    """Checks of one robot. Thread-safe; `run` is its thread, and `results` works without it.

    `add` waits for no check: it runs in the thread that publishes keyframes.
    """

    def __init__(self, robot: RobotDescription, health: BridgeHealth) -> None:
        self._robot, self._health = robot, health
        self._working = threading.Lock()  # held while images are checked
        self._lock = threading.Lock()  # on all below; held for moments only
        self._queue: deque[list[Capture]] = deque()  # one keyframe, or the images of a turn
        self._wake = threading.Event()
        self._checks = self._new_checks()
        self._world: object = None
        self._search, self._left = "", PER_SEARCH
        self._active_until_s, self._turns = 0.0, 0
        self._ahead_m = 0.0
        self._said = ""

    def search(self, id: str) -> None:
        """Note the search context: a new one begins the checks anew, with the next keyframes."""
        with self._lock:
            if id == self._search or time.monotonic() < self._active_until_s:
                return
            self._search = id
            self._begin(PER_SEARCH)

    def restart(self) -> None:
        """Begin the checks anew, with images during turns."""
        with self._lock:
            self._begin(PER_RESTART)
            self._active_until_s, self._turns = time.monotonic() + ACTIVE_S, WATCHED_TURNS

    def watch_hz(self) -> float:
        """Rate of the images to take during the next turn; 0: none."""
        with self._lock:
            if self._turns == 0 or time.monotonic() > self._active_until_s:
                return 0.0
            self._turns -= 1
            return WATCH_HZ

    def add(self, capture: Capture, world: object) -> None:
        """Add a keyframe. world: another one than before begins the checks anew."""
        with self._lock:
            if world != self._world:
                self._world = world
                self._begin(PER_SEARCH)
            if self._left == 0 or len(self._queue) >= MOST_WAITING:
                return
            self._left -= 1
            self._queue.append([capture])
        self._wake.set()

    def add_watched(self, captures: Sequence[Capture]) -> None:
        """Add images taken while the robot turned, after the newest keyframe."""
        if len(captures) > 1:
            with self._lock:
                self._queue.append(list(captures))
            self._wake.set()

    def results(self) -> pb.RobotChecksReply:
        """Results of all images so far."""
        with self._working:
            self._process()
            with self._lock:
                checks, ahead_m = self._checks, self._ahead_m
            return pb.RobotChecksReply(
                checks=[_to_proto(finding) for finding in checks.findings()],
                images=checks.views,
                free_ahead_m=ahead_m,
            )

    def run(self, ending: threading.Event) -> None:
        """Check the images as they come, until `ending`."""
        while not ending.is_set():
            if self._wake.wait(IDLE_S):
                self._wake.clear()
                try:
                    with self._working:
                        self._process()
                except Exception:  # a check must not end the bridge
                    log.exception("the robot's set-up could not be checked")

    def _new_checks(self) -> RobotChecks:
        return RobotChecks(self._robot.camera, MoveLimits.of(self._robot).lacks_turns)

    def _begin(self, keyframes: int) -> None:
        self._queue.clear()
        self._checks = self._new_checks()
        self._left = keyframes

    def _process(self) -> None:
        """Check all images that wait, and report what is wrong. `_working` is held."""
        checks = None
        while (taken := self._next()) is not None:
            checks, (first, *more) = taken
            if more:
                checks.add_watched([first, *more])
                continue
            checks.add(first)
            ahead_m = free_ahead_m(first, self._robot)
            with self._lock:
                self._ahead_m = ahead_m
        if checks is not None and checks.views >= SETTLED:
            self._report(warning(checks.findings()))

    def _next(self) -> tuple[RobotChecks, list[Capture]] | None:
        """Oldest images that wait, and the checks that they belong to; None without any."""
        with self._lock:
            return (self._checks, self._queue.popleft()) if self._queue else None

    def _report(self, wrong: str) -> None:
        if wrong == self._said:
            return
        self._said = wrong
        if wrong:
            log.warning("the robot's set-up: %s", wrong)
        self._health.setup(f"set-up: {wrong} (helios doctor --robot)" if wrong else "")


def _to_proto(finding: Finding) -> pb.RobotCheck:
    return pb.RobotCheck(
        name=finding.name,
        verdict=finding.verdict,
        value=finding.value,
        error=finding.error,
        limit=finding.limit,
        unit=finding.unit,
        words=finding.words,
    )
