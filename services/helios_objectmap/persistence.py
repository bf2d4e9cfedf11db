"""File format of the object map: an NPZ with a header, validated as a whole before any part is
used.

The arrays are those of the store, one row per Gaussian; the header (JSON) holds the rest. Every
member carries the checksum of the zip format, so a truncated or damaged file is refused.
"""

from __future__ import annotations

import io
import json
import zipfile
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from helios_core.codec.frames import FARTHEST_M, LATEST_S, frame_id_to_proto
from helios_core.errors import InvalidInput
from helios_core.npz_reading import one_array, unpacked
from helios_core.types import FrameId, Role, WorldId
from numpy.typing import NDArray

from helios_objectmap.fusion import viewing_sectors
from helios_objectmap.gaussians import NO_INSTANCE, OTHER, GaussianStore
from helios_objectmap.instances.detector_precision import N_BANDS, FormerDetections
from helios_objectmap.instances.image_text import ImageTextScores
from helios_objectmap.instances.name_sightings import NameSightings
from helios_objectmap.instances.registry import InstanceRecord, InstanceRegistry, Moment
from helios_objectmap.viewpoint_weights import NEVER, Viewpoints

FORMAT = "helios-objectmap"
VERSION = 1
VOTES = "store.votes"
HEADER_BYTES = 256 << 20  # more than the header of any map
MOST_UPDATES = 1 << 53  # in the life of a map
MOST_LABELS = 1 << 26  # in the life of a map; the table of their Gaussians takes 8 bytes for each
PACKING_LEVEL = 1  # of zlib: a seventh of the size in half a second for 100 MB


@dataclass(frozen=True)
class MapContent:
    """Complete content of a map, without the current search context."""

    store: GaussianStore
    registry: InstanceRegistry
    viewpoints: Viewpoints
    roles: dict[str, Role]
    updates: int
    sightings: NameSightings = field(default_factory=NameSightings)
    image_text: ImageTextScores = field(default_factory=ImageTextScores)
    added_updates: list[int] = field(default_factory=list)  # numbers of those that added a map


def arrays_of(
    content: MapContent, world: WorldId | None, newest: FrameId | None = None
) -> dict[str, NDArray]:
    """Copies of the whole map content, so that updates can continue while the file is written.

    world: world of the map; newest: newest frame in it.
    """
    header: dict[str, Any] = {
        "format": FORMAT,
        "version": VERSION,
        "class_names": content.store.class_names,
        "roles": {name: role.value for name, role in content.roles.items()},
        "updates": content.updates,
        "added_updates": content.added_updates,
        "epoch": None if world is None else [world.robot_boot_id, world.world_epoch],
        "origin_id": "" if world is None else world.origin_id,
        "newest_seq": None if newest is None else newest.seq,
        "newest_boot_id": None if newest is None else newest.robot_boot_id,
        "next_label": content.registry.next_label,
        "records": {
            label: [
                r.class_name,
                r.views,
                r.detected,
                [[m.stamp_ns, m.views, m.score, m.class_score] for m in r.history],
                r.detected_at.tolist(),
                r.in_core,
            ]
            for label, r in content.registry.records.items()
        },
        "ended": {
            name: [e.true.tolist(), e.all.tolist()] for name, e in content.registry.ended.items()
        },
    }
    text = np.frombuffer(json.dumps(header).encode(), np.uint8)
    rows = {f"store.{name}": a for name, a in content.store.arrays().items()}
    views = {f"viewpoints.{name}": a for name, a in content.viewpoints.arrays().items()}
    named = {f"sightings.{name}": a for name, a in content.sightings.arrays().items()}
    rated = {f"image_text.{name}": a for name, a in content.image_text.arrays().items()}
    return {"header": text} | rows | views | named | rated


