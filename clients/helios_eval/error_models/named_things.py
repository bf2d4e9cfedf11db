"""Names that a detector gave to the things of a static scene, collected by the rules of the map.

Each view goes into the object map's own `NameSightings`. A thing is a set of voxels: the visible
surface of a true object, or detections that share voxels where nothing is known.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from helios_core.geometry import Matrix
from helios_core.types import Detection, Frame, Observation, SearchContext
from helios_objectmap.camera import View
from helios_objectmap.fusion.label_image import read
from helios_objectmap.instances.clustering import distinct, voxel_centers_m, voxel_keys
from helios_objectmap.instances.furniture import is_furniture
from helios_objectmap.instances.name_sightings import (
    LEAST_OF_LARGEST,
    OWN_OVERLAP,
    VOXEL_M,
    NamedViews,
    NameRates,
    NameSightings,
    SightingTable,
)
from helios_objectmap.settings import ObjectMapSettings
from helios_objectmap.viewpoint_weights import NEVER, Viewpoints
from numpy.typing import NDArray
from scipy import sparse

ASKED_FROM = 0.2  # least score of a detection, as `helios` asks for it
LEAST_SIDES = 1.0  # things seen from less (sum of the sides' weights) say too little
OWN_SHARE = 0.5  # of a thing's detections; a group with less lies on another thing
MOST_VIEWS = 1 << 20
_SEEN = "seen"
_NOTHING = SearchContext("calibrate", ())

Keys = NDArray[np.integer]


@dataclass(frozen=True)
class NamedThing:
    """A thing and the names that it got."""

    scene: int  # things of one scene share their views
    rates: NameRates
    views: NamedViews
    center_m: NDArray[np.float64]  # [3] world
    right: tuple[str, ...] | None  # names that are right for it; None: not known


@dataclass(frozen=True)
class KnownPlace:
    """A thing that somebody measured."""

    names: tuple[str, ...]  # right names
    center_m: tuple[float, float, float]  # world


class SceneLog:
    """Collects the views of one static scene. A camera at rest counts once."""

    def __init__(self, settings: ObjectMapSettings) -> None:
        self._settings = settings
        self._sightings, self._viewpoints = NameSightings(MOST_VIEWS), Viewpoints()
        self._surface: dict[str, set[int]] = {}  # true thing -> voxels of its visible surface
        self._seen = 0

    def __len__(self) -> int:
        """Number of views that counted."""
        return len(self._sightings)

    def takes(self, T_world_cam: Matrix) -> bool:
        """True for a pose that differs from all earlier ones; only such views count."""
        self._seen += 1
        look = self._viewpoints.locate(T_world_cam)
        share = self._viewpoints.weights(look, [_SEEN], np.array([NEVER]))[0, 0]
        self._viewpoints.mark(look, [_SEEN], self._seen)
        return bool(share > 0)

    def add(self, frame: Frame, found: Iterable[Detection]) -> None:
        """Add a view that `takes` has taken."""
        s = self._settings
        observation = Observation(frame, _NOTHING.id, (), {}, "")
        reading = read(observation, _NOTHING, s.stride_px, s.min_depth_m, s.max_depth_m)
        counted = [d for d in found if d.score >= ASKED_FROM]
        self._sightings.note(reading, s.stride_px, counted)

    def add_surface(self, frame: Frame, masks: Mapping[str, NDArray[np.bool_]]) -> None:
        """Add the visible surface of true things. masks: thing -> its pixels [h, w]."""
        for name, mask in masks.items():
            keys = surface_keys(frame, mask, self._settings.max_depth_m)
            self._surface.setdefault(name, set()).update(keys.tolist())

    def true_things(self, scene: int, right: Mapping[str, tuple[str, ...]]) -> Iterator[NamedThing]:
        """Things by their true surface. right: true thing -> its right names."""
        for name, voxels in self._surface.items():
            if name in right:
                keys = np.array(sorted(voxels), np.int64)
                thing = self._thing(scene, keys, right[name][0], right[name])
                if thing is not None:
                    yield thing

    def found_things(self, scene: int) -> Iterator[NamedThing]:
        """Things by the detections that share voxels, with nothing known about them."""
        table = self._sightings.table()
        for members in groups(table):
            inside = np.isin(table.detection, members)
            keys = np.sort(table.keys[np.unique(table.voxel[inside])])
            names, count = np.unique(table.name[members], return_counts=True)
            thing = self._thing(scene, keys, table.names[names[np.argmax(count)]], None)
            if thing is not None and len(members) >= OWN_SHARE * thing.views.given.sum():
                yield thing

    def _thing(
        self, scene: int, keys: Keys, name: str, right: tuple[str, ...] | None
    ) -> NamedThing | None:
        views = self._sightings.named(keys, name)
        if views is None:
            return None
        center_m = voxel_centers_m(keys, VOXEL_M).mean(axis=0)
        rates = views.rates(center_m, self._settings.side_views)
        if rates.weight.sum() < LEAST_SIDES:
            return None
        return NamedThing(scene, rates, views, center_m, right)


def surface_keys(frame: Frame, mask: NDArray[np.bool_], most_m: float) -> Keys:
    """Distinct voxels of the masked pixels [h, w] that have a depth."""
    c = frame.camera
    view = View(c.fx, c.fy, c.cx, c.cy, c.width, c.height, np.asarray(frame.T_world_cam))
    usable = mask & (frame.depth_m > 0) & (frame.depth_m <= most_m)
    return distinct(voxel_keys(view.lift(frame.depth_m, usable), VOXEL_M))[0]


def groups(table: SightingTable) -> list[NDArray[np.int64]]:
    """Detections of each thing: those linked by shared voxels, as the map shares them.

    Two detections are linked if they share half of the voxels of the smaller one and 0.3 of those
    of the larger one. Furniture links with furniture only.
    """
    n = len(table.name)
    if not n:
        return []
    filled = sparse.csr_matrix(
        (np.ones(len(table.voxel), np.int32), (table.detection, table.voxel)),
        shape=(n, len(table.keys)),
    )
    size = np.asarray(filled.sum(axis=1)).ravel()
    large = np.array([is_furniture(name) for name in table.names], bool)[table.name]
    shared = (filled @ filled.T).tocoo()
    a, b = shared.row, shared.col
    linked = (
        (shared.data >= OWN_OVERLAP * np.minimum(size[a], size[b]))
        & (shared.data >= LEAST_OF_LARGEST * np.maximum(size[a], size[b]))
        & (large[a] == large[b])
    )
    graph = sparse.coo_matrix((np.ones(linked.sum(), bool), (a[linked], b[linked])), (n, n))
    label = sparse.csgraph.connected_components(graph, directed=False)[1]
    order = np.argsort(label, kind="stable")
    parts = np.split(order, np.flatnonzero(np.diff(label[order])) + 1)
    return [p for p in parts if size[p].any()]


def with_places(
    things: Sequence[NamedThing], places: Sequence[KnownPlace], within_m: float = 0.3
) -> list[NamedThing]:
    """The things, with the right names of the nearest known place within a distance."""
    out = list(things)
    for place in places:
        away = [float(np.linalg.norm(t.center_m - place.center_m)) for t in things]
        large = is_furniture(place.names[0])
        near = [
            (d, k)
            for k, (d, t) in enumerate(zip(away, things, strict=True))
            if d <= within_m and is_furniture(t.rates.names[0]) == large
        ]
        if near:
            k = min(near)[1]
            out[k] = replace(out[k], right=place.names)
    return out
