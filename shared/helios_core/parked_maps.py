"""Maps of worlds that the robot has left, kept in case it comes back, and the worlds that are over.

A world is what poses live in (`WorldId`). Each map service decides when a map is parked and when it
comes back; here is the record of both.
"""

from __future__ import annotations

from collections import deque
from typing import Generic, TypeVar

from helios_core.types import WorldId

MOST_PARKED = 2
MOST_REMEMBERED = 256  # worlds that are over; of most of them the map is gone

Map = TypeVar("Map")


class ParkedMaps(Generic[Map]):
    """The newest few, oldest first."""

    def __init__(self, most: int = MOST_PARKED) -> None:
        self._maps: deque[tuple[WorldId, Map]] = deque(maxlen=most)
        self._over: deque[WorldId] = deque(maxlen=MOST_REMEMBERED)

    def park(self, world: WorldId, map: Map) -> None:
        """Keep the map of a world that is over now; the oldest one too many goes."""
        self._maps.append((world, map))
        self._over.append(world)

    def put(self, world: WorldId, map: Map) -> None:
        """Keep a map in place of one of the same world; whether that is over stays as it is."""
        self._remove(world)
        self._maps.append((world, map))

    def take_back(self, world: WorldId) -> Map | None:
        """The map of a world that is over no more; None where it was not kept."""
        if world in self._over:
            self._over.remove(world)
        map = self.by_world().get(world)
        self._remove(world)
        return map

    def is_over(self, world: WorldId) -> bool:
        """Whether a world was left, and the robot has not come back to it."""
        return world in self._over

    def world_of(self, map: Map) -> WorldId | None:
        """The world of a parked map; None for one that is not parked."""
        return next((world for world, parked in self._maps if parked is map), None)

    def by_world(self) -> dict[WorldId, Map]:
        """Oldest first; of several maps of one world the oldest."""
        first: dict[WorldId, Map] = {}
        for world, map in self._maps:
            first.setdefault(world, map)
        return first

    def clear(self) -> None:
        """Forget the maps; the worlds that are over stay so."""
        self._maps.clear()

    def _remove(self, world: WorldId) -> None:
        rest = [(w, map) for w, map in self._maps if w != world]
        self._maps.clear()
        self._maps.extend(rest)