def to_bytes(arrays: dict[str, NDArray]) -> bytes:
    """Bytes of the file: an NPZ. The votes by viewing sector, mostly zeros, are compressed."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as file:
        for name, array in arrays.items():
            member = io.BytesIO()
            np.lib.format.write_array(member, np.asanyarray(array), allow_pickle=False)
            method = zipfile.ZIP_DEFLATED if name == VOTES else zipfile.ZIP_STORED
            file.writestr(f"{name}.npy", member.getbuffer(), method, PACKING_LEVEL)
    return out.getvalue()


@dataclass(frozen=True)
class LoadedMap:
    """Content of a map file."""

    content: MapContent
    world: WorldId | None  # of the map
    newest: FrameId | None  # newest frame in the map


def read(data: bytes, viewpoints: Viewpoints) -> LoadedMap:
    """Content of a map file. viewpoints: an empty object, which is filled.

    Raises InvalidInput for a truncated, damaged or foreign file, and, before it is unpacked, for a
    file that holds too much data.
    """
    try:
        arrays = unpacked(data)
        header = json.loads(arrays.pop("header").tobytes())
        if header["format"] != FORMAT or header["version"] != VERSION:
            raise InvalidInput(
                f"the file is {header['format']!r} version {header['version']}; wanted "
                f"{FORMAT!r} version {VERSION}; use the HELIOS that wrote it, or start with an "
                "empty map"
            )
        content = _content(header, arrays, viewpoints)
        world, newest = _place(header)
    except InvalidInput:
        raise
    except Exception as error:  # any error of the ZIP, array and JSON readers
        raise InvalidInput(
            f"this is no whole object map ({type(error).__name__}: {error}): give a file that "
            "`helios map save` wrote"
        ) from None
    return LoadedMap(content, world, newest)


def world_of(data: bytes) -> WorldId | None:
    """World of a map file; None if the file names none or cannot be read (see `read`)."""
    try:
        return _place(json.loads(one_array(data, "header", HEADER_BYTES).tobytes()))[0]
    except Exception:  # `read` gives the reason
        return None


def _place(header: dict[str, Any]) -> tuple[WorldId | None, FrameId | None]:
    """World of the map, and the newest frame in it. Files of earlier builds lack some of the
    fields. Raises ValueError for numbers that a message cannot hold."""
    if not header["epoch"]:
        return None, None
    boot_id, epoch = str(header["epoch"][0]), int(header["epoch"][1])
    world = WorldId(boot_id, epoch, str(header.get("origin_id", "")))
    seq, newest_boot_id = header.get("newest_seq"), header.get("newest_boot_id", boot_id)
    newest = None if seq is None else FrameId(str(newest_boot_id), epoch, int(seq))
    frame_id_to_proto(newest or FrameId(boot_id, epoch, 0))
    return world, newest


def _content(header: dict, arrays: dict[str, NDArray], viewpoints: Viewpoints) -> MapContent:
    def part(prefix: str) -> dict[str, NDArray]:
        return {k.removeprefix(prefix): a for k, a in arrays.items() if k.startswith(prefix)}

    rows = part("store.")
    # Files of maps without viewing sectors, and of earlier builds, have no votes.
    store = GaussianStore(viewing_sectors.SECTORS if "votes" in rows else 0)
    for name in header["class_names"]:
        store.column(str(name))
    viewpoints.fill(part("viewpoints."))
    registry = InstanceRegistry()
    registry.next_label = int(header["next_label"])
    registry.records = {int(label): _record(*r) for label, r in header["records"].items()}
    registry.ended = {
        str(name): FormerDetections(_by_band(true), _by_band(everything))
        for name, (true, everything) in header.get("ended", {}).items()
    }
    roles = {str(name): Role(role) for name, role in header["roles"].items()}
    _check_references(rows, store.class_names, registry, roles, viewpoints)
    _check_numbers(rows)
    updates = int(header["updates"])
    if not 0 <= updates <= MOST_UPDATES:
        raise ValueError(f"the map has {updates} updates, not 0 to {MOST_UPDATES}")
    store.fill(rows)
    faint = [label for label, record in registry.records.items() if not record.in_core]
    store.in_core[store.instances.rows_of(np.array(faint, np.int64))] = False
    added = [int(number) for number in header.get("added_updates", ())]
    out = MapContent(store, registry, viewpoints, roles, updates, added_updates=added)
    if named := part("sightings."):  # files of earlier builds have none
        out.sightings.add_arrays(named)
    if rated := part("image_text."):
        out.image_text.add_arrays(rated)
    return out


def _record(
    name: str,
    views: float,
    detected: float,
    history: list,
    detected_at: list | None = None,
    in_core: bool = True,
) -> InstanceRecord:
    """Instance record of a file. Files of earlier builds lack the last two fields. Raises
    ValueError for numbers that a message cannot hold."""
    numbers = [float(views), float(detected), *(float(n) for moment in history for n in moment)]
    if not np.isfinite(numbers).all():
        raise ValueError(f"a number of an instance of {str(name)[:40]!r} is not finite")
    if any(abs(moment[0]) > LATEST_S * 10**9 for moment in history):
        raise ValueError(
            f"the history of an instance of {str(name)[:40]!r} has a time of more than {LATEST_S} s"
        )
    return InstanceRecord(
        str(name),
        float(views),
        float(detected),
        _by_band([0.0, detected, 0.0] if detected_at is None else detected_at),
        [Moment(int(t), float(v), float(s), float(c)) for t, v, s, c in history],
        bool(in_core),
    )


def _by_band(values: list) -> NDArray[np.float64]:
    out = np.array(values, np.float64)
    if out.shape != (N_BANDS,) or not np.isfinite(out).all():
        raise ValueError(f"{values} are no {N_BANDS} numbers of detections")
    return out


def _check_references(
    rows: dict[str, NDArray],
    class_names: list[str],
    registry: InstanceRegistry,
    roles: dict[str, Role],
    viewpoints: Viewpoints,
) -> None:
    """Check that instances, classes and viewpoints of the Gaussians are there. Raises ValueError.

    rows: arrays of the store by their names in the file.
    """
    if not NO_INSTANCE < registry.next_label <= MOST_LABELS:
        raise ValueError(f"the next instance is {registry.next_label}, not 1 to {MOST_LABELS}")
    instance, believed, through = rows["instance"], rows["believed"], rows["through_from"]
    if instance.min(initial=NO_INSTANCE) < NO_INSTANCE:
        raise ValueError("an instance is below 0")
    labels = set(np.unique(instance).tolist()) - {NO_INSTANCE}
    if labels != set(registry.records) or max(labels, default=0) >= registry.next_label:
        raise ValueError("instances and Gaussians disagree")
    names = {r.class_name for r in registry.records.values()} | set(class_names)
    if not names <= roles.keys() or not names <= set(class_names):
        raise ValueError("classes and their roles disagree")
    if believed.min(initial=OTHER) < OTHER or believed.max(initial=OTHER) >= len(class_names):
        raise ValueError("a Gaussian is believed to be of no known class")
    if through.min(initial=NEVER) < NEVER or through.max(initial=NEVER) >= len(viewpoints):
        raise ValueError("a Gaussian was seen through from a viewpoint that is not there")


def _check_numbers(rows: dict[str, NDArray]) -> None:
    """Check that all numbers of the Gaussians are in their range. Raises ValueError."""
    means, radius_m, opacity = rows["means"], rows["radius_m"], rows["opacity"]
    if not all(np.isfinite(a).all() for a in (means, rows["positive"], rows["asked"])):
        raise ValueError("a number is not finite")
    if not all(np.isfinite(a).all() for a in (radius_m, opacity)):
        raise ValueError("a radius or an opacity is not finite")
    if (np.abs(means) > FARTHEST_M).any():
        raise ValueError(f"a Gaussian is more than {FARTHEST_M:g} m from the origin")
    if (radius_m <= 0).any() or (opacity < 0).any() or (opacity > 1).any():
        raise ValueError("a radius is not above 0, or an opacity not from 0 to 1")
    if (rows["positive"] < 0).any() or (rows["asked"] < 0).any():
        raise ValueError("evidence is below 0")
    if "votes" in rows and (rows["votes"][..., 0] > rows["votes"][..., 1]).any():
        raise ValueError("more votes are for a class than there are")
