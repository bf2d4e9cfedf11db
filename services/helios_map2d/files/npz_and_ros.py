"""Maps in formats of other programs: NPZ, and ROS map_server (`.pgm` and `.yaml`).

ROS: an image with its top row at the highest y, dark where occupied, and a text file with the cell
size and the world position of the lower-left corner. The format has no heights, values or evidence;
frame, stamp and pose are in a comment.
"""

from __future__ import annotations

import contextlib
import json
import math

import cv2
import numpy as np
from helios_core.codec.frames import FARTHEST_M
from helios_core.codec.images import encoded_size
from helios_core.errors import InvalidInput
from helios_core.map_snapshot import FREE, MAX_CELLS, OCCUPIED, UNKNOWN
from numpy.typing import NDArray

from helios_map2d.files.map_contents import MapContent, check_cell
from helios_map2d.grid import GridSpec
from helios_map2d.layers.parameters import MapRules
from helios_map2d.snapshots.snapshot import MapSnapshot, about, decode_npz, ground_of

FREE_GREY, OCCUPIED_GREY, UNKNOWN_GREY = 254, 0, 205  # values of map_saver


def encode_ros(snapshot: MapSnapshot, name: str = "map") -> dict[str, bytes]:
    """The .pgm and .yaml files of a version, by name."""
    grey = np.full(snapshot.grid.shape, UNKNOWN_GREY, np.uint8)
    grey[snapshot.occupancy == FREE] = FREE_GREY
    grey[snapshot.occupancy == OCCUPIED] = OCCUPIED_GREY
    rows, columns = grey.shape
    x_m, y_m = snapshot.grid.origin_m
    pgm = f"P5\n# HELIOS {snapshot.map_id} version {snapshot.version}\n{columns} {rows}\n255\n"
    text = (
        f"# HELIOS: {json.dumps(about(snapshot))}\n"
        f"image: {name}.pgm\nresolution: {snapshot.grid.cell_m:.9g}\n"
        f"origin: [{x_m:.9g}, {y_m:.9g}, 0.0]\nnegate: 0\noccupied_thresh: 0.65\n"
        "free_thresh: 0.196\nmode: trinary\n"
    )
    return {
        f"{name}.pgm": pgm.encode() + np.ascontiguousarray(grey[::-1]).tobytes(),
        f"{name}.yaml": text.encode(),
    }


def decode_ros(yaml: bytes, picture: bytes, rules: MapRules, version: int) -> MapContent:
    """Map content of map_server's two files, shifted by at most half a cell onto this grid.

    Obstacles get the full height of the obstacle band. All known cells count as searched until a
    search begins. Raises InvalidInput for damaged files, another cell size, or a rotated origin.
    """
    try:
        meta = flat_yaml(yaml.decode())
        resolution = float(meta["resolution"][0])
        x_m, y_m, yaw_rad = (float(v) for v in meta["origin"])
        negate, mode = int(meta.get("negate", ["0"])[0]), meta.get("mode", ["trinary"])[0]
        occupied = float(meta["occupied_thresh"][0])
        free = float(meta["free_thresh"][0])
    except (KeyError, IndexError, ValueError) as error:
        raise InvalidInput(
            f"this is no map_server YAML ({error}): wanted resolution, origin [x, y, yaw], "
            "occupied_thresh and free_thresh; send the one that map_saver wrote beside the picture"
        ) from error
    if not all(map(math.isfinite, (resolution, x_m, y_m, yaw_rad, occupied, free))):
        raise InvalidInput("the map_server YAML has numbers that are not finite: write them again")
    cell_m, band = rules.cell_m, rules.occupancy
    check_cell(resolution, cell_m)
    if abs(yaw_rad) > 1e-6:
        raise InvalidInput(
            f"the map's origin is turned by {yaw_rad} rad, wanted 0: turn the picture before you "
            "load it"
        )
    if mode not in ("trinary", "scale") or negate not in (0, 1) or not 0 <= free < occupied <= 1:
        raise InvalidInput(
            f"the map_server YAML has mode {mode[:40]!r}, negate {negate}, free_thresh {free} and "
            f"occupied_thresh {occupied}; wanted trinary or scale, 0 or 1, and thresholds from 0 "
            "to 1, that of free the lower: write them again"
        )
    if max(abs(x_m), abs(y_m)) > FARTHEST_M:
        raise InvalidInput(
            f"the map's origin is at ({x_m:g}, {y_m:g}) m, wanted within {FARTHEST_M:g} m: correct "
            "it in the YAML"
        )
    grey = _picture(picture)
    share = (grey[::-1] if negate else 255 - grey[::-1].astype(np.float32)) / 255.0
    occupancy = np.full(grey.shape, UNKNOWN, np.int8)
    occupancy[share < free] = FREE
    occupancy[share > occupied] = OCCUPIED
    corner = (round(y_m / cell_m), round(x_m / cell_m))
    grid = GridSpec(cell_m, grey.shape[0], grey.shape[1], corner)
    there = occupancy == OCCUPIED
    low_m, high_m = there * np.float32(band.band_lo_m), there * np.float32(band.band_hi_m)
    ground = ground_of(grid, version + 1, occupancy, occupancy != UNKNOWN, low_m, high_m)
    return MapContent(None, 0, "", dict(ground), {}, None, np.empty((0, 2)), (), {}, 1)


def _picture(data: bytes) -> NDArray[np.uint8]:
    """Grey values [rows, columns]. Raises InvalidInput for a damaged or too large image."""
    width, height = encoded_size(data) or (0, 0)  # a PGM is as large as its picture
    grey = None
    if width * height <= MAX_CELLS:
        with contextlib.suppress(cv2.error):  # no data, or a header with an excessive size
            grey = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
    if grey is None or grey.size == 0 or grey.size > MAX_CELLS:
        raise InvalidInput(
            f"these {len(data)} bytes are no picture of a map of up to {MAX_CELLS} cells: send "
            "the whole .pgm or .png that the YAML names"
        )
    return np.asarray(grey, np.uint8)


def flat_yaml(text: str) -> dict[str, list[str]]:
    """Values by key in the YAML subset of map_server: scalars, and lists in both styles."""
    out: dict[str, list[str]] = {}
    key = ""
    for raw in text.splitlines():
        line = raw.partition("#")[0].strip()
        if line.startswith("- ") and key:
            out[key].append(line[2:].strip())
        elif line:
            key, _, value = line.partition(":")
            parts = value.strip().strip("[]").split(",")
            out[key.strip()] = [p.strip().strip("\"'") for p in parts if p.strip()]
            key = key.strip()
    return out


def decode_exported(data: bytes, cell_m: float, version: int) -> MapContent:
    """Map content of an `encode_npz` file. Raises InvalidInput for any other data."""
    snapshot = decode_npz(data, version + 1)
    check_cell(snapshot.grid.cell_m, cell_m)
    return MapContent(
        snapshot.frame_id,
        snapshot.stamp_ns,
        snapshot.context_id,
        dict(snapshot.ground),
        {name: dict(tiles) for name, tiles in snapshot.layers.items()},
        snapshot.robot_pose,
        snapshot.trajectory_m,
        snapshot.trajectory_starts,
        {f.id: f.cells.astype(np.int32) for f in snapshot.frontiers},
        snapshot.next_frontier_id,
    )
