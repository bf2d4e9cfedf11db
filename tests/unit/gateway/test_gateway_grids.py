"""Map snapshots are decoded exactly, or refused."""

from __future__ import annotations

import json
import zlib

import numpy as np
import pytest
from helios_core import proto as pb
from helios_core.errors import InvalidInput
from helios_core.map_snapshot import FREE, OCCUPIED, UNKNOWN, decode_snapshot
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_gateway.map_cache import MapCache
from hypothesis import given
from hypothesis import strategies as st

from tests.gateway_home import snapshot


@given(
    rows=st.integers(1, 9),
    columns=st.integers(1, 9),
    seed=st.integers(0, 99),
    layered=st.booleans(),
)
def test_a_snapshot_is_decoded_exactly(rows: int, columns: int, seed: int, layered: bool) -> None:
    rng = np.random.default_rng(seed)
    shape = (rows, columns)
    occupancy = rng.choice(np.array([UNKNOWN, FREE, OCCUPIED], np.int8), shape)
    explored = rng.integers(0, 2, shape, np.uint8)
    top = rng.integers(0, 3000, shape).astype("<u2")
    value = rng.random(shape).astype("<f2")
    message = pb.MapSnapshot(
        version=5,
        cell_m=0.025,
        width=columns,
        height=rows,
        trajectory_m=[1, 2, 3, 4],
        occupancy=zlib.compress(occupancy.tobytes()),
        explored=zlib.compress(explored.tobytes()),
        top_mm=zlib.compress(top.tobytes()),
        values={"pick": zlib.compress(value.tobytes())} if layered else {},
    )
    view = decode_snapshot(message)
    assert view.shape == shape
    assert np.array_equal(view.occupancy, occupancy)
    assert np.array_equal(view.explored, explored > 0)
    assert np.allclose(view.top_m, top * 0.001, atol=1e-5)
    assert view.trajectory_m.tolist() == [[1, 2], [3, 4]]
    if layered:
        assert np.array_equal(view.values["pick"], value.astype(np.float32))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"occupancy": b""}, "cells without occupancy; send it"),
        ({"occupancy": b"no zlib"}, "corrupt: .*; send it whole"),
        ({"occupancy": zlib.compress(bytes(10))}, "10 bytes unpacked, .* wanted; send all rows"),
        ({"explored": zlib.compress(bytes(10**7))}, "explored of the map"),
        ({"width": 2**31}, "million"),
        ({"cell_m": float("nan")}, "cells above 0 m"),
        ({"cell_m": -1.0}, "cells above 0 m"),
        ({"trajectory_m": [1.0, 2.0, 3.0]}, "trajectory"),
    ],
)
def test_an_inconsistent_snapshot_is_refused(change: dict, says: str) -> None:
    message = snapshot(1, (0.0, 0.0, 0.0))
    message.ClearField("trajectory_m")
    for name, value in change.items():
        if name == "trajectory_m":
            message.trajectory_m.extend(value)
        else:
            setattr(message, name, value)
    with pytest.raises(InvalidInput, match=says):
        decode_snapshot(message)


def test_arrays_that_a_planner_does_not_ask_for_may_be_missing() -> None:
    cells = zlib.compress(np.full((2, 3), OCCUPIED, np.int8).tobytes())
    view = decode_snapshot(pb.MapSnapshot(cell_m=0.05, width=3, height=2, occupancy=cells))
    assert view.occupancy.tolist() == [[OCCUPIED] * 3] * 2
    assert not view.explored.any()
    assert not view.top_m.any()
    assert decode_snapshot(pb.MapSnapshot()).shape == (0, 0)


def test_a_value_layer_without_values_is_refused() -> None:
    message = snapshot(1, (0.0, 0.0, 0.0))
    message.values["pick"] = b""
    with pytest.raises(InvalidInput, match="value layer pick of the map"):
        decode_snapshot(message)


def test_a_map_that_changes_while_its_description_is_made_is_described_next_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    maps = MapCache(MemoryBus(MemoryHub()), 1.0)
    views = [decode_snapshot(snapshot(version, (0.0, 0.0, 0.0))) for version in (41, 42)]
    monkeypatch.setattr(maps, "view", iter(views).__next__)
    assert [json.loads(maps.info_json().content)["version"] for _ in views] == [41, 42]
