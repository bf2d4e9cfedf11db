"""Results of a replay: `objects.json`, `occupancy.png`, `occupancy.npz`, `summary.json`."""

from __future__ import annotations

import io
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from helios_core import proto as pb
from helios_core.atomic_file import write_file
from helios_core.bus import Bus
from helios_core.errors import InvalidInput
from helios_core.map_snapshot import MapView, decode_snapshot
from helios_core.topics import OBJECTS, PICTURE, SNAPSHOT
from rich.markup import escape
from rich.table import Table

from helios_client.replay.frame_answers import FrameAcks
from helios_client.supervision.service_table import ServiceTable

ASK_WITHIN_S = 20.0
PICTURE_PX = 1024


@dataclass(frozen=True)
class Results:
    """Results of a replay, to be written or shown."""

    objects: list[dict[str, Any]]  # as in objects.json
    picture_png: bytes
    map: MapView
    summary: dict[str, Any]

    def write(self, out: Path) -> None:
        """Write each file atomically into an existing folder. A number that is not finite becomes
        null.

        Raises InvalidInput if a file cannot be written.
        """
        _replace(out / "objects.json", _json(self.objects))
        _replace(out / "summary.json", _json(self.summary))
        _replace(out / "occupancy.png", self.picture_png)
        arrays = io.BytesIO()
        np.savez_compressed(
            arrays,
            occupancy=self.map.occupancy,
            explored=self.map.explored.astype(np.uint8),
            top_m=self.map.top_m,
            trajectory_m=self.map.trajectory_m,
            origin_m=np.array(self.map.origin_m),
            cell_m=np.array(self.map.cell_m),
        )
        _replace(out / "occupancy.npz", arrays.getvalue())

    def table(self) -> Table:
        """Table of the objects for a terminal, best first."""
        out = Table("id", "class")
        for heading in ("centre (m)", "size (m)", "Ψ", "U", "views"):
            out.add_column(heading, justify="right", no_wrap=True)
        for o in self.objects:
            out.add_row(
                str(o["id"]),
                escape(o["class"]),
                _metres(o["center_m"]),
                _metres(o["size_m"]),
                f"{o['score']:.2f}",
                f"{o['uncertainty']:.2f}",
                str(o["views"]),
            )
        return out


def collect(
    bus: Bus, acks: FrameAcks, service_table: ServiceTable, frames: int, wall_s: float
) -> Results:
    """Query the maps for the results; `wall_s`: duration of the replay.

    Raises HeliosError if a map does not answer.
    """
    reply = bus.call(OBJECTS, pb.ObjectsRequest(), ASK_WITHIN_S)
    objects = [_object_json(o) for o in sorted(reply.objects, key=lambda o: -o.score)]
    marked = [
        pb.MarkedObject(label=o.class_name, center_m=o.center_m, size_m=o.size_m, score=o.score)
        for o in reply.objects
    ]
    picture = bus.call(
        PICTURE,
        pb.PictureRequest(layer="occupancy", size_px=PICTURE_PX, objects=marked),
        ASK_WITHIN_S,
    )
    snapshot = bus.call(SNAPSHOT, pb.SnapshotRequest(layers=False), ASK_WITHIN_S)
    return Results(
        objects=objects,
        picture_png=picture.png,
        map=decode_snapshot(snapshot),
        summary={
            "frames": frames,
            "keyframes": acks.occupancy_frames,
            "before_search": status_count(service_table, "bridge", "keyframes_before_search"),
            "unreadable": unreadable_frames(service_table),
            "wall_s": round(wall_s, 3),
            "ms_per_frame": stage_medians_ms(acks, service_table),
            "refused": acks.refusals,
        },
    )


def unreadable_frames(service_table: ServiceTable) -> int:
    """Number of frames that the bridge skipped because they are unreadable."""
    return status_count(service_table, "bridge", "unreadable_frames")


def status_count(service_table: ServiceTable, service: str, name: str) -> int:
    """Count that a service reports; 0 if it reports none."""
    status = service_table.status(service)
    return int(status.metrics.get(name, 0)) if status else 0


def stage_medians_ms(acks: FrameAcks, service_table: ServiceTable) -> dict[str, float]:
    """Stage -> median milliseconds: maps from their acknowledgements, others from their
    statuses."""
    out = {"total": acks.pace_ms} | acks.median_ms()
    for service in ("bridge", "detector"):
        status = service_table.status(service)
        for name, value in status.metrics.items() if status else ():
            if name.endswith("_ms_median"):
                out[name.removesuffix("_ms_median")] = value
    return {stage: round(ms, 3) for stage, ms in sorted(out.items())}


def _object_json(o: pb.ObjectInstance) -> dict[str, Any]:
    return {
        "id": o.id,
        "class": o.class_name,
        "center_m": [o.center_m.x, o.center_m.y, o.center_m.z],
        "size_m": [o.size_m.x, o.size_m.y, o.size_m.z],
        "score": o.score,
        "class_score": o.class_score,
        "uncertainty": o.uncertainty,
        "views": o.views,
        "gaussians": o.gaussians,
        "probabilities": dict(sorted(o.probabilities.items())),
    }


def _json(value: Any) -> bytes:
    return json.dumps(_finite(value), indent=1, allow_nan=False).encode()


def _finite(value: Any) -> Any:
    """Value with None for each number that is not finite."""
    if isinstance(value, dict):
        return {name: _finite(one) for name, one in value.items()}
    if isinstance(value, list):
        return [_finite(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _replace(path: Path, data: bytes) -> None:
    try:
        write_file(path, data)
    except OSError as error:
        raise InvalidInput(
            f"{path} cannot be written: {error.strerror}; free up disk space, or name another "
            "folder with --out"
        ) from error


def _metres(v: list[float]) -> str:
    return " ".join(f"{x:.2f}" for x in v)
