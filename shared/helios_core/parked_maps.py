"""Storage of the maps of worlds that the robot has left, and a list of those worlds.

`WorldId` identifies a world. Each map service decides when to park a map and when to take it back.
"""

from __future__ import annotations

from collections import deque
from typing import Generic, TypeVar

from helios_core.types import WorldId

MOST_PARKED = 2
MOST_REMEMBERED = 256  # worlds marked as over; most of their maps are no longer stored

Map = TypeVar("Map")


class ParkedMaps(Generic[Map]):
    """The newest few parked maps, oldest first, and the worlds that are over."""

    def __init__(self, most: int = MOST_PARKED) -> None:
        self._maps: deque[tuple[WorldId, Map]] = deque(maxlen=most)
        self._over: deque[WorldId] = deque(maxlen=MOST_REMEMBERED)

    def park(self, world: WorldId, map: Map) -> None:
        """Store the map of a world and mark the world as over; drop the oldest map beyond the
        limit."""
        self._maps.append((world, map))
        self._over.append(world)

    def put(self, world: WorldId, map: Map) -> None:
        """Store a map in place of one of the same world; the world's mark does not change."""
        self._remove(world)
        self._maps.append((world, map))

    def take_back(self, world: WorldId) -> Map | None:
        """Take a world's map out of the store and clear the world's mark; None without a map."""
        if world in self._over:
            self._over.remove(world)
        map = self.by_world().get(world)
        self._remove(world)
        return map

    def is_over(self, world: WorldId) -> bool:
        """True if the robot left the world and has not returned to it."""
        return world in self._over

    def world_of(self, map: Map) -> WorldId | None:
        """World of a parked map; None if the map is not parked."""
        return next((world for world, parked in self._maps if parked is map), None)

    def by_world(self) -> dict[WorldId, Map]:
        """Parked maps by world, oldest first; the oldest map of each world."""
        first: dict[WorldId, Map] = {}
        for world, map in self._maps:
            first.setdefault(world, map)
        return first

    def clear(self) -> None:
        """Drop all maps; the marks of worlds that are over stay."""
        self._maps.clear()

    def _remove(self, world: WorldId) -> None:
        rest = [(w, map) for w, map in self._maps if w != world]
        self._maps.clear()
        self._maps.extend(rest)
