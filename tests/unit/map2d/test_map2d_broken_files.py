"""Truncated, foreign or damaged map files: each is refused with the reason, and the present map
stays."""

from __future__ import annotations

import hashlib
import io
import json
import math
import struct
from collections.abc import Callable

import cv2
import numpy as np
import pytest
from helios_core import proto as pb
from helios_core.errors import InvalidInput
from helios_map2d.files.map_file import HEAD
from map2d_kept import load, saved, state_of, walked
from map2d_rig import Rig

PICTURE = b"P5\n20 10\n255\n" + bytes([254] * 200)


@pytest.fixture(scope="module")
def rig() -> Rig:
    return walked("--size-cells", "320")


def assert_refused(rig: Rig, reason: str, *files: tuple[str, bytes]) -> None:
    state = state_of(rig)
    before = state.published
    with pytest.raises(InvalidInput, match=reason):
        load(rig, [pb.Map2DFile(name=name, data=data) for name, data in files])
    assert state_of(rig) is state
    assert state.published is before


def yaml(**other: str) -> bytes:
    lines = {
        "resolution": "0.025",
        "origin": "[0, 0, 0]",
        "occupied_thresh": "0.65",
        "free_thresh": "0.196",
        **other,
    }
    return "\n".join(f"{key}: {value}" for key, value in lines.items()).encode()


@pytest.mark.parametrize(
    ("about", "reason"),
    [
        (yaml(resolution="0"), "0.0 m wide, wanted more than 0"),
        (yaml(resolution="-0.025"), "wanted more than 0"),
        (yaml(resolution="inf"), "not finite"),
        (yaml(origin="[0, 0]"), r"wanted resolution, origin \[x, y, yaw\]"),
        (yaml(origin="[1e300, 0, 0]"), r"1e\+300, 0\) m, wanted within"),
        (yaml(occupied_thresh="0.1", free_thresh="0.9"), "free_thresh 0.9 and occupied_thresh 0.1"),
        (yaml(occupied_thresh="65", free_thresh="19"), "thresholds from 0 to 1"),
        (yaml(negate="7"), "negate 7"),
        (yaml(mode="raw"), "mode 'raw'"),
        (b"origin: [0, 0, 0]", "'resolution'"),
        (b"\xff\xfe\0", "no map_server YAML"),
    ],
)
def test_an_invalid_map_server_yaml_is_refused(rig: Rig, about: bytes, reason: str) -> None:
    assert_refused(rig, reason, ("m.yaml", about), ("m.pgm", PICTURE))


@pytest.mark.parametrize(
    "picture",
    [
        b"",
        PICTURE[:60],
        b"P5\n100000 100000\n255\n",
        b"P5\n-20 10\n255\n" + bytes(200),
        b"P5\n20 10\n99999\n" + bytes(400),
        b"P6\n20 10\n255\n" + bytes(200),
    ],
)
def test_an_invalid_or_truncated_map_image_is_refused(rig: Rig, picture: bytes) -> None:
    assert_refused(rig, "no picture of a map", ("m.yaml", yaml()), ("m.pgm", picture))


def test_a_too_large_map_image_is_refused_before_decoding(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    png = b"\x89PNG\r\n\x1a\n" + struct.pack(">I4sII", 13, b"IHDR", 8001, 8000)
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("it was decoded"))
    assert_refused(rig, "up to 64000000 cells", ("m.yaml", yaml()), ("m.png", png))


def test_two_maps_in_one_load_are_refused(rig: Rig) -> None:
    (file,) = saved(rig, "map")
    assert_refused(rig, "send one map at a time", ("a.map", file.data), ("b.map", file.data))


Edit = Callable[[pb.KeptMap], object]


def moved(message: pb.KeptMap, row: int) -> None:
    message.ground[0].row = row


