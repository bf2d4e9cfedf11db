"""Cache of map responses: equal requests share one call to a map."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable, Iterable

from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.errors import HeliosError, Internal, InvalidInput, Unavailable
from helios_core.map_snapshot import MapView, decode_snapshot
from helios_core.name_rules import closest, is_named, plain
from helios_core.topics import (
    GAUSSIANS,
    OBJECTS,
    PICTURE,
    SNAPSHOT,
    STORED_OBJECTS,
    VOCABULARY,
)
from helios_core.viewing.newest_map import newest_snapshot

from helios_gateway import api_map_models, map_arrays, message_conversion, viewer_scene
from helios_gateway.cached_responses import NPZ, PNG, Encoded
from helios_gateway.error_responses import NotFound, invalid_as_not_found
from helios_gateway.gaussian_arrays import ColorBy, Gaussians
from helios_gateway.request_coalescing import RequestCoalescer

MAX_AGE_S = 2.0  # an older picture or list of objects is made again
LEAST_DRAWN = 0.1  # score of an object from which pictures of the map show it


class MapCache:
    """Cache of map responses. Thread-safe. A map change invalidates its entries."""

    def __init__(self, bus: Bus, timeout_s: float, max_age_s: float = MAX_AGE_S) -> None:
        self._bus = bus
        self._timeout_s = timeout_s
        self._lock = threading.Lock()
        self._changes = {"map2d": 0, "objectmap": 0}
        self._path_m: tuple[float, ...] = ()
        self._snapshot: MapView | None = None
        self._views: RequestCoalescer[MapView] = RequestCoalescer(max_age_s)
        self._objects: RequestCoalescer[pb.ObjectsReply] = RequestCoalescer(max_age_s)
        self._stored: RequestCoalescer[pb.StoredObjectsReply] = RequestCoalescer(max_age_s)
        self._pictures: RequestCoalescer[Encoded] = RequestCoalescer(max_age_s)
        self._lists: RequestCoalescer[Encoded] = RequestCoalescer(max_age_s)
        self._scenes: RequestCoalescer[Encoded] = RequestCoalescer(max_age_s)
        self._files: RequestCoalescer[Encoded] = RequestCoalescer(float("inf"))

    def on_ack(self, ack: pb.Ack) -> None:
        with self._lock:
            if ack.accepted and ack.service in self._changes:
                self._changes[ack.service] += 1

    def on_change(self) -> None:
        """Invalidate all entries, for example after a new search context or a restart of a map."""
        with self._lock:
            for service in self._changes:
                self._changes[service] += 1

    def on_plan(self, plan: pb.Plan) -> None:
        with self._lock:
            self._path_m = tuple(plan.path_m)

    def change(self) -> api_map_models.MapChange:
        """Counters that rise with every change of the maps."""
        with self._lock:
            return api_map_models.MapChange(
                map2d=self._changes["map2d"], objects=self._changes["objectmap"]
            )

    def view(self) -> MapView:
        """Newest snapshot of the 2D map. Raises Unavailable, DeadlineExceeded, Internal."""
        return self._views.get("map", self._state("map2d"), self._ask_snapshot)

    def info_json(self) -> Encoded:
        """Size, layers and robot of the 2D map as an encoded response."""
        return self._file("info", self.view(), lambda view: Encoded.json(_info(view)))

    def frontiers_json(self) -> Encoded:
        """Frontiers as an encoded response."""

        def make(view: MapView) -> Encoded:
            frontiers = [message_conversion.frontier(f) for f in view.frontiers]
            return Encoded.json(
                api_map_models.FrontierList(version=view.version, frontiers=frontiers)
            )

        return self._file("frontiers", self.view(), make)

    def cells(self, layer: str | None) -> Encoded:
        """Image of `map_arrays.cells_png` as an encoded response."""
        view = self._with_layer(layer)
        return self._file(
            ("cells", layer),
            view,
            lambda _: Encoded.of(
                map_arrays.cells_png(view, layer), PNG, x_map_version=str(view.version)
            ),
        )

    def npz(self, layer: str | None) -> Encoded:
        """Arrays of the occupancy grid (None) or of a value layer."""

        def make(view: MapView) -> Encoded:
            data = (
                map_arrays.occupancy_npz(view)
                if layer is None
                else map_arrays.value_npz(view, layer)
            )
            return Encoded.of(data, NPZ, x_map_version=str(view.version))

        return self._file(("npz", layer), self._with_layer(layer), make)

    def picture(self, layer: str, size_px: int) -> Encoded:
        """PNG for people, drawn by map2d, with the path and the objects. Raises NotFound."""
        with self._lock:
            path_m = self._path_m
        state = (self._state("map2d"), self._state("objectmap"), path_m)

        def make() -> Encoded:
            request = pb.PictureRequest(
                layer=layer, size_px=size_px, path_m=path_m, objects=self._marked()
            )
            with invalid_as_not_found():
                return Encoded.of(self._bus.call(PICTURE, request, self._timeout_s).png, PNG)

        return self._pictures.get((layer, size_px), state, make)

    def objects(self) -> api_map_models.ObjectList:
        """All instances of the object map, and the objects of a stored map."""
        return message_conversion.object_list(self._ask_objects(), self._ask_stored())

    def object(self, id: int) -> api_map_models.ObjectInstance:
        """One instance of the object map. Raises NotFound."""
        for found in self.objects().objects:
            if found.id == id:
                return found
        raise NotFound(f"there is no object {id}; list them with GET /v1/objects")

    def objects_json(self, class_name: str | None, min_score: float | None) -> Encoded:
        """Instances of a class (None: of all) with at least a score Ψ, as an encoded response.

        class_name: in any case, with spaces or underscores. Raises NotFound for a name that
        neither the object map nor the detector knows.
        """
        state = self._state("objectmap")
        reply, stored = self._ask_objects(), self._ask_stored()
        if class_name is not None:
            self._check_class(class_name, (*reply.objects, *stored.objects))

        def make() -> Encoded:
            found = message_conversion.object_list(reply, stored)
            kept = [o for o in found.objects if _fits(o, class_name, min_score)]
            waiting = [o for o in found.stored if _fits(o, class_name, min_score)]
            return Encoded.json(found.model_copy(update={"objects": kept, "stored": waiting}))

        place = stored.relocalisation
        key = (state, reply.version, place.state, place.attempts, len(stored.objects))
        return self._lists.get((class_name, min_score), key, make)

    def _check_class(self, class_name: str, mapped: Iterable[pb.ObjectInstance]) -> None:
        """Raise NotFound for an unknown class, with similar names."""
        names = {o.class_name for o in mapped}
        if any(is_named(class_name, name) for name in names):
            return
        try:
            known = self._bus.call(VOCABULARY, pb.Empty(), self._timeout_s)
        except HeliosError:  # without the detector's names any class may exist
            return
        names.update(known.names)
        if known.open or any(is_named(class_name, name) for name in names):
            return
        near = closest(plain(class_name), sorted(names))
        hint = f"; did you mean {' or '.join(near)}?" if near else ""
        raise NotFound(
            f"no class is called {class_name[:80]!r}: none of it is in the map, and the detector "
            f"({known.detector}) does not know it{hint} (all that it knows: `helios names`, HTTP: "
            "GET /v1/vocabulary)"
        )

    def scene(self, by: ColorBy) -> Encoded:
        """Coloured 3D scene of the Gaussians, above the ground of the 2D map if there is one."""

        def make() -> Encoded:
            reply = self._bus.call(GAUSSIANS, pb.GaussiansRequest(), self._timeout_s)
            try:
                ground = self.view()
            except HeliosError:  # the scene is useful without the ground
                ground = None
            scene = viewer_scene.scene_file(Gaussians.of(reply), self.objects().objects, ground, by)
            return Encoded.of(scene, viewer_scene.MEDIA_TYPE, x_gaussians=str(reply.count))

        return self._scenes.get(by, (self._state("map2d"), self._state("objectmap")), make)

    def _file(self, key: Hashable, view: MapView, make: Callable[[MapView], Encoded]) -> Encoded:
        """Response made once for this version of the map."""
        return self._files.get(key, _state(view), lambda: make(view))

    def _state(self, service: str) -> int:
        with self._lock:
            return self._changes[service]

    def _ask_objects(self) -> pb.ObjectsReply:
        return self._objects.get(
            "all",
            self._state("objectmap"),
            lambda: self._bus.call(OBJECTS, pb.ObjectsRequest(), self._timeout_s),
        )

    def _ask_stored(self) -> pb.StoredObjectsReply:
        return self._stored.get(
            "all",
            self._state("objectmap"),
            lambda: self._bus.call(STORED_OBJECTS, pb.Empty(), self._timeout_s),
        )

    def _marked(self) -> list[pb.MarkedObject]:
        """Objects to draw on the map, without doubtful ones; none while the object map does not
        answer."""
        try:
            reply = self._ask_objects()
        except HeliosError:
            return []
        return [
            pb.MarkedObject(label=o.class_name, center_m=o.center_m, size_m=o.size_m, score=o.score)
            for o in reply.objects
            if o.score >= LEAST_DRAWN
        ]

    def _ask_snapshot(self) -> MapView:
        known = self._snapshot
        reply = newest_snapshot(
            lambda request: self._bus.call(SNAPSHOT, request, self._timeout_s),
            known.version if known else 0,
            known.map_id if known else "",
        )
        if reply.unchanged and known is not None:
            return known
        if reply.cell_m <= 0:
            raise Unavailable(
                "the map is empty: no keyframe has come yet; give the robot a task, or send a frame"
            )
        try:
            self._snapshot = decode_snapshot(reply)
        except InvalidInput as error:
            raise Internal(f"map2d sent a map that cannot be read: {error.message}") from error
        return self._snapshot

    def _with_layer(self, layer: str | None) -> MapView:
        view = self.view()
        if layer is not None and layer not in view.values:
            known = ", ".join(sorted(view.values)) or "none yet"
            raise NotFound(f"the map has no value layer {layer[:80]!r}; it has: {known}")
        return view


def _info(view: MapView) -> api_map_models.MapInfo:
    rows, columns = view.shape
    return api_map_models.MapInfo(
        version=view.version,
        map_id=view.map_id,
        context_id=view.context_id,
        cell_m=view.cell_m,
        width_cells=columns,
        height_cells=rows,
        origin_m=[message_conversion.metres(v) for v in view.origin_m],
        explored_m2=message_conversion.finite(view.explored_m2),
        occupied_m2=message_conversion.finite(view.occupied_m2),
        layers=[
            api_map_models.MapLayer(name=name, max_value=map_arrays.layer_maximum(view, name))
            for name in sorted(view.values)
        ],
        robot=message_conversion.pose(*view.robot_pose),
        trajectory_m=message_conversion.pairs(view.trajectory_m.ravel().tolist()),
        trajectory_starts=list(view.trajectory_starts),
    )


def _state(view: MapView) -> tuple[str, int, str, str]:
    return view.map_id, view.version, str(view.frame_id), view.context_id


def _fits(
    found: api_map_models.ObjectInstance | api_map_models.StoredObject,
    class_name: str | None,
    min_score: float | None,
) -> bool:
    if class_name is not None and not is_named(class_name, found.class_name):
        return False
    return min_score is None or (found.score is not None and found.score >= min_score)
