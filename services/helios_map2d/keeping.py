"""Saving and loading maps, and keeping the present one from crashes."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from pathlib import PurePosixPath

from helios_core import proto as pb
from helios_core.codec import frame_id_to_proto
from helios_core.errors import InvalidInput, Unavailable

from helios_map2d.answers import DEFAULT_PICTURE_PX, known
from helios_map2d.epochs import EpochKey, EpochMaps
from helios_map2d.exchange import decode_exported, decode_ros, encode_ros
from helios_map2d.kept import (
    FILE_NAME,
    Keeper,
    decode_map,
    encode_map,
    put_aside,
    rebuilt,
)
from helios_map2d.occupancy import OCCUPIED, UNKNOWN
from helios_map2d.picture import OCCUPANCY, png_of, render
from helios_map2d.settings import Settings
from helios_map2d.snapshot import encode_npz
from helios_map2d.state import MapState

log = logging.getLogger(__name__)

FORMATS = "map, npz, ros or png"


class Keeping:
    """Files of the present map. `trouble`: what is wrong with keeping it, "" if nothing is."""

    def __init__(
        self,
        settings: Settings,
        lock: threading.RLock,
        maps: Callable[[], EpochMaps | None],
        say: Callable[[str], None],
    ) -> None:
        self.trouble = ""
        self._refused = ""  # why the kept map was, to be told as long as the process lives
        self._lock, self._maps, self._say = lock, maps, say
        self._path = None if settings.state_dir is None else settings.state_dir / FILE_NAME
        self._period_s = settings.keep_period_s
        self._keeper: Keeper | None = None

    def recover(self, maps: EpochMaps) -> None:
        """Park the map that was kept until the robot says that it is in its epoch, and begin to
        keep. A file that cannot be used is put aside and told of. The caller holds the lock."""
        if self._path is None:
            return
        self._keeper = Keeper(self._path, self._period_s, self._encoded, self._troubled)
        try:
            data = self._path.read_bytes()
        except FileNotFoundError:
            return
        except OSError as error:
            self._troubled(f"the kept map {self._path} cannot be read: {error.strerror}")
            return
        try:
            state = decode_map(data, maps.rules, maps.footprint_radius_m, maps.version)
        except InvalidInput as error:
            aside = put_aside(self._path)
            self._refused = f"{error.message}; the kept map was put aside as {aside}"
            log.warning("%s", self._refused)
            self.trouble = self._refused
            return
        if state.frame_id is not None:
            key = EpochKey.of(state.frame_id)
            maps.keep(key, state)
            if key == maps.robot_key:
                maps.robot_is_in(key)
            log.info("kept map of frame %s taken up, %d views", state.frame_id, len(state.memory))

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
            files = {"map2d.png": png_of(pixels)}
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
                raise Unavailable("the maps were begun anew meanwhile; load again")
            maps.replace(state)
            published = state.published
            views = len(state.memory)
        cell_m2 = published.grid.cell_m**2
        return pb.LoadMap2DReply(
            version=published.version,
            known_m2=float((published.occupancy != UNKNOWN).sum()) * cell_m2,
            occupied_m2=float((published.occupancy == OCCUPIED).sum()) * cell_m2,
            views=views,
        )

    def close(self) -> None:
        """Keep the map a last time."""
        if self._keeper is not None:
            self._keeper.close()

    def _file(self) -> tuple[int, bytes]:
        with self._lock:
            maps = self._maps()
            published = known(maps)
            current = maps.current if maps is not None else None
            views = current.memory.snapshot() if current is not None else ()
        return published.version, encode_map(published, views)

    def _encoded(self) -> tuple[int, bytes] | None:
        try:
            return self._file()
        except Unavailable:
            return None

    def _troubled(self, reason: str) -> None:
        reason = reason or self._refused
        if reason != self.trouble:
            self.trouble = reason
            self._say(reason)


def loaded(request: pb.LoadMap2DRequest, maps: EpochMaps) -> MapState:
    """The map of some files. Raises InvalidInput when they cannot be used."""
    by_ending = {PurePosixPath(f.name).suffix.lower(): f.data for f in request.files}
    rules, version = maps.rules, maps.version
    if set(by_ending) == {".map"}:
        return decode_map(by_ending[".map"], rules, maps.footprint_radius_m, version)
    if set(by_ending) == {".npz"}:
        content = decode_exported(by_ending[".npz"], rules.cell_m, version)
    elif ".yaml" in by_ending and len(by_ending) == 2:
        (picture,) = (data for ending, data in by_ending.items() if ending != ".yaml")
        content = decode_ros(by_ending[".yaml"], picture, rules.cell_m, version)
    else:
        raise InvalidInput(
            f"cannot load {', '.join(sorted(f.name[:80] for f in request.files)) or 'nothing'}: "
            "send one .map, one .npz, or a .yaml and the picture it names"
        )
    return rebuilt(content, rules, maps.footprint_radius_m, version)
