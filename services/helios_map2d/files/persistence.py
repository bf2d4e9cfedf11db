"""Saving and loading maps, and keeping the present one from crashes."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from pathlib import PurePosixPath

from helios_core import proto as pb
from helios_core.codec import frame_id_to_proto
from helios_core.errors import InvalidInput, Unavailable
from helios_core.map_autosave import Kept, KeptFile, of_another_world
from helios_core.map_snapshot import OCCUPIED, UNKNOWN
from helios_core.printable_text import counted

from helios_map2d.epoch_map import EpochMap
from helios_map2d.epochs import EpochMaps
from helios_map2d.files.map_file import FILE_NAME, decode_map, encode_map, rebuilt
from helios_map2d.files.npz_and_ros import decode_exported, decode_ros, encode_ros
from helios_map2d.map_queries import DEFAULT_PICTURE_PX, known
from helios_map2d.pictures.map_picture import OCCUPANCY, png_of, render
from helios_map2d.settings import Settings
from helios_map2d.snapshots.snapshot import MapSnapshot, encode_npz

log = logging.getLogger(__name__)

FORMATS = "map, npz, ros or png"
LOST_VERSIONS = 10_000  # more than there can have been between the last writing and a crash


class MapFiles:
    """Files of the present map, and what there is to say of them."""

    def __init__(
        self,
        settings: Settings,
        lock: threading.RLock,
        maps: Callable[[], EpochMaps | None],
        say: Callable[[], None],
    ) -> None:
        """say: called when `said` has changed."""
        self._trouble = ""  # what is wrong with keeping the map
        self._refused = ""  # why the kept map was, to be told as long as the process lives
        self._restored: tuple[EpochMap, str, str] | None = None  # the map, when kept, what is in it
        self._logged = ""  # what the log says of it
        self._lock, self._maps, self._say = lock, maps, say
        self._kept: KeptFile | None = None
        if settings.state_dir is not None:
            path = settings.state_dir / FILE_NAME
            self._kept = KeptFile(path, settings.keep_period_s, self._newer, self._troubled)

    def said(self) -> str:
        """What is wrong with keeping the map; what became of the kept one, until another takes its
        place. "" when there is nothing to say."""
        fate = self._fate()
        if fate and fate != self._logged:
            self._logged = fate
            log.info("%s", fate)
        return "; ".join(part for part in (self._trouble, fate) if part)

    def superseded(self, searching: bool) -> bool:
        """The present map was changed, and so is no longer what an earlier process kept; whether
        `said` has changed. That the kept map is of another world is told until an image is taken in
        that answers a search (searching), as the object map tells it."""
        maps, restored = self._maps(), self._restored
        if maps is None or restored is None or not (searching or maps.current is restored[0]):
            return False
        self.said()  # into the log
        self._restored = None
        return True

    def recover(self, maps: EpochMaps) -> None:
        """Park the map that was kept until the robot says that it is in its world, and begin to
        keep. A file that cannot be used is put aside and told of. The caller holds the lock."""
        if self._kept is None:
            return
        try:
            found = self._kept.found()
            if found is not None:
                self._restore(found, maps)
        except OSError as error:
            self._troubled(f"the kept map cannot be read: {error}")
        except InvalidInput as error:
            aside = self._kept.put_aside()
            self._refused = f"the kept map was refused and {aside}: {error.message}"
            log.warning("%s", self._refused)
            self._trouble = self._refused
        self._kept.start()

    def _restore(self, found: Kept, maps: EpochMaps) -> None:
        state, world = decode_map(found.data, maps.rules, maps.footprint_radius_m, maps.version)
        state.go_on_from(state.version + LOST_VERSIONS)
        newest = "" if state.frame_id is None else f", frames up to number {state.frame_id.seq}"
        known_m2 = areas_m2(state.published)[0]
        content = f"{known_m2:.0f} m² known, {counted(len(state.memory), 'view')}{newest}"
        self._restored = state, found.written, content
        log.info(
            "a map was kept at %s: %s; it goes on when the robot is in %s",
            found.written, content, world,
        )  # fmt: skip
        maps.keep(world, state)

    def _fate(self) -> str:
        """What became of the map that an earlier process kept; "" where there is nothing to say."""
        maps, restored = self._maps(), self._restored
        if maps is None or restored is None:
            return ""
        state, written, content = restored
        if maps.current is state:
            return f"the map was restored as it was written at {written}: {content}"
        return of_another_world(written) if maps.is_of_another_world(state) else ""

    def forget(self) -> None:
        """Keep nothing of what was known until now."""
        self._restored = None
        if self._kept is not None:
            self._kept.forget()

    def save(self, request: pb.SaveMap2DRequest) -> pb.SaveMap2DReply:
        """The present map as files; Unavailable while there is none."""
        published = known(self._maps())
        kind = request.format or "map"
        if kind == "map":
            files = {"map2d.map": self._file()[1]}
        elif kind == "npz":
            files = {"map2d.npz": encode_npz(published)}
        elif kind == "ros":
            files = encode_ros(published)
        elif kind == "png":
            size_px = request.size_px or DEFAULT_PICTURE_PX
            pixels = render(published, request.layer or OCCUPANCY, size_px)
            files = {"map2d.png": png_of(pixels, published)}
        else:
            raise InvalidInput(f"no format is called {kind[:40]!r}; ask for {FORMATS}")
        reply = pb.SaveMap2DReply(
            files=[pb.Map2DFile(name=name, data=data) for name, data in files.items()],
            version=published.version, map_id=published.map_id,
        )  # fmt: skip
        if published.frame_id is not None:
            reply.id.CopyFrom(frame_id_to_proto(published.frame_id))
        return reply

    def load(self, request: pb.LoadMap2DRequest) -> pb.LoadMap2DReply:
        """Take a map in place of the present one, in the robot's present world.

        Its coordinates must be those of that world. Raises InvalidInput for files that cannot be
        used, Unavailable before the robot has described itself, Conflict before it said where it
        is.
        """
        maps = self._maps()
        if maps is None:
            raise Unavailable("the robot has not described itself; start its bridge")
        state = loaded(request, maps)
        with self._lock:
            if self._maps() is not maps:
                raise Unavailable("the maps were reset meanwhile; load again")
            maps.replace(state)
            self._restored = None
            published = state.published
            views = len(state.memory)
        known_m2, occupied_m2 = areas_m2(published)
        return pb.LoadMap2DReply(
            version=published.version, known_m2=known_m2, occupied_m2=occupied_m2, views=views
        )

    def close(self) -> None:
        """Keep the map a last time."""
        if self._kept is not None:
            self._kept.close()

    def _file(self) -> tuple[int, bytes]:
        with self._lock:
            maps = self._maps()
            published = known(maps)
            current = maps.current if maps is not None else None
            views = current.memory.snapshot() if current is not None else ()
            world = maps.key if maps is not None else None
        return published.version, encode_map(published, views, world)

    def _newer(self, kept_version: int) -> tuple[int, bytes] | None:
        try:
            file = self._file()
        except Unavailable:  # there is no map
            return None
        return None if file[0] == kept_version else file

    def _troubled(self, reason: str) -> None:
        reason = reason or self._refused
        if reason != self._trouble:
            self._trouble = reason
            self._say()


def areas_m2(published: MapSnapshot) -> tuple[float, float]:
    """What is known of the ground, and how much of it is occupied."""
    cell_m2 = published.grid.cell_m**2
    known_cells = int((published.occupancy != UNKNOWN).sum())
    return known_cells * cell_m2, int((published.occupancy == OCCUPIED).sum()) * cell_m2


def loaded(request: pb.LoadMap2DRequest, maps: EpochMaps) -> EpochMap:
    """The map of some files. Raises InvalidInput when they cannot be used."""
    by_ending = {PurePosixPath(f.name).suffix.lower(): f.data for f in request.files}
    if len(by_ending) < len(request.files):
        raise InvalidInput(
            f"{len(request.files)} files came, some of one kind: send one map at a time"
        )
    rules, version = maps.rules, maps.version
    if set(by_ending) == {".map"}:
        return decode_map(by_ending[".map"], rules, maps.footprint_radius_m, version)[0]
    if set(by_ending) == {".npz"}:
        content = decode_exported(by_ending[".npz"], rules.cell_m, version)
    elif ".yaml" in by_ending and len(by_ending) == 2:
        (picture,) = (data for ending, data in by_ending.items() if ending != ".yaml")
        content = decode_ros(by_ending[".yaml"], picture, rules, version)
    else:
        raise InvalidInput(
            f"cannot load {', '.join(sorted(f.name[:80] for f in request.files)) or 'nothing'}: "
            "send one .map, one .npz, or a .yaml and the picture it names"
        )
    return rebuilt(content, rules, maps.footprint_radius_m, version)
