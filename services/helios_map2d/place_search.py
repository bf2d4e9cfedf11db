"""Search for the place of a stored map in the present frame, in a thread of its own.

The stored map is of another world: the robot restarted, or somebody loaded a file. Every few
keyframes the present map is aligned with it. Once an alignment is confirmed, the present map takes
over what the stored one knows, and `RELOCALISATION` gives its place to the object map.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.codec import vector_from_proto, world_to_proto
from helios_core.errors import HeliosError
from helios_core.topics import OBJECTS, RELOCALISATION, STORED_OBJECTS
from helios_core.types import WorldId

from helios_map2d.epochs import EpochMaps, Sought
from helios_map2d.relocalisation.landmarks import Landmark
from helios_map2d.relocalisation.poses import Transform2
from helios_map2d.relocalisation.state import Fix, PlaceState
from helios_map2d.snapshots.snapshot import MapSnapshot

if TYPE_CHECKING:
    from helios_map2d.relocalisation.alignment import Alignment, StoredMap
    from helios_map2d.relocalisation.grid_fields import OccupancyGrid

log = logging.getLogger(__name__)

EVERY_KEYFRAMES = 3  # between two attempts
CLOSE_WITHIN_S = 1.0  # a running attempt is not waited for any longer
CALL_S = 2.0  # for the objects; without an answer the maps are aligned without landmarks


class PlaceSearch:
    """Thread and state of the search. `lock` guards the maps, and every attribute here."""

    def __init__(
        self,
        bus: Bus,
        lock: threading.RLock,
        maps: Callable[[], EpochMaps | None],
        done: Callable[[], None],
        say: Callable[[], None],
    ) -> None:
        """done: called once the present map has taken over the stored one. say: called when the
        result of `note` has changed."""
        self._bus, self._lock, self._maps = bus, lock, maps
        self._done, self._say = done, say
        self._sought: Sought | None = None
        self._stored: StoredMap | None = None  # prepared at the first attempt
        self._fix, self._last = Fix(), pb.Relocalisation()
        self._present: tuple[WorldId, str] | None = None  # world and id of the map of the fix
        self._new, self._attempts = 0, 0
        self._wake, self._idle, self._ending = (threading.Event() for _ in range(3))
        self._idle.set()
        self._thread = threading.Thread(target=self._run, name="relocalise", daemon=True)
        self._thread.start()

    # --- called with the lock held ------------------------------------------------------------
    def seek(self, sought: Sought | None) -> None:
        """Seek the place of a stored map from now on; None: of none."""
        self._sought, self._stored = sought, None
        self._fix, self._present = Fix(), None
        self._new, self._attempts = 0, 0
        self._last = pb.Relocalisation()
        if sought is not None:
            self._last.state = PlaceState.UNKNOWN
            self._last.stored.CopyFrom(world_to_proto(sought.world))

    def note_keyframe(self) -> None:
        """Count a keyframe; enough of them start an attempt."""
        if self._sought is None:
            return
        self._new += 1
        if self._new >= EVERY_KEYFRAMES:
            self._new = 0
            self._idle.clear()
            self._wake.set()

    @property
    def sought(self) -> Sought | None:
        """Stored map that is not yet relocalised."""
        return self._sought

    # --- called without the lock --------------------------------------------------------------
    def announce(self) -> None:
        """Publish the present state."""
        with self._lock:
            message = pb.Relocalisation()
            message.CopyFrom(self._last)
        self._bus.publish(RELOCALISATION, message)

    def note(self) -> str:
        """Health note; "" without a stored map."""
        last = self._last
        if self._sought is None:
            return ""
        if last.state == PlaceState.TENTATIVE:
            return "the place of a stored map was found once and waits for new views to confirm it"
        why = f": {last.reason}" if last.reason else ""
        return f"a stored map is not in use until the robot has found its place in it{why}"

    def settled(self, within_s: float) -> bool:
        """Wait for the end of an attempt that is due. Returns False after the time limit."""
        return self._idle.wait(within_s)

    def close(self) -> None:
        self._ending.set()
        self._wake.set()
        self._thread.join(CLOSE_WITHIN_S)

    def _run(self) -> None:
        while not self._ending.is_set():
            self._wake.wait()
            self._wake.clear()
            try:
                if not self._ending.is_set():
                    self.attempt()
            except Exception:  # the maps continue without the stored one
                log.exception("an attempt to relocalise failed")
            finally:
                with self._lock:
                    if not self._wake.is_set():  # else another attempt is due
                        self._idle.set()

    def attempt(self) -> None:
        """Align the present map with the stored one once, and act on the result."""
        from helios_map2d.relocalisation.alignment import align, prepared  # needs SciPy's FFT

        with self._lock:
            maps, sought = self._maps(), self._sought
            current = maps.current if maps is not None else None
            if maps is None or current is None or sought is None or maps.world is None:
                return
            present = maps.world, current.map_id
            published, stored = current.published, self._stored
        if sought.world == present[0]:
            return
        stored_marks, present_marks = self._landmarks(sought.world)
        if stored is None:
            stored = prepared(_grid(sought.map.published), stored_marks)
        if stored is None:
            return
        began = time.process_time()
        grid = _grid(published)
        found = align(stored, grid, present_marks)
        log.info("relocalisation: %s (%.2f s)", _said(found), time.process_time() - began)
        with self._lock:
            if self._sought is not sought or not self._is_present(present):
                return
            self._stored = stored
            before = self._fix if self._present == present else Fix()
            self._fix, self._present = (
                before.after(found, grid.known_m2, _robot_m(published)),
                present,
            )
            self._attempts += 1
            self._last = self._message(sought.world, present[0], found)
            relocalised = self._fix.state is PlaceState.RELOCALISED
            if relocalised:
                relocalised = self._take_over(sought)
        self.announce()
        if relocalised:
            self._done()
        self._say()

    def _take_over(self, sought: Sought) -> bool:
        """Add the stored map to the present one; False, with the reason, if that is refused."""
        maps, T = self._maps(), self._fix.T_stored_present
        assert maps is not None
        assert T is not None
        assert maps.current is not None
        try:
            maps.current.add_stored(sought.map, T.inverse)
        except HeliosError as error:
            self._fix = Fix()
            self._last.state, self._last.reason = PlaceState.UNKNOWN, error.message
            self._last.ClearField("T_present_stored")
            return False
        self._sought = self._stored = None
        return True

    def _is_present(self, present: tuple[WorldId, str]) -> bool:
        maps = self._maps()
        current = maps.current if maps is not None else None
        return maps is not None and current is not None and (maps.world, current.map_id) == present

    def _message(
        self, stored: WorldId, present: WorldId, found: Alignment | None
    ) -> pb.Relocalisation:
        out = pb.Relocalisation(
            state=self._fix.state,
            stored=world_to_proto(stored),
            present=world_to_proto(present),
            attempts=self._attempts,
            reason="the present map is too small" if found is None else found.reason,
        )
        if found is not None:
            fit = found.fit
            out.overlap_m, out.agreement = fit.overlap_m, fit.agreement
            out.contradiction, out.ratio = fit.contradiction, found.ratio
        if self._fix.T_stored_present is not None:
            T: Transform2 = self._fix.T_stored_present.inverse
            out.T_present_stored.CopyFrom(pb.Pose2(x_m=T.x_m, y_m=T.y_m, yaw_rad=T.yaw_rad))
        return out

    def _landmarks(self, world: WorldId) -> tuple[list[Landmark], list[Landmark]]:
        """Objects of the stored map and of the present one; none if the object map is silent."""
        try:
            stored = self._bus.call(STORED_OBJECTS, pb.Empty(), CALL_S)
            present = self._bus.call(OBJECTS, pb.ObjectsRequest(), CALL_S)
        except HeliosError as error:
            log.info("relocalisation goes on without objects: %s", error.message)
            return [], []
        theirs = stored.objects if stored.relocalisation.stored == world_to_proto(world) else ()
        return [_landmark(o) for o in theirs], [_landmark(o) for o in present.objects]


def _grid(published: MapSnapshot) -> OccupancyGrid:
    from helios_map2d.relocalisation.grid_fields import OccupancyGrid  # needs SciPy

    return OccupancyGrid(published.occupancy, published.grid.origin_m, published.grid.cell_m)


def _robot_m(published: MapSnapshot) -> np.ndarray:
    x_m, y_m, _ = published.robot_pose or (0.0, 0.0, 0.0)
    return np.array([x_m, y_m])


def _landmark(thing: pb.ObjectInstance) -> Landmark:
    x, y, z = vector_from_proto(thing.center_m).tolist()
    named = {name: p for name, p in thing.probabilities.items() if name != "other"}
    return Landmark((x, y, z), named)


def _said(found: Alignment | None) -> str:
    if found is None:
        return "the present map is too small"
    fit = found.fit
    return (
        f"{found.reason or 'passed'}; {fit.overlap_m:.1f} m compared, {fit.agreement:.0%} agree, "
        f"{fit.contradiction:.1%} contradict, objects {found.landmark_m:.1f} m, second best "
        f"{found.ratio:.0%}"
    )
