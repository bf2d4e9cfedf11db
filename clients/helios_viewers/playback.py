"""Playback of a recording in real time: pace, pause and seek, in one thread."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from helios_core.viewing.entry import Entry

from helios_viewers.recorded_source import RecordedSource

REPORT_PERIOD_S = 0.05  # between two reports of the time


@dataclass(frozen=True)
class PlayerState:
    """State of the playback."""

    time_ns: int
    playing: bool
    ended: bool
    speed: float
    sought: bool = False  # the time jumped


class Player:
    """Playback of one recording. `control` is thread-safe; `run` shows the entries."""

    def __init__(
        self,
        source: RecordedSource,
        show: Callable[[int, Entry], None],  # log time (ns) and entry
        report: Callable[[PlayerState], None],
        speed: float = 1.0,  # 1: as recorded
    ) -> None:
        self._source, self._show, self._report = source, show, report
        self._changed = threading.Condition()
        self._next = 0  # index of the next entry
        self._playing, self._speed = True, speed
        self._sought = False
        self._anchor = (source.range_ns[0], time.monotonic())  # log time shown at that clock time

    def control(self, playing: bool, speed: float, time_ns: int | None) -> PlayerState:
        """Play or pause, set the speed (invalid ones are ignored), and jump to a time (ns)."""
        with self._changed:
            now_ns = self._now_ns() if time_ns is None else time_ns
            begin_ns, end_ns = self._source.range_ns
            self._anchor = (min(max(now_ns, begin_ns), end_ns), time.monotonic())
            self._playing = playing
            if 0 < speed < float("inf"):
                self._speed = speed
            if time_ns is not None:
                self._sought = True
                self._next = self._source.first_from(self._anchor[0])
            state = self._state()
            self._changed.notify()
        return state

    def run(self, stopping: threading.Event) -> None:
        """Show each entry at its time until `stopping` is set. At the end it waits for a jump."""
        with self._changed:  # the time until now does not count
            self._anchor = (self._anchor[0], time.monotonic())
        while not stopping.is_set():
            with self._changed:
                due, sought, state = self._due(), self._sought, self._state()
                self._sought = False
                self._next = max(self._next, due.stop)
            if sought:
                for index in self._source.newest_before(due.start):
                    self._show_at(index)
            for index in due:
                if stopping.is_set():
                    return
                self._show_at(index)
            self._report(state)
            with self._changed:
                if not self._sought:
                    self._changed.wait(REPORT_PERIOD_S)

    def _show_at(self, index: int) -> None:
        entry = self._source.read(index)
        if entry is not None:
            self._show(self._source.entries[index].log_time_ns, entry)

    def _due(self) -> range:
        return range(self._next, max(self._next, self._source.first_from(self._now_ns() + 1)))

    def _now_ns(self) -> int:
        shown_ns, clock_s = self._anchor
        if self._playing:
            shown_ns += round((time.monotonic() - clock_s) * self._speed * 1e9)
        return min(shown_ns, self._source.range_ns[1])

    def _state(self) -> PlayerState:
        ended = self._next >= len(self._source.entries)
        now_ns = self._now_ns()
        return PlayerState(now_ns, self._playing and not ended, ended, self._speed, self._sought)
