"""The object map in use, and the maps that came from files: which one is used in which world."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

from helios_core import map_autosave
from helios_core import proto as pb
from helios_core.map_autosave import SavedMap
from helios_core.types import Frame, FrameId, WorldId
from numpy.typing import NDArray

from helios_objectmap import persistence
from helios_objectmap.epochs import EpochMaps
from helios_objectmap.object_map import ObjectMap
from helios_objectmap.object_messages import content_in_words
from helios_objectmap.settings import ObjectMapSettings
from helios_objectmap.stored_objects import StoredObjects

LOST_LABELS = 1_000  # exceeds the number of new instances between a write and the next


@dataclass(frozen=True)
class _Restored:
    """Map of an earlier process, until it changes."""

    map: ObjectMap
    written: str  # local time of writing
    content: str  # in words


class WorldMaps:
    """Current object map, parked maps of former worlds, and stored map files.

    A map file names the world that its coordinates belong to. In that world the map is used as it
    is. In another world it is stored, and it is used once map2d has found its place there. A map
    that is read before the robot has reported its world is used at once. If the robot then reports
    another world, the map is stored. A process that crashed gave ids to instances that its map file
    lacks. No instance of a restored map gets such an id. Not thread-safe: the owner locks.
    """

    def __init__(self, settings: ObjectMapSettings, stored: StoredObjects) -> None:
        self._maps, self._stored = EpochMaps(settings), stored
        self._restored: _Restored | None = None
        self._file: bytes | None = None  # of the current map, until the robot reports its world
        self._saved = b""  # digest of the newest file that a client got

    @property
    def current(self) -> ObjectMap:
        """Map of the present world."""
        return self._maps.current

    @property
    def newest(self) -> FrameId | None:
        """Newest frame in the current map."""
        return self._maps.newest

    # The robot's world ------------------------------------------------------------------------
    def robot_is_in(self, world: WorldId, boot_id: str) -> tuple[bool, bool]:
        """Note the world that the robot reports.

        Returns whether this parked a map of another world, and whether the current map is
        another one than before.
        """
        parked = self._maps.set_robot_world(world, boot_id)
        return parked, self._settle() or parked

    def map_for(self, frame: Frame) -> ObjectMap:
        """Map of a frame's world. Raises Conflict for a former world or start of the robot."""
        self._maps.map_for(frame)
        self._settle()
        return self.current

    def note_update(self, frame: FrameId) -> None:
        """Note the frame that has just been integrated into the current map."""
        newest = self._maps.newest
        if newest is None or newest.epoch != frame.epoch or frame.seq > newest.seq:
            self._maps.newest = frame

    # Files ------------------------------------------------------------------------------------
    def load(
        self, found: persistence.LoadedMap, data: bytes, same_frame: bool
    ) -> pb.ObjectMapLoaded:
        """Replace the current map with that of a file, or store it if it is of another world.

        found, data: the map that was read, and its file. same_frame: its coordinates are those of
        the present world. Raises InvalidInput; then nothing has changed. A client that got the
        current map as a file may load that file again, which undoes its loads since then: the maps
        that were stored before them are stored again.
        """
        present = self._maps.confirmed
        elsewhere = found.world not in (None, present) and not same_frame
        if elsewhere and present is not None:
            return self._stored.replace(found, data)
        self._maps.use_anywhere()
        self._use(found, data if elsewhere else None)
        self._restored = None
        if _digest(data) != self._saved or not self._stored.bring_back():
            self._stored.drop()
        return pb.ObjectMapLoaded(gaussians=len(self.current), objects=len(self.current.objects()))

    def restore(self, saved: SavedMap) -> None:
        """Use the map file of an earlier process. Raises InvalidInput."""
        found = persistence.read(saved.data, self.current.empty_viewpoints())
        found.content.registry.next_label += LOST_LABELS
        self._use(found, saved.data)
        objects, gaussians = len(self.current.objects()), len(self.current)
        content = content_in_words(objects, gaussians, self.newest)
        self._restored = _Restored(self.current, saved.written, content)

    def arrays(self) -> dict[str, NDArray]:
        """Content of a map file: the current map, its world and its newest frame."""
        world = self._maps.world or self._maps.robot_world
        return persistence.arrays_of(self.current.content(), world, self.newest)

    def note_saved(self, data: bytes) -> None:
        """Note that a client got the current map as a file."""
        self._saved = _digest(data)
        self._stored.forget_dropped()

    def take_over_stored(self) -> bool:
        """Add the stored map to the current one if it is relocalised; True if it was.

        Its file stays until `tidy`, which is for the time after the next save.
        """
        return self._stored.take_over(self.current, self._maps.world) is not None

    def forget(self) -> None:
        """Delete every map, the parked and the stored ones included."""
        self._maps.forget()
        self._stored.drop()
        self._restored = self._file = None

    # What there is to say ---------------------------------------------------------------------
    def restored_note(self) -> str:
        """What became of the map of an earlier process; "" without one, or once it has changed."""
        restored = self._restored
        if restored is None:
            return ""
        if self.current is restored.map:
            written, content = restored.written, restored.content
            return f"the map was restored as it was written at {written}: {content}"
        return map_autosave.of_another_world(restored.written)

    def drop_restored_note(self) -> bool:
        """Drop that note, because the map has changed. Returns True if there was one."""
        was, self._restored = self._restored, None
        return was is not None

    # Parts ------------------------------------------------------------------------------------
    def _use(self, found: persistence.LoadedMap, data: bytes | None) -> None:
        """Replace the content of the current map with that of a file.

        data: the file, if the map may be used in its own world only; else None.
        """
        self.current.load_content(found.content)
        if data is not None and self._maps.world is None:
            self._maps.restored(found.world, found.newest)
        self._file = data if found.world is not None else None

    def _settle(self) -> bool:
        """Store the current map if its file is of another world, and use a stored map of this one.

        Returns True if a stored map is used.
        """
        file, self._file = self._file, None
        if file is not None and persistence.world_of(file) != self._maps.world:
            self._stored.store(file)
        world = self._maps.confirmed
        if world is None or (len(self.current) and self._restored is None):
            return False
        if self._maps.world not in (None, world):  # the current map is still of another world
            return False
        own = self._stored.take(world)
        if own is None or len(self.current):  # a map that was saved later contains it
            return False
        own.registry.next_label += LOST_LABELS
        self.current.load_content(own)
        return True


def _digest(data: bytes) -> bytes:
    return hashlib.sha256(data).digest()
