"""Stored object map of another world: its objects, and its way into the present map."""

from __future__ import annotations

import logging

from helios_core import proto as pb
from helios_core.codec import object_to_proto, world_from_proto, world_to_proto
from helios_core.errors import InvalidInput
from helios_core.geometry import se2_to_se3
from helios_core.stored_map_file import StoredMapFile
from helios_core.types import WorldId

from helios_objectmap import persistence
from helios_objectmap.object_map import ObjectMap
from helios_objectmap.persistence import LoadedMap
from helios_objectmap.settings import ObjectMapSettings

log = logging.getLogger(__name__)

UNKNOWN, RELOCALISED = "unknown", "relocalised"


class StoredObjects:
    """The stored map, if any. Not thread-safe: the owner locks."""

    def __init__(self, settings: ObjectMapSettings, file: StoredMapFile) -> None:
        self._settings, self._file = settings, file
        self._map: ObjectMap | None = None
        self._world: WorldId | None = None
        self._place = pb.Relocalisation()  # newest message of map2d
        try:
            data = file.read()
            if data is not None:
                self._hold(persistence.read(data, ObjectMap(settings).empty_viewpoints()))
        except InvalidInput as error:
            log.error("the stored objects were refused and are removed: %s", error.message)
            file.remove()
        except OSError as error:
            log.error("the stored objects cannot be read: %s", error)

    @property
    def waits(self) -> bool:
        """True while there is a stored map that is not relocalised."""
        return self._map is not None

    def store(self, data: bytes) -> tuple[int, int]:
        """Store a map file in place of the former one. Returns the numbers of its Gaussians and
        objects. Raises InvalidInput."""
        self._hold(persistence.read(data, ObjectMap(self._settings).empty_viewpoints()))
        self._file.write(data)
        assert self._map is not None
        return len(self._map), len(self._map.objects())

    def drop(self) -> None:
        """Forget the stored map, also on the disk."""
        self._map = self._world = None
        self._file.remove()

    def note_place(self, place: pb.Relocalisation) -> None:
        """Note the newest message of map2d."""
        self._place = place

    def take_over(self, present: ObjectMap, world: WorldId | None) -> int | None:
        """Add the stored map to the present one, if it is relocalised in this world.

        Returns the number of Gaussians added, or None if nothing was done. The file stays until
        `drop`.
        """
        place = self._place
        if self._map is None or place.state != RELOCALISED or not self._is_of(place):
            return None
        if world is None or world_from_proto(place.present) != world:
            return None
        T = place.T_present_stored
        added = present.add_stored(self._map.content(), se2_to_se3(T.x_m, T.y_m, T.yaw_rad))
        self._map = self._world = None
        log.info("relocalised: %d Gaussians of the stored map are in use", added)
        return added

    def described(self) -> pb.StoredObjectsReply:
        """Objects in the frame of the stored map, and what is known of its place."""
        reply = pb.StoredObjectsReply()
        if self._map is None or self._world is None:
            return reply
        if self._is_of(self._place) and self._place.state != RELOCALISED:
            reply.relocalisation.CopyFrom(self._place)
        else:
            reply.relocalisation.state = UNKNOWN
            reply.relocalisation.stored.CopyFrom(world_to_proto(self._world))
        reply.objects.extend(object_to_proto(o) for o in self._map.objects())
        return reply

    def _is_of(self, place: pb.Relocalisation) -> bool:
        return self._world is not None and world_from_proto(place.stored) == self._world

    def _hold(self, found: LoadedMap) -> None:
        if found.world is None:
            raise InvalidInput("the map file names no world: load it with --same-frame")
        self._map = ObjectMap(self._settings)
        self._map.load_content(found.content)
        self._world = found.world
