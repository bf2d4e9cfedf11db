"""Polling of the maps: requests their content after each change, and records the reply.

One thread makes one call at a time, each with a deadline, and polls each map at most once per
period; it polls the Gaussians, which are large, every `GAUSSIANS_PERIOD_S` at most. Missing replies
are counted. A map that does not reply is polled less and less often; each try delays the other maps
by the deadline of its call at most.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from typing import TypeVar

from google.protobuf.message import Message

from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.errors import HeliosError
from helios_core.map_snapshot import MapView, decode_snapshot
from helios_core.topics import GAUSSIANS, OBJECTS, SNAPSHOT, Method
from helios_core.viewing.entry import Entry
from helios_core.viewing.gaussian_cloud import gaussian_entry
from helios_core.viewing.map_entries import map_entries, object_entry
from helios_core.viewing.newest_map import blank_map, is_empty, newest_snapshot
from helios_core.viewing.poll_times import PollTimes

log = logging.getLogger(__name__)

MISSED = "missed_maps"  # name of the counter of requests without a reply
ANSWER_WITHIN_S = 2.0  # longest wait for a map; a missing answer is counted
CLOSE_WITHIN_S = 0.2
GAUSSIANS_PERIOD_S = 5.0

Req = TypeVar("Req", bound=Message)
Rep = TypeVar("Rep", bound=Message)


class MapPoller:
    """Poller of both maps: see the module. `put` takes each entry; it must not block."""

    def __init__(
        self,
        bus: Bus,
        period_s: float,
        put: Callable[[Entry], None],
        count: Callable[[str], None],
    ) -> None:
        """count: increments a named counter. Polls once at the start, for a robot that stands."""
        self._bus, self._put, self._count = bus, put, count
        self._within_s = ANSWER_WITHIN_S
        self._changed = threading.Condition()  # guards `_times`; notified of news and of the end
        self._times = PollTimes(
            {
                "map2d": period_s,
                "objectmap": period_s,
                "gaussians": max(period_s, GAUSSIANS_PERIOD_S),
            }
        )
        self._asks = {
            "map2d": self._ask_map2d,
            "objectmap": self._ask_objects,
            "gaussians": self._ask_gaussians,
        }
        self._putting = threading.Lock()  # held while an entry is put, so that none follows `close`
        self._ending = threading.Event()
        self._map_version, self._map_id = 0, ""
        self._object_version = 0
        self._layers: frozenset[str] = frozenset()
        self._blank: MapView | None = None  # takes the place of the recorded map once it is gone
        self._thread = threading.Thread(target=self._run, name="watch maps", daemon=True)
        self._thread.start()

    def notify_changed(self, service: str) -> None:
        """Note that a map has changed: "map2d" or "objectmap". Never blocks."""
        with self._changed:
            self._times.note_news(service)
            self._changed.notify()

    def close(self) -> None:
        """Stop the polling; no entry follows."""
        with self._putting:
            self._ending.set()
        with self._changed:
            self._changed.notify()
        self._thread.join(CLOSE_WITHIN_S)

    def _run(self) -> None:
        for name in ("map2d", "objectmap"):
            self._poll(name, owed=False)
        while (due := self._next()) is not None:
            self._poll(due, owed=True)

    def _next(self) -> str | None:
        """Wait until a map is due, and return its name; None once the polling ends."""
        with self._changed:
            while not self._ending.is_set():
                due, wait_s = self._times.next(), None
                if due is not None:
                    wait_s = due[1] - time.monotonic()
                    if wait_s <= 0:
                        self._times.begin(due[0])
                        return due[0]
                self._changed.wait(wait_s)
        return None

    def _poll(self, name: str, owed: bool) -> None:
        """Poll a map. owed: it has reported a change, so it is polled again if it does not reply.

        A missing reply then counts.
        """
        replied = self._asks[name](owed)
        with self._changed:
            self._times.end(name, replied, time.monotonic())
            if owed and not replied:
                self._times.note_news(name)

    def _ask_map2d(self, owed: bool) -> bool:
        """Poll the 2D map. True if it replied."""
        snapshot = newest_snapshot(
            lambda request: self._answer(SNAPSHOT, request, owed), self._map_version, self._map_id
        )
        if snapshot is None or snapshot.unchanged:
            return snapshot is not None
        self._map_version, self._map_id = snapshot.version, snapshot.map_id
        if not is_empty(snapshot):
            self._tell(SNAPSHOT.name, lambda stamp_ns: self._entries_of(snapshot, stamp_ns))
        elif self._blank is not None:
            blank, self._blank = self._blank, None
            self._tell(SNAPSHOT.name, lambda stamp_ns: self._drawn(blank, stamp_ns))
        return True

    def _ask_objects(self, owed: bool) -> bool:
        """Poll the object map. True if it replied."""
        reply = self._answer(OBJECTS, pb.ObjectsRequest(), owed)
        if reply is not None and reply.version != self._object_version:
            self._object_version = reply.version
            self._tell(OBJECTS.name, lambda stamp_ns: [object_entry(reply, stamp_ns)])
            self.notify_changed("gaussians")
        return reply is not None

    def _ask_gaussians(self, owed: bool) -> bool:
        """Poll the Gaussians of the object map. True if it replied."""
        reply = self._answer(GAUSSIANS, pb.GaussiansRequest(), owed)
        if reply is not None:
            self._tell(GAUSSIANS.name, lambda stamp_ns: [gaussian_entry(reply, stamp_ns)])
        return reply is not None

    def _entries_of(self, snapshot: pb.MapSnapshot, stamp_ns: int) -> list[Entry]:
        view = decode_snapshot(snapshot)
        entries = self._drawn(view, stamp_ns)
        self._blank = blank_map(view)
        return entries

    def _drawn(self, view: MapView, stamp_ns: int) -> list[Entry]:
        """Entries of a version; they clear the layers that only the version before had."""
        entries = list(map_entries(view, self._layers - view.values.keys(), stamp_ns))
        self._layers = frozenset(view.values)
        return entries

    def _answer(self, method: Method[Req, Rep], request: Req, owed: bool) -> Rep | None:
        """Reply of a map, or None. owed: the map reported a change, so a missing reply counts."""
        try:
            return self._bus.call(method, request, self._within_s)
        except HeliosError as error:
            if owed and not self._ending.is_set():
                self._count(MISSED)
                log.info("%s gave no answer: %s", method.name, error.message)
        return None

    def _tell(self, name: str, make: Callable[[int], list[Entry]]) -> None:
        """Put the entries made from a reply; an unreadable reply is counted."""
        try:
            entries = make(time.time_ns())
        except Exception as error:  # any malformed reply; the next one may be valid
            self._count("unrecordable_messages")
            log.warning("%s cannot be recorded (%s: %s)", name, type(error).__name__, error)
            return
        for entry in entries:
            with self._putting:
                if not self._ending.is_set():
                    self._put(entry)
