"""Replay of a recording as a robot: each capture returns the next image, and no action moves it."""

from __future__ import annotations

import math
import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path

from helios_core.bus import Bus
from helios_core.errors import InvalidInput
from helios_core.geometry import base_below_camera, tilt_of
from helios_core.robot import (
    Action,
    ActionResult,
    Capture,
    EndOfRecording,
    Observe,
    RobotDriver,
)
from helios_core.topics import CONTEXT, ROBOT_STATE
from helios_core.types import RobotDescription, RobotState

from helios_replay.format_detection import open_source
from helios_replay.replay_source import PlaybackRange

REMEMBERED = 256  # action results kept


class ReplayDriver(RobotDriver):
    """Robot driver that plays any source that `format_detection.open_source` can open.

    `capture` raises InvalidInput once for an unreadable image; the next call returns the next one.
    """

    def __init__(
        self,
        source: Path | None,
        limit: int = 0,
        from_s: float = 0.0,
        to_s: float = math.inf,
        rate: float = 0.0,
        topics: str = "",
        contexts: bool = False,
        bus: Bus | None = None,
        clock: Callable[[], float] = time.monotonic,
        wait: Callable[[float], object] | None = None,
    ) -> None:
        """source: file or folder to play. limit, from_s, to_s: the part to play. rate: playback
        speed, 1 as recorded, 0 as fast as possible. contexts: publish the recorded search contexts
        on `bus` at their recorded times. clock, wait: monotonic time in seconds, and a function
        that waits; `close` ends the default wait. Raises InvalidInput for an unplayable source."""
        if source is None:
            raise InvalidInput("a replay needs something to play; name it with --source")
        self._source = open_source(source, PlaybackRange(limit, from_s, to_s, topics))
        self._rate, self._bus = rate, bus if contexts else None
        self._searching = self._bus is None  # True if another process sets the search context
        self._next = 0
        self._T_world_cam = self._source.shots[0].T_world_cam
        self._T_world_base = base_below_camera(self._T_world_cam)
        self._began_s: float | None = None  # clock time of the first shot
        self._closed = threading.Event()
        self._clock, self._wait = clock, wait or self._closed.wait
        self._stopped = ""  # reason of the stop; empty if not stopped
        self._steps = 0
        self._results: OrderedDict[str, ActionResult] = OrderedDict()

    def describe(self) -> RobotDescription:
        return self._source.describe()

    def state(self) -> RobotState:
        given, total = self._next, len(self._source.shots)
        then = self._source.state_after(given - 1)
        return RobotState(
            T_world_base=self._T_world_base,
            tilt_rad=then.tilt_rad if then else tilt_of(self._T_world_cam),
            held=then.held if then else "",
            stopped=bool(self._stopped),
            world_epoch=then.world_epoch if then else 0,
            robot_boot_id=then.robot_boot_id if then else "",
            origin_id=then.origin_id if then else "",
            message=f"frame {given} of {total}",
            finished=given >= total,
        )

    def capture(self) -> Capture:
        index = self._next
        if index >= len(self._source.shots):
            raise EndOfRecording(f"{self._source.name} has no frame after {index}")
        self._wait_for(index)
        self._next += 1
        if self._bus is not None:
            self._begin(index, self._bus)
        shot, picture = self._source.shots[index], self._source.read(index)
        T_world_base = picture.T_world_base
        if T_world_base is None:
            T_world_base = base_below_camera(shot.T_world_cam)
        self._T_world_cam, self._T_world_base = shot.T_world_cam, T_world_base
        return Capture(
            stamp_ns=shot.stamp_ns,
            color=picture.color,
            depth_m=picture.depth_m,
            camera=picture.camera,
            T_world_cam=shot.T_world_cam,
            T_world_base=T_world_base,
            recorded=picture.recorded,
            searching=self._searching,
        )

    def act(self, action: Action, action_id: str) -> ActionResult:
        known = self._results.get(action_id)
        if known is None:
            known = self._results[action_id] = self._do(action)
            while len(self._results) > REMEMBERED:
                self._results.popitem(last=False)
        return known

    def stop(self, reason: str) -> None:
        self._stopped = reason or "stop-now"

    def clear_stop(self) -> None:
        self._stopped = ""

    def close(self) -> None:
        self._closed.set()

    def _begin(self, index: int, bus: Bus) -> None:
        """Publish the messages that the maps received before this shot: search contexts and a
        changed held object. A free-running robot publishes that its hand is empty before its image
        is mapped; a robot in lockstep, and the bridge, publish it afterwards."""
        for context in self._source.contexts_before(index):
            bus.publish(CONTEXT, context)
            self._searching = True
        before = self._source.state_after(index - 1)
        by_then = self._source.state_when_answered(index)
        if before is not None and by_then is not None and by_then.held != before.held:
            bus.publish(ROBOT_STATE, by_then)

    def _wait_for(self, index: int) -> None:
        """Wait until the time of this shot at the playback rate."""
        now_s, shots = self._clock(), self._source.shots
        if self._began_s is None:
            self._began_s = now_s
        if self._rate > 0:
            due_s = self._began_s + (shots[index].time_s - shots[0].time_s) / self._rate
            self._wait(max(0.0, due_s - now_s))

    def _do(self, action: Action) -> ActionResult:
        if self._stopped:
            return ActionResult(False, f"stopped ({self._stopped}); clear the stop first")
        if not isinstance(action, Observe):
            return ActionResult(
                False, f"a recording cannot {type(action).__name__.lower()}; it can only observe"
            )
        self._steps += 1
        return ActionResult(True, steps=self._steps)
