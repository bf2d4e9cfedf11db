"""Saving and loading of maps, and automatic recovery of the present map after a crash."""

from __future__ import annotations

import contextlib
import logging
import threading
from collections.abc import Callable
from pathlib import PurePosixPath

from helios_core import proto as pb
from helios_core.codec import frame_id_to_proto
from helios_core.errors import InvalidInput, Unavailable
from helios_core.map_autosave import AutosavedFile, SavedMap, WriteOutcome, of_another_world
from helios_core.map_snapshot import OCCUPIED, UNKNOWN
from helios_core.printable_text import counted
from helios_core.stored_map_file import StoredMapFile
from helios_core.types import WorldId

from helios_map2d.epoch_map import EpochMap
from helios_map2d.epochs import EpochMaps, Sought
from helios_map2d.files.map_file import FILE_NAME, decode_map, encode_map, map_from_content
from helios_map2d.files.npz_and_ros import decode_exported, decode_ros, encode_ros
from helios_map2d.map_queries import DEFAULT_PICTURE_PX, known, published_of
from helios_map2d.pictures.map_picture import OCCUPANCY, png_of, render
from helios_map2d.settings import Settings
from helios_map2d.snapshots.snapshot import MapSnapshot, encode_npz

log = logging.getLogger(__name__)

FORMATS = "map, npz, ros or png"
ENOUGH_M2 = 15.0  # known area with which a robot would have found its place in a stored map
LOST_VERSIONS = 10_000  # exceeds the possible number of versions between last write and crash


