"""Queries of the newest published version; none of them holds the lock of the maps."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from helios_core import proto as pb
from helios_core.errors import InvalidInput, Unavailable
from numpy.typing import NDArray

from helios_map2d.epochs import EpochMaps
from helios_map2d.pictures.map_picture import OCCUPANCY, Marked, png_of, render
from helios_map2d.snapshots.delta import changes_after
from helios_map2d.snapshots.messages import CachedEncoding
from helios_map2d.snapshots.path_cost import cost_along
from helios_map2d.snapshots.snapshot import MapSnapshot

DEFAULT_PICTURE_PX = 1024
DEFAULT_COMFORT_M = 0.5
EMPTY_MAP = "the map is empty: no keyframe has come yet; give the robot a task, or send a frame"


class MapQueries:
    """Handlers of queries of the present map's published version."""

    def __init__(self, maps: Callable[[], EpochMaps | None]) -> None:
        self._maps = maps
        self._encoded = CachedEncoding()

    def snapshot(self, request: pb.SnapshotRequest) -> pb.MapSnapshot:
        """Whole map; without arrays if the caller already has its version."""
        published = published_of(self._maps())
        if published is None:
            return pb.MapSnapshot()
        if request.if_newer and published.version == request.if_newer:
            return pb.MapSnapshot(
                version=published.version, map_id=published.map_id, unchanged=True
            )
        return self._encoded.of(published, request.layers, request.ground_only)

    def changes(self, request: pb.MapChangesRequest) -> pb.MapChanges:
        """Next chunk of changes for a viewer; empty while there is no map."""
        published = published_of(self._maps())
        return pb.MapChanges() if published is None else changes_after(published, request)

    def picture(self, request: pb.PictureRequest) -> pb.PictureReply:
        """Picture of the map as PNG. Raises Unavailable while there is no map."""
        published = known(self._maps())
        things = [
            Marked(o.label, (o.center_m.x, o.center_m.y), (o.size_m.x, o.size_m.y), o.score)
            for o in request.objects
        ]
        pixels = render(
            published,
            request.layer or OCCUPANCY,
            request.size_px or DEFAULT_PICTURE_PX,
            points_of(request.path_m),
            things,
        )
        return pb.PictureReply(png=png_of(pixels, published), version=published.version)

    def sight(self, request: pb.SightRequest) -> pb.SightReply:
        """Visibility of points from a viewpoint. Raises Unavailable while there is no map."""
        published = known(self._maps())
        eye_m = (request.x_m, request.y_m, request.z_m)
        return pb.SightReply(
            visible=[published.line_of_sight(eye_m, (p.x, p.y, p.z)) for p in request.targets_m]
        )

    def path_cost(self, request: pb.PathCostRequest) -> pb.PathCostReply:
        """Cost and clearance along a path. Raises Unavailable while there is no map."""
        maps = self._maps()
        published = known(maps)
        radius_m = request.radius_m
        if radius_m == 0 and maps is not None:
            radius_m = maps.rules.frontiers.robot_radius_m
        cost = cost_along(
            published, points_of(request.path_m), radius_m, request.comfort_m or DEFAULT_COMFORT_M
        )
        return pb.PathCostReply(
            length_m=cost.length_m,
            cost_m=cost.cost_m,
            least_clearance_m=cost.least_clearance_m,
            unknown_m=cost.unknown_m,
            blocked=cost.blocked,
            version=published.version,
            samples_m=cost.samples_m.ravel().tolist(),
            clearance_m=cost.clearance_m.tolist(),
        )


def published_of(maps: EpochMaps | None) -> MapSnapshot | None:
    """Newest version of the present map; None while there is no map."""
    state = maps.current if maps is not None else None
    return state.published if state is not None else None


def known(maps: EpochMaps | None) -> MapSnapshot:
    """Newest version of the present map. Raises Unavailable if there is none or it is empty."""
    published = published_of(maps)
    if published is None or published.empty:
        raise Unavailable(EMPTY_MAP)
    return published


def points_of(numbers: object) -> NDArray[np.float64]:
    """Points [n, 2] of x, y, x, y …. Raises InvalidInput for an odd count."""
    flat = np.array(numbers, np.float64)
    if flat.size % 2:
        raise InvalidInput(f"the path has {flat.size} numbers; send x, y, x, y …")
    return flat.reshape(-1, 2)
