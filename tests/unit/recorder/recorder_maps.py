"""Fakes of the two maps, whose answers a test sets, and the cells of a recorded grid."""

from __future__ import annotations

import threading
import zlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.topics import (
    GAUSSIANS,
    MAP2D_ACK,
    OBJECTMAP_ACK,
    OBJECTS,
    RELOCALISATION,
    SNAPSHOT,
)
from mcap.exceptions import EndOfFile, McapError
from mcap.reader import NonSeekingReader
from mcap_protobuf.decoder import DecoderFactory
from numpy.typing import NDArray

DTYPES = {1: "u1", 2: "i1", 7: "<f4"}  # foxglove.PackedElementField.NumericType


def snapshot_of(
    occupancy: NDArray[np.int8],
    origin_m: tuple[float, float] = (-1.0, 0.5),
    cell_m: float = 0.05,
    version: int = 1,
    values: dict[str, NDArray[np.float32]] | None = None,
) -> pb.MapSnapshot:
    """A snapshot as map2d sends it."""
    rows, columns = occupancy.shape
    out = pb.MapSnapshot(
        version=version,
        cell_m=cell_m,
        origin_x_m=origin_m[0],
        origin_y_m=origin_m[1],
        width=columns,
        height=rows,
        occupancy=zlib.compress(occupancy.tobytes()),
        explored=zlib.compress((occupancy >= 0).astype("u1").tobytes()),
        top_mm=zlib.compress(np.where(occupancy == 100, 900, 0).astype("<u2").tobytes()),
        trajectory_m=[0, 0, 0.5, 0, 2, 2, 2, 3],
        trajectory_starts=[2],
    )
    for name, value in (values or {}).items():
        out.values[name] = zlib.compress(value.astype("<f2").tobytes())
    frontier = out.frontiers.add(id=7, x_m=0.4, y_m=1.2, size_m=0.6, reachable=True)
    frontier.values["pick"] = 0.31
    return out


def gaussians_of(count: int) -> pb.GaussiansReply:
    """Gaussians along the diagonal of the world, of the class cup with probability 0.75."""
    ones = np.ones(count, "<f4")
    return pb.GaussiansReply(
        count=count,
        means_m=np.repeat(np.arange(count, dtype="<f4"), 3).tobytes(),
        scales_m=(0.01 * ones).tobytes(),
        colors=np.full((count, 3), 200, np.uint8).tobytes(),
        instances=np.arange(count, dtype="<u4").tobytes(),
        class_names=["other", "cup"],
        concentration=np.tile(np.array([1, 3], "<f4"), count).tobytes(),
        opacities=(0.5 * ones).tobytes(),
    )


class FakeMaps:
    """Answers `map2d/snapshot`, `objectmap/objects` and `objectmap/gaussians`; announces new
    versions."""

    def __init__(self, bus: Bus, snapshot: pb.MapSnapshot) -> None:
        self.bus, self.snapshot = bus, snapshot
        self.objects = pb.ObjectsReply(version=1)
        self.gaussians = gaussians_of(3)
        self.asked = self.asked_objects = self.at_once = self.most_at_once = 0
        self.before: Callable[[], None] = lambda: None  # runs before each answer of map2d
        self.before_objects: Callable[[], None] = lambda: None
        self._lock = threading.Lock()
        bus.serve(SNAPSHOT, self._snapshot)
        bus.serve(OBJECTS, self._objects)
        bus.serve(GAUSSIANS, lambda _: self.gaussians)

    def announce(self) -> None:
        self.bus.publish(MAP2D_ACK, pb.Ack(service="map2d", part="occupancy", accepted=True))
        self.bus.publish(OBJECTMAP_ACK, pb.Ack(service="objectmap", part="objects", accepted=True))

    def change(self, snapshot: pb.MapSnapshot) -> None:
        """Sets a newer version and announces it."""
        snapshot.version = self.snapshot.version + 1
        self.snapshot = snapshot
        self.objects.version += 1
        self.announce()

    def reset(self) -> None:
        """Discards the 2D map and announces it, as map2d does."""
        self.snapshot = pb.MapSnapshot()
        self.bus.publish(RELOCALISATION, pb.Relocalisation())

    def _objects(self, _: pb.ObjectsRequest) -> pb.ObjectsReply:
        self.asked_objects += 1
        self.before_objects()
        return self.objects

    def _snapshot(self, request: pb.SnapshotRequest) -> pb.MapSnapshot:
        with self._lock:
            self.asked += 1
            self.at_once += 1
            self.most_at_once = max(self.most_at_once, self.at_once)
        try:
            self.before()
            if request.if_newer and request.if_newer == self.snapshot.version:
                return pb.MapSnapshot(
                    version=self.snapshot.version, map_id=self.snapshot.map_id, unchanged=True
                )
            return self.snapshot
        finally:
            with self._lock:
                self.at_once -= 1


def cells_of(grid) -> NDArray[np.void]:
    """[rows, columns] of a foxglove.Grid, read by its own fields as a viewer does."""
    cell = np.dtype(
        {
            "names": [f.name for f in grid.fields],
            "formats": [DTYPES[f.type] for f in grid.fields],
            "offsets": [f.offset for f in grid.fields],
            "itemsize": grid.cell_stride,
        }
    )
    rows = np.frombuffer(grid.data, np.uint8).reshape(-1, grid.row_stride)
    used = np.ascontiguousarray(rows[:, : grid.column_count * grid.cell_stride])
    return used.view(cell).reshape(-1, grid.column_count)


def cell_at(grid, x_m: float, y_m: float) -> np.void:
    """The cell of a world point."""
    corner = grid.pose.position
    column = int((x_m - corner.x) / grid.cell_size.x)
    row = int((y_m - corner.y) / grid.cell_size.y)
    return cells_of(grid)[row, column]


def last_of(folder: Path) -> dict[str, Any]:
    """The newest message of each channel, as a third-party program reads it; the file may still
    be open for writing."""
    out: dict[str, Any] = {}
    for path in sorted(folder.glob("*.mcap")):
        with path.open("rb") as file, suppress(EndOfFile, McapError):
            reader = NonSeekingReader(file, decoder_factories=[DecoderFactory()])
            for _, channel, _, message in reader.iter_decoded_messages(log_time_order=False):
                out[channel.topic] = message
    return out
