"""The tiles of the newest version: what changed is made anew, the rest stays as it was."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType

from helios_map2d.grid import Box, Tile
from helios_map2d.layers.explored_area import SearchArea
from helios_map2d.layers.occupancy import OccupancyLayer
from helios_map2d.layers.value_layers import ValueLayers
from helios_map2d.snapshots.tiles import (
    Ground,
    GroundTile,
    Values,
    ValueTile,
    ground_tile,
    value_tile,
)


class PublishedTiles:
    """Ground by tile, and each value layer by tile."""

    def __init__(self) -> None:
        self._ground: dict[Tile, GroundTile] = {}
        self._values: dict[str, dict[Tile, ValueTile]] = {}

    @property
    def ground(self) -> Ground:
        """As it is now, for good."""
        return MappingProxyType(dict(self._ground))

    @property
    def layers(self) -> Mapping[str, Values]:
        """As they are now, for good."""
        return MappingProxyType(
            {name: MappingProxyType(dict(tiles)) for name, tiles in self._values.items()}
        )

    def retile(
        self,
        place: Tile,
        occupancy: OccupancyLayer,
        search: SearchArea,
        version: int,
        *,
        shown: bool,
        heights: bool = True,
    ) -> None:
        """A tile anew. shown: whether what others see of it has changed; heights: whether those of
        obstacles have, which are most of a tile."""
        old = self._ground.get(place)
        seen_version = version if shown or old is None else old.version
        self._ground[place] = ground_tile(
            occupancy, search.explored, place, seen_version, version,
            None if shown else old, None if heights else old,
        )  # fmt: skip

    def retile_known(
        self, box: Box, occupancy: OccupancyLayer, search: SearchArea, version: int
    ) -> None:
        """All tiles of a box of world cells that there were."""
        for place in box.tiles:
            if place in self._ground:
                self.retile(place, occupancy, search, version, shown=True)

    def retile_values(
        self, names: Iterable[str], values: ValueLayers, changed: Box, version: int
    ) -> None:
        """The tiles of some layers within a box of world cells."""
        for name in names:
            layer, tiles = values.layers[name], self._values.setdefault(name, {})
            for place in changed.tiles:
                tiles[place] = value_tile(layer, name, values.grid, place, version)

    def empty_layer(self, name: str) -> None:
        """A layer without any value."""
        self._values[name] = {}

    def reset_layers(self, names: Iterable[str]) -> None:
        """These layers and no others, all empty."""
        self._values = {name: {} for name in names}

    def take(
        self, ground: Mapping[Tile, GroundTile], layers: Mapping[str, Mapping[Tile, ValueTile]]
    ) -> None:
        """Tiles as they were kept: this ground in place of any, these layers beside others."""
        self._ground = dict(ground)
        self._values |= {name: dict(tiles) for name, tiles in layers.items()}