class MapFiles:
    """Files of the present map, and the health notes about them."""

    def __init__(
        self,
        settings: Settings,
        lock: threading.RLock,
        maps: Callable[[], EpochMaps | None],
        say: Callable[[], None],
    ) -> None:
        """say: called when the result of `health_note` has changed."""
        self._trouble = ""  # problem with saving the map
        self._refused = ""  # why the saved map was refused; reported until the process ends
        self._restored: tuple[EpochMap, str, str] | None = None  # map, time of saving, content
        self._logged = ""  # note already in the log
        self._lock, self._maps, self._say = lock, maps, say
        self._kept: AutosavedFile | None = None
        if settings.state_dir is not None:
            path = settings.state_dir / FILE_NAME
            self._kept = AutosavedFile(path, settings.keep_period_s, self._newer, self._troubled)
        state_dir = settings.state_dir
        self._stored = StoredMapFile(None if state_dir is None else state_dir / FILE_NAME)
        self._found: bytes | None = None  # file of the map in `_restored`

    def health_note(self) -> str:
        """Health note: a problem with saving, and the fate of the saved map until another map
        supersedes it. "" if there is none."""
        fate = self._fate()
        if fate and fate != self._logged:
            self._logged = fate
            log.info("%s", fate)
        return "; ".join(part for part in (self._trouble, fate) if part)

    def note_map_change(self, searching: bool) -> bool:
        """Note a change of the present map, which then differs from the saved one.

        Returns True if the result of `health_note` has changed.
        The note about a saved map of another world stays until an image for a search is fused
        (searching), as in the object map.
        """
        maps, restored = self._maps(), self._restored
        if maps is None or restored is None or not (searching or maps.current is restored[0]):
            return False
        self.health_note()  # writes the log
        self._restored = None
        return True

    def recover(self, maps: EpochMaps) -> None:
        """Park the saved map until the robot reports its world, and start saving.

        An unusable file is renamed and reported. The caller holds the lock.
        """
        if self._kept is None:
            return
        try:
            found = self._kept.found()
            if found is not None:
                self._restore(found, maps)
        except OSError as error:
            self._refuse(f"the kept map cannot be read and was {self._kept.put_aside()}: {error}")
        except InvalidInput as error:
            aside = self._kept.put_aside()
            self._refuse(f"the kept map was refused and {aside}: {error.message}")
        self._kept.start()

    def stored(self, maps: EpochMaps) -> tuple[EpochMap, WorldId] | None:
        """Map and world of the stored file, whose place the robot has yet to find; None without
        one. An unusable file is removed. The caller holds the lock."""
        try:
            data = self._stored.read()
            if data is None:
                return None
            return decode_map(data, maps.rules, maps.footprint_radius_m, maps.version)
        except OSError as error:
            log.error("the stored map cannot be read: %s", error)
        except InvalidInput as error:
            log.error("the stored map was refused and is removed: %s", error.message)
            self._stored.remove()
        return None

    def take_up_stored(self) -> bool:
        """Go on with the stored map if the robot is in its world; its file stays until
        `taken_over`. Returns True if it goes on. The caller holds the lock."""
        maps = self._maps()
        if maps is None or maps.robot_world is None:
            return False
        found = self.stored(maps)
        if found is None or found[1] != maps.robot_world:
            return False
        if maps.current is not None and maps.world == maps.robot_world:
            return False  # newer
        maps.keep(found[1], found[0])
        return True

    def left_behind(self) -> tuple[EpochMap, WorldId] | None:
        """Map and world of an earlier process's map that is of another world than the robot's, at
        the first call. It becomes the stored map, unless it is small and there is one already: then
        the earlier process ended before it found its place. The caller holds the lock."""
        maps, restored, found = self._maps(), self._restored, self._found
        if maps is None or restored is None or found is None:
            return None
        if not maps.is_of_another_world(restored[0]):
            return None
        self._found = None
        if areas_m2(restored[0].published)[0] < ENOUGH_M2 and self._stored.exists:
            return None
        self._stored.put(found)
        return decode_map(found, maps.rules, maps.footprint_radius_m, maps.version)

    def taken_over(self) -> None:
        """Write the present map, which has taken over the stored one, and remove that one."""
        if self._kept is None or self._kept.write() is not WriteOutcome.FAILED:
            self._stored.remove()

    def _restore(self, found: SavedMap, maps: EpochMaps) -> None:
        state, world = decode_map(found.data, maps.rules, maps.footprint_radius_m, maps.version)
        state.publish_above(state.version + LOST_VERSIONS)
        newest = "" if state.frame_id is None else f", frames up to number {state.frame_id.seq}"
        known_m2 = areas_m2(state.published)[0]
        content = f"{known_m2:.0f} m² known, {counted(len(state.memory), 'view')}{newest}"
        self._restored, self._found = (state, found.written, content), found.data
        log.info(
            "a map was kept at %s: %s; it goes on when the robot is in %s",
            found.written,
            content,
            world,
        )
        maps.keep(world, state)

    def _fate(self) -> str:
        """Note on the fate of the map that an earlier process saved; "" if there is none."""
        maps, restored = self._maps(), self._restored
        if maps is None or restored is None:
            return ""
        state, written, content = restored
        if maps.current is state:
            return f"the map was restored as it was written at {written}: {content}"
        return of_another_world(written) if maps.is_of_another_world(state) else ""

    def forget(self) -> None:
        """Remove the saved map and the stored one."""
        self._restored = self._found = None
        self._stored.remove()
        if self._kept is not None:
            self._kept.forget()

    def save(self, request: pb.SaveMap2DRequest) -> pb.SaveMap2DReply:
        """Present map as files. Raises Unavailable while there is none."""
        published = known(self._maps())
        kind = request.format or "map"
        if kind == "map":
            published, data = self._file()
            files = {FILE_NAME: data}
        elif kind == "npz":
            files = {"map2d.npz": encode_npz(published)}
        elif kind == "ros":
            files = encode_ros(published)
        elif kind == "png":
            size_px = request.size_px or DEFAULT_PICTURE_PX
            pixels = render(published, request.layer or OCCUPANCY, size_px)
            files = {"map2d.png": png_of(pixels, published)}
        else:
            raise InvalidInput(f"no format is called {kind[:40]!r}; ask for {FORMATS}")
        reply = pb.SaveMap2DReply(
            files=[pb.Map2DFile(name=name, data=data) for name, data in files.items()],
            version=published.version,
            map_id=published.map_id,
        )
        if published.frame_id is not None:
            reply.id.CopyFrom(frame_id_to_proto(published.frame_id))
        return reply

    def load(
        self, request: pb.LoadMap2DRequest, seek: Callable[[Sought | None], None]
    ) -> pb.LoadMap2DReply:
        """Replace the present map by one from files, or store it if it is of another world.

        A map file names its world. In the robot's present world, or with `same_frame`, its map
        replaces the present one. Otherwise `seek` gets it, and the present map stays. Raises
        InvalidInput for unusable files, Unavailable before the robot's description arrives,
        Conflict before its state arrives.
        """
        maps = self._maps()
        if maps is None:
            raise Unavailable("the robot has not described itself; start its bridge")
        state, world = loaded(request, maps)
        with self._lock:
            if self._maps() is not maps:
                raise Unavailable("the maps were reset meanwhile; load again")
            present = maps.robot_world or maps.world
            stored = not (request.same_frame or world in (None, present))
            if stored and world is not None:
                self._stored.put(request.files[0].data)
                seek(Sought(state, world))
            else:
                maps.replace(state)
                self._stored.remove()
                seek(None)
            self._restored = self._found = None
            published = state.published
            views = len(state.memory)
        try:
            self._stored.write()
        except OSError as error:  # the next save tries again, and the health tells if that fails
            log.error("the stored map cannot be written: %s", error)
        known_m2, occupied_m2 = areas_m2(published)
        return pb.LoadMap2DReply(
            version=published.version,
            known_m2=known_m2,
            occupied_m2=occupied_m2,
            views=views,
            stored=stored,
        )

    def close(self) -> None:
        """Save the map a last time."""
        if self._kept is not None:
            self._kept.close()

    def _file(self) -> tuple[MapSnapshot, bytes]:
        """The present map and its file. Raises Unavailable while there is none."""
        with self._lock:
            maps = self._maps()
            published = known(maps)
            current = maps.current if maps is not None else None
            views = current.memory.snapshot() if current is not None else ()
            world = maps.world if maps is not None else None
        return published, encode_map(published, views, world)

    def _refuse(self, reason: str) -> None:
        self._refused = self._trouble = reason
        log.warning("%s", reason)

    def _newer(self, kept_version: int) -> tuple[int, bytes] | None:
        published = published_of(self._maps())
        newer = None
        changed = published is not None and published.version != kept_version
        if (changed or self._stored.unwritten) and not (published is None or published.empty):
            with contextlib.suppress(Unavailable):  # the map was reset meanwhile
                written, data = self._file()
                newer = written.version, data
        self._stored.write()
        return newer

    def _troubled(self, reason: str) -> None:
        reason = reason or self._refused
        if reason != self._trouble:
            self._trouble = reason
            self._say()


