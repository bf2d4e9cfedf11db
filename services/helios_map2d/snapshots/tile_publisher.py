"""Tiles of the newest version; only changed tiles are renewed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType

from helios_map2d.grid import Box, Tile
from helios_map2d.layers.explored_area import ExploredArea
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
    """Tiles of the ground and of each value layer."""

    def __init__(self) -> None:
        self._ground: dict[Tile, GroundTile] = {}
        self._values: dict[str, dict[Tile, ValueTile]] = {}

    @property
    def ground(self) -> Ground:
        """Immutable copy of the present ground tiles."""
        return MappingProxyType(dict(self._ground))

    @property
    def layers(self) -> Mapping[str, Values]:
        """Immutable copy of the present tiles of all layers."""
        return MappingProxyType(
            {name: MappingProxyType(dict(tiles)) for name, tiles in self._values.items()}
        )

    def retile(
        self,
        place: Tile,
        occupancy: OccupancyLayer,
        search: ExploredArea,
        version: int,
        *,
        shown: bool,
        heights: bool = True,
    ) -> None:
        """Renew a ground tile. shown: True if its published content has changed; heights: True if
        obstacle heights have changed, which are most of a tile's data."""
        old = self._ground.get(place)
        seen_version = version if shown or old is None else old.version
        self._ground[place] = ground_tile(
            occupancy,
            search.explored,
            place,
            seen_version,
            version,
            None if shown else old,
            None if heights else old,
        )

    def retile_known(
        self, box: Box, occupancy: OccupancyLayer, search: ExploredArea, version: int
    ) -> None:
        """Renew all existing ground tiles of a box of world cells."""
        for place in box.tiles:
            if place in self._ground:
                self.retile(place, occupancy, search, version, shown=True)

    def retile_values(
        self, names: Iterable[str], values: ValueLayers, changed: Box, version: int
    ) -> None:
        """Renew the tiles of some layers within a box of world cells."""
        for name in names:
            layer, tiles = values.layers[name], self._values.setdefault(name, {})
            for place in changed.tiles:
                tiles[place] = value_tile(layer, name, values.grid, place, version)

    def empty_layer(self, name: str) -> None:
        """Remove all tiles of a layer."""
        self._values[name] = {}

    def reset_layers(self, names: Iterable[str]) -> None:
        """Replace all layers by empty ones with these names."""
        self._values = {name: {} for name in names}

    def take(
        self, ground: Mapping[Tile, GroundTile], layers: Mapping[str, Mapping[Tile, ValueTile]]
    ) -> None:
        """Take saved tiles: they replace the ground, and add to the layers."""
        self._ground = dict(ground)
        self._values |= {name: dict(tiles) for name, tiles in layers.items()}
