"""The map for others: as a file, as PLY and NPZ, as a picture from anywhere, one object in full."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

from helios_core import kept_file
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.codec import object_to_proto, vector_to_proto
from helios_core.codec.frames import pinhole_from_proto, transform_from_proto
from helios_core.errors import InvalidInput
from helios_core.health import Health
from helios_core.kept_file import Kept, KeptFile
from helios_core.printable_text import counted
from helios_core.topics import (
    EXPORT_OBJECTS,
    LOAD_OBJECTS,
    OBJECT_DETAIL,
    RENDER_OBJECTS,
    SAVE_OBJECTS,
)
from numpy.typing import NDArray

from helios_objectmap.epochs import EpochMaps
from helios_objectmap.files import export, mapfile
from helios_objectmap.object_map import ObjectMap
from helios_objectmap.settings import ObjectMapSettings
from helios_objectmap.view import View

log = logging.getLogger(__name__)

FILE_NAME = "objects.npz"
MOST_PIXELS = 1920 * 1200
_FORMATS = {"ply": export.ply, "npz": export.npz}


class Exchange:
    """Answers from the maps of the service, under its lock."""

    def __init__(
        self,
        bus: Bus,
        settings: ObjectMapSettings,
        health: Health,
        lock: threading.Lock,
        maps: EpochMaps,
        version: Callable[[], int],
        replaced: Callable[[], None],
        say: Callable[[], None],
    ) -> None:
        """version: of the map, under the lock; replaced: called under it after a load; say: called
        when `said` has changed."""
        self._lock, self._maps, self._health = lock, maps, health
        self._version, self._replaced, self._say = version, replaced, say
        self._refused = ""  # why the map of an earlier process was, as long as this one lives
        self._restored: tuple[ObjectMap, str, str] | None = None  # map, time of writing, content
        self._trouble = ""  # with keeping the present one
        self._kept: KeptFile | None = None
        if settings.state_dir is not None:
            path = settings.state_dir / FILE_NAME
            self._kept = KeptFile(path, settings.save_every_s, self._unkept, self._troubled)
        bus.serve(SAVE_OBJECTS, self.save)
        bus.serve(LOAD_OBJECTS, self.load)
        bus.serve(EXPORT_OBJECTS, self.export)
        bus.serve(RENDER_OBJECTS, self.render)
        bus.serve(OBJECT_DETAIL, self.detail)

    @property
    def said(self) -> str:
        """What is wrong with keeping the map; what became of the kept one, until another takes its
        place."""
        return "; ".join(part for part in (self._trouble, self._refused, self._fate()) if part)

    def superseded(self) -> bool:
        """The present map is no longer what an earlier process kept; whether `said` has changed."""
        was, self._restored = self._restored, None
        return was is not None

    def begin(self) -> None:
        """Take up the map of an earlier process, if one was kept, and begin to keep."""
        if self._kept is None:
            return
        try:
            found = self._kept.found()
            if found is not None:
                self._restore(found)
        except InvalidInput as error:
            self._health.count("maps_refused")
            self._refused = f"the kept map was refused and {self._kept.put_aside()}: {error}"
        except OSError as error:
            self._refused = f"the kept map cannot be read: {error}"
        if self.said:
            log.warning("%s", self.said)
        self._kept.start()

    def forget(self) -> None:
        """Keep nothing of what was known until now."""
        self._restored = None
        if self._kept is not None:
            self._kept.forget()

    def close(self) -> None:
        """Keep what is not kept yet."""
        if self._kept is not None:
            self._kept.close()

    # --- what is asked ------------------------------------------------------------------------
    def save(self, _: pb.Empty) -> pb.ObjectMapFile:
        """The present map as a file."""
        with self._lock:
            arrays = self._arrays()
        return pb.ObjectMapFile(data=mapfile.written(arrays))

    def load(self, request: pb.ObjectMapFile) -> pb.ObjectMapLoaded:
        """Put the map of a file in the present one's place. A file that is refused changes nothing.

        The file's world frame is taken to be the present one.
        """
        loaded = self._recall(request.data, same_world=False)
        if self.superseded():
            self._say()
        return loaded

    def export(self, request: pb.ExportRequest) -> pb.ExportReply:
        """Gaussians of all instances, or of one, for other programs."""
        if request.format not in _FORMATS:
            raise InvalidInput(f"no format {request.format!r}; wanted {' or '.join(_FORMATS)}")
        with self._lock:
            gaussians = self._maps.current.gaussians(request.object_id or None)
        if request.object_id and not len(gaussians.means):
            raise self._unknown(request.object_id)
        return pb.ExportReply(
            data=_FORMATS[request.format](gaussians), gaussians=len(gaussians.means)
        )

    def render(self, request: pb.RenderRequest) -> pb.RenderReply:
        """The map as a camera anywhere would see it."""
        c = pinhole_from_proto(request.camera)
        if c.width * c.height > MOST_PIXELS:
            raise InvalidInput(
                f"{c.width}x{c.height} pixels asked for; at most {MOST_PIXELS} in one picture"
            )
        T_world_cam = transform_from_proto(request.T_world_cam)
        view = View(c.fx, c.fy, c.cx, c.cy, c.width, c.height, T_world_cam)
        with self._lock:
            png = self._maps.current.render(view, request.layer or "color", request.class_name)
        return pb.RenderReply(png=png)

    def detail(self, request: pb.ObjectRequest) -> pb.ObjectDetail:
        """One object: all figures, how belief in it went, and what a gripper wants to know."""
        with self._lock:
            present = self._maps.current
            found = next((o for o in present.objects() if o.id == request.object_id), None)
            history = present.history(request.object_id)
            grasp = present.grasp(request.object_id)
        if found is None or grasp is None:
            raise self._unknown(request.object_id)
        return pb.ObjectDetail(
            object=object_to_proto(found),
            history=[
                pb.Moment(
                    stamp_ns=m.stamp_ns, views=m.views, score=m.score, class_score=m.class_score
                )
                for m in history
            ],
            points_m=grasp.points_m.ravel().tolist(),
            box_center_m=vector_to_proto(grasp.center_m),
            box_size_m=vector_to_proto(grasp.size_m),
            box_yaw_rad=grasp.yaw_rad,
        )

    # --- parts --------------------------------------------------------------------------------
    def _restore(self, kept: Kept) -> None:
        """Know what an earlier process wrote. Raises InvalidInput."""
        loaded = self._recall(kept.data, same_world=True)
        newest = self._maps.newest
        frames = "" if newest is None else f", frames up to number {newest.seq}"
        content = (
            f"{counted(loaded.objects, 'object')}, {counted(loaded.gaussians, 'Gaussian')}{frames}"
        )
        self._restored = self._maps.current, kept.written, content

    def _fate(self) -> str:
        """What became of the map that an earlier process kept; "" where there is nothing to say."""
        if self._restored is None:
            return ""
        map, written, content = self._restored
        if self._maps.current is map:
            return f"the map was restored as it was written at {written}: {content}"
        return kept_file.of_another_world(written)

    def _recall(self, data: bytes, *, same_world: bool) -> pb.ObjectMapLoaded:
        """same_world: only while the robot is in the world epoch that the file names."""
        began = time.perf_counter()
        found = mapfile.read(data, self._maps.current.no_viewpoints())
        with self._lock:
            present = self._maps.current
            present.recall(found.memory)
            if same_world and self._maps.world is None:
                self._maps.restored(found.world, found.newest)
            self._replaced()
            objects, gaussians = len(present.objects()), len(present)
        log.info("%d Gaussians read in %.1f s", gaussians, time.perf_counter() - began)
        return pb.ObjectMapLoaded(gaussians=gaussians, objects=objects)

    def _unkept(self, kept_version: int) -> tuple[int, bytes] | None:
        with self._lock:
            version = self._version()
            if version == kept_version:
                return None
            arrays = self._arrays()
        return version, mapfile.written(arrays)

    def _troubled(self, reason: str) -> None:
        if reason:
            self._health.count("saves_failed")
        if reason != self._trouble:
            self._trouble = reason
            self._say()

    def _arrays(self) -> dict[str, NDArray]:
        maps = self._maps
        return mapfile.arrays_of(maps.current.memory(), maps.world, maps.newest)

    @staticmethod
    def _unknown(object_id: int) -> InvalidInput:
        return InvalidInput(f"no object {object_id}: ask for the objects again, they have changed")
