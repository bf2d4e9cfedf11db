"""Polling of the maps: requests their content after each change, and records the reply.

One thread makes one call at a time, each with a deadline, and at most one round per period; it
polls the Gaussians, which are large, every `GAUSSIANS_PERIOD_S` at most. Missing replies are
counted; a map that is not running harms nothing.
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
from helios_core.map_snapshot import decode_snapshot
from helios_core.topics import GAUSSIANS, OBJECTS, SNAPSHOT, Method
from helios_core.viewing.entry import Entry
from helios_core.viewing.gaussian_cloud import gaussian_entry
from helios_core.viewing.map_entries import map_entries, object_entry

log = logging.getLogger(__name__)

MISSED = "missed_maps"  # name of the counter of requests without a reply
ANSWER_WITHIN_S = 2.0  # longest wait for a map; a missing answer is counted
CLOSE_WITHIN_S = 0.2
GAUSSIANS_PERIOD_S = 5.0
LONGEST_PAUSE_S = 30.0  # between requests to a map that does not reply

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
        self._period_s, self._within_s = period_s, ANSWER_WITHIN_S
        self._gaussians_s = -GAUSSIANS_PERIOD_S  # time of their last poll
        self._lock = threading.Lock()
        self._putting = threading.Lock()  # held while an entry is put, so that none follows `close`
        self._news = {"map2d": False, "objectmap": False, "gaussians": False}  # True: to be polled
        self._wake, self._ending = threading.Event(), threading.Event()
        self._map_version = self._object_version = 0
        self._layers: frozenset[str] = frozenset()
        self._thread = threading.Thread(target=self._run, name="watch maps", daemon=True)
        self._thread.start()

    def notify_changed(self, service: str) -> None:
        """Note that a map has changed: "map2d" or "objectmap". Never blocks."""
        with self._lock:
            self._news[service] = True
        self._wake.set()

    def close(self) -> None:
        """Stop the polling; no entry follows."""
        with self._putting:
            self._ending.set()
        self._wake.set()
        self._thread.join(CLOSE_WITHIN_S)

    def _run(self) -> None:
        asks = {
            "map2d": self._ask_map2d, "objectmap": self._ask_objects,
            "gaussians": self._ask_gaussians,
        }  # fmt: skip
        for name in ("map2d", "objectmap"):
            asks[name](owed=False)
        pause_s = self._period_s
        while not self._ending.wait(pause_s):
            self._wake.wait()
            if self._ending.is_set():
                return
            with self._lock:
                self._wake.clear()
                owed = {name for name, new in self._news.items() if new}
                self._news = dict.fromkeys(self._news, False)
            if "gaussians" in owed and time.monotonic() - self._gaussians_s < GAUSSIANS_PERIOD_S:
                owed.discard("gaussians")
                self.notify_changed("gaussians")
            missed = [name for name in owed if not asks[name](owed=True)]
            for name in missed:  # poll it again
                self.notify_changed(name)
            pause_s = min(2 * pause_s, LONGEST_PAUSE_S) if missed else self._period_s

    def _ask_map2d(self, owed: bool) -> bool:
        """Poll the 2D map. True if it replied."""
        request = pb.SnapshotRequest(layers=True, if_newer=self._map_version)
        snapshot = self._answer(SNAPSHOT, request, owed)
        if snapshot is None:
            return False
        if snapshot.unchanged or not snapshot.cell_m > 0:
            return True
        self._map_version = snapshot.version
        self._tell(SNAPSHOT.name, lambda stamp_ns: self._entries_of(snapshot, stamp_ns))
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
        self._gaussians_s = time.monotonic()
        if reply is not None:
            self._tell(GAUSSIANS.name, lambda stamp_ns: [gaussian_entry(reply, stamp_ns)])
        return reply is not None

    def _entries_of(self, snapshot: pb.MapSnapshot, stamp_ns: int) -> list[Entry]:
        view = decode_snapshot(snapshot)
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
