"""Stored object maps of other worlds: their objects, and their way into the present map."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
from helios_core import proto as pb
from helios_core.codec import object_to_proto, world_from_proto, world_to_proto
from helios_core.codec.frames import FARTHEST_M
from helios_core.errors import InvalidInput
from helios_core.geometry import se2_to_se3
from helios_core.stored_map_file import StoredMapFile
from helios_core.types import WorldId

from helios_objectmap import persistence
from helios_objectmap.object_map import ObjectMap
from helios_objectmap.persistence import LoadedMap, MapContent
from helios_objectmap.settings import ObjectMapSettings

log = logging.getLogger(__name__)

UNKNOWN, RELOCALISED = "unknown", "relocalised"  # of the states that map.proto lists


class StoredObjects:
    """At most two stored maps, the newest first; map2d decides whose place is sought.

    Not thread-safe: the owner locks.
    """

    def __init__(self, settings: ObjectMapSettings, map_file: Path | None) -> None:
        """map_file: file of the present map; None: nothing is written."""
        self._settings = settings
        self._files = StoredMapFile(map_file), StoredMapFile(map_file, "older")
        self._maps: dict[WorldId, ObjectMap] = {}
        self._dropped: dict[WorldId, ObjectMap] | None = None  # until `forget_dropped`
        self._failed: set[WorldId] = set()  # of the maps whose addition raised an exception
        self._place = pb.Relocalisation()  # newest message of map2d
        self.untidy = False  # True while the file of a map that was taken may still be there
        for file in self._files:
            self._read(file)

    @property
    def waits(self) -> bool:
        """True while there is a stored map that is not relocalised."""
        return bool(self._maps)

    @property
    def unwritten(self) -> bool:
        """True while a stored map is in memory alone; then call `write`."""
        return any(file.unwritten for file in self._files)

    def write(self) -> None:
        """Write the stored maps that are in memory alone. Call it without the lock, and before the
        present map is written, whose file may hold them until then. Raises OSError."""
        newest, older = self._files
        older.write()
        newest.write()

    def store(self, data: bytes) -> None:
        """Store a map file before the newest of the others. Raises InvalidInput."""
        self._put(self._decoded(data), data)

    def replace(self, found: LoadedMap, data: bytes) -> pb.ObjectMapLoaded:
        """Store a map file in place of all others; found: what it contains. Raises InvalidInput,
        and then nothing has changed."""
        world, stored = self._opened(found)
        self.drop()
        self._put((world, stored), data)
        objects = len(stored.objects())
        return pb.ObjectMapLoaded(gaussians=len(stored), objects=objects, stored=True)

    def drop(self) -> None:
        """Forget the stored maps, also on the disk. `bring_back` undoes it."""
        self._dropped, self._maps = self._maps, {}
        for file in self._files:
            file.remove()

    def forget_dropped(self) -> None:
        """End the time in which `bring_back` works."""
        self._dropped = None

    def bring_back(self) -> bool:
        """Store the maps that were there before the newest `drop`, and only these. Returns False
        after `forget_dropped`."""
        if self._dropped is None:
            return False
        maps = self._dropped
        self.drop()
        self._maps, self._dropped = maps, None
        for file, (world, stored) in zip(self._files, maps.items(), strict=False):
            file.put(persistence.to_bytes(persistence.arrays_of(stored.content(), world)))
        return True

    def take(self, world: WorldId) -> MapContent | None:
        """Content of the stored map of a world, which is no longer stored then; None without one.
        Its file stays until `tidy`."""
        stored = self._maps.pop(world, None)
        if stored is None:
            return None
        self.untidy = True
        return stored.content()

    def tidy(self) -> None:
        """Remove the files of maps that are no longer stored. Call it once the map that took them
        over is on the disk."""
        self.untidy = False
        for file in self._files:
            try:
                data = file.read()
            except OSError as error:
                log.error("stored objects cannot be read: %s", error)
                continue
            if data is not None and persistence.world_of(data) not in self._maps:
                file.remove()

    def note_place(self, place: pb.Relocalisation) -> None:
        """Note the newest message of map2d. A place that is not finite or too far away is left out,
        with a warning."""
        T = place.T_present_stored
        if not np.isfinite([T.x_m, T.y_m, T.yaw_rad]).all() or max(abs(T.x_m), abs(T.y_m)) > (
            FARTHEST_M
        ):
            log.warning(
                "map2d found the stored map at x %g m, y %g m, yaw %g rad; left out, as it must be "
                "within %g m",
                T.x_m,
                T.y_m,
                T.yaw_rad,
                FARTHEST_M,
            )
            return
        self._place = place

    def take_over(self, present: ObjectMap, world: WorldId | None) -> int | None:
        """Add the stored map to the present one, if it is relocalised in this world.

        Returns the number of Gaussians added, or None if nothing was done. The file stays until
        `tidy`. A map whose addition raised an exception is not tried again in this process.
        """
        place = self._place
        stored = self._maps.get(world_from_proto(place.stored))
        if world_from_proto(place.stored) in self._failed:
            return None
        if stored is None or place.state != RELOCALISED:
            return None
        if world is None or world_from_proto(place.present) != world:
            return None
        T = place.T_present_stored
        self._failed.add(world_from_proto(place.stored))  # a second try would add it twice
        added = present.add_stored(stored.content(), se2_to_se3(T.x_m, T.y_m, T.yaw_rad))
        self._maps, self._failed = {}, set()
        self.untidy = True
        log.info("relocalised: %d Gaussians of the stored map are in use", added)
        return added

    def described(self) -> pb.StoredObjectsReply:
        """Objects in the frame of the stored map, and what is known of its place."""
        reply = pb.StoredObjectsReply()
        if not self._maps:
            return reply
        sought = world_from_proto(self._place.stored)
        if sought in self._maps and self._place.state != RELOCALISED:
            reply.relocalisation.CopyFrom(self._place)
        else:
            sought = next(iter(self._maps)) if sought not in self._maps else sought
            reply.relocalisation.state = UNKNOWN
            reply.relocalisation.stored.CopyFrom(world_to_proto(sought))
        reply.objects.extend(object_to_proto(o) for o in self._maps[sought].objects())
        return reply

    def _put(self, new: tuple[WorldId, ObjectMap], data: bytes) -> None:
        """Store a map before the newest of the others. data: its file."""
        world, stored = new
        newest, older = self._files
        try:
            former = newest.read()
        except OSError:
            former = None
        if former is not None and persistence.world_of(former) != world:
            older.put(former)
        newest.put(data)
        others = [(w, m) for w, m in self._maps.items() if w != world]
        self._maps = dict([(world, stored), *others][:2])

    def _read(self, file: StoredMapFile) -> None:
        """Take up the map of an earlier process; an unusable file is removed."""
        try:
            data = file.read()
            if data is not None:
                world, stored = self._decoded(data)
                self._maps.setdefault(world, stored)
        except InvalidInput as error:
            log.error("stored objects were refused and are removed: %s", error.message)
            file.remove()
        except OSError as error:
            log.error("stored objects cannot be read: %s", error)

    def _decoded(self, data: bytes) -> tuple[WorldId, ObjectMap]:
        """World and map of a file. Raises InvalidInput."""
        return self._opened(persistence.read(data, ObjectMap(self._settings).empty_viewpoints()))

    def _opened(self, found: LoadedMap) -> tuple[WorldId, ObjectMap]:
        """World and map of what a file contains. Raises InvalidInput."""
        stored = ObjectMap(self._settings)
        if found.world is None:
            raise InvalidInput("the map file names no world: load it with --same-frame")
        stored.load_content(found.content)
        return found.world, stored