def areas_m2(published: MapSnapshot) -> tuple[float, float]:
    """Area of the known ground, and area of the occupied part of it."""
    cell_m2 = published.grid.cell_m**2
    known_cells = int((published.occupancy != UNKNOWN).sum())
    return known_cells * cell_m2, int((published.occupancy == OCCUPIED).sum()) * cell_m2


def loaded(request: pb.LoadMap2DRequest, maps: EpochMaps) -> tuple[EpochMap, WorldId | None]:
    """Map of some files, and its world if they name it. Raises InvalidInput if they are
    unusable."""
    by_ending = {PurePosixPath(f.name).suffix.lower(): f.data for f in request.files}
    if len(by_ending) < len(request.files):
        raise InvalidInput(
            f"{len(request.files)} files came, some of one kind: send one map at a time"
        )
    rules, version = maps.rules, maps.version
    if set(by_ending) == {".map"}:
        state, world = decode_map(by_ending[".map"], rules, maps.footprint_radius_m, version)
        return state, world if world != WorldId("", 0) else None
    if set(by_ending) == {".npz"}:
        content = decode_exported(by_ending[".npz"], rules.cell_m, version)
    elif ".yaml" in by_ending and len(by_ending) == 2:
        (picture,) = (data for ending, data in by_ending.items() if ending != ".yaml")
        content = decode_ros(by_ending[".yaml"], picture, rules, version)
    else:
        raise InvalidInput(
            f"cannot load {', '.join(sorted(f.name[:80] for f in request.files)) or 'nothing'}: "
            "send one .map, one .npz, or a .yaml and the picture it names"
        )
    return map_from_content(content, rules, maps.footprint_radius_m, version), None