@pytest.mark.parametrize(
    ("edit", "reason"),
    [
        (lambda m: m.trajectory_m.append(1.0), "not x, y"),
        (lambda m: m.frontiers[0].cells.append(3), "not x, y"),
        (lambda m: m.trajectory_starts.append(7), "pieces of a way"),
        (lambda m: setattr(m.robot, "yaw_rad", math.nan), "poses are not finite"),
        (lambda m: setattr(m.robot, "x_m", 1e300), "from the world's origin"),
        (lambda m: setattr(m, "cell_m", math.nan), "nan m wide"),
        (lambda m: setattr(m, "tile_cells", 32), "tiles of 32 cells"),
        (lambda m: setattr(m, "version", 2**64 - 1), "version 18446744073709551615, wanted less"),
        (lambda m: moved(m, -(2**31)), "from the world's origin"),
        (lambda m: setattr(m, "next_frontier_id", 2**62), "frontiers are damaged"),
        (lambda m: setattr(m.values[0], "layer", "x" * 1000), "a name of 1000 characters"),
        (lambda m: setattr(m.views[0], "heading_x", 9.0), "a kept view at"),
        (lambda m: setattr(m.views[0], "half_fov_rad", 0.0), "half a field of view of 0"),
    ],
)
def test_a_map_file_with_invalid_content_is_refused(rig: Rig, edit: Edit, reason: str) -> None:
    (file,) = saved(rig, "map")
    message = pb.KeptMap.FromString(file.data[len(HEAD) + 32 :])
    edit(message)
    body = message.SerializeToString()
    assert_refused(rig, reason, ("a.map", HEAD + hashlib.sha256(body).digest() + body))


@pytest.mark.parametrize(
    ("key", "value", "reason"),
    [
        ("robot_pose", [None, 0, 0], "no map snapshot"),
        ("robot_pose", [0, 0, math.nan], "poses are not finite"),
        ("frame_id", ["a", "b", "c"], "no map snapshot"),
        ("frame_id", ["a", 1, -5], "out of range"),
        ("stamp_ns", 10**30, "out of range"),
        ("context_id", 5, "no map snapshot"),
        ("next_frontier_id", -7, "frontiers are damaged"),
        ("grid", {"cell_m": math.nan, "rows": 2, "columns": 2, "corner": [0, 0]}, "its grid"),
        ("grid", {"cell_m": 0.025, "corner": [0, 0]}, "'rows'"),
    ],
)
def test_an_export_with_invalid_metadata_is_refused(
    rig: Rig, key: str, value: object, reason: str
) -> None:
    assert_refused(rig, reason, ("a.npz", changed_export(rig, {key: value})))


@pytest.mark.parametrize(
    ("name", "fill", "reason"),
    [
        ("occupancy", np.int8(50), "neither -1"),
        ("occupancy", np.float32(math.nan), "whole numbers"),
        ("explored_for_search", np.uint8(7), "neither 0 nor 1"),
        ("z_high_m", np.float32(math.nan), "height is not finite"),
        ("value_pick", np.float32(math.nan), "layer 'pick'"),
        ("confidence_pick", np.float32(-1.0), "confidences below 0"),
    ],
)
def test_an_export_with_invalid_cells_is_refused(
    rig: Rig, name: str, fill: np.generic, reason: str
) -> None:
    assert_refused(rig, reason, ("a.npz", changed_export(rig, {}, name, fill)))


def test_an_oversized_export_is_refused_before_unpacking(rig: Rig) -> None:
    data = changed_export(rig, {})
    at = data.rindex(b"PK\x01\x02") + 24  # the unpacked size of the last entry of the ZIP
    bomb = data[:at] + (3 * 2**30).to_bytes(4, "little") + data[at + 4 :]
    assert_refused(rig, r"unpacks to 3221\d+, wanted at most 2147483648", ("a.npz", bomb))


def changed_export(
    rig: Rig, meta: dict[str, object], name: str = "", fill: np.generic | None = None
) -> bytes:
    """An export with some of its metadata replaced, and one array filled with a value."""
    (file,) = saved(rig, "npz")
    with np.load(io.BytesIO(file.data)) as kept:
        arrays = dict(kept)
    arrays["meta"] = np.array(json.dumps({**json.loads(str(arrays["meta"])), **meta}))
    if fill is not None:
        arrays[name] = np.full_like(arrays[name], fill, dtype=fill.dtype)
    stream = io.BytesIO()
    np.savez(stream, allow_pickle=False, **arrays)
    return stream.getvalue()
