"""Requests of the newest 2D map by those who show it, and the blank map that replaces it."""

from __future__ import annotations

import numpy as np
import pytest
from helios_core import proto as pb
from helios_core.map_snapshot import OCCUPIED, UNKNOWN, decode_snapshot
from helios_core.viewing.newest_map import blank_map, is_empty, newest_snapshot

from tests.unit.recorder.recorder_maps import snapshot_of


class Map2D:
    """Answers as map2d does."""

    def __init__(self, version: int, map_id: str, unchanged_id: str | None = None) -> None:
        """unchanged_id: id in a reply `unchanged`; None: that of the map."""
        self.map = snapshot_of(np.zeros((2, 3), np.int8), version=version)
        self.map.map_id = map_id
        self.unchanged_id = map_id if unchanged_id is None else unchanged_id
        self.asked: list[pb.SnapshotRequest] = []

    def ask(self, request: pb.SnapshotRequest) -> pb.MapSnapshot:
        self.asked.append(request)
        if request.if_newer and request.if_newer == self.map.version:
            return pb.MapSnapshot(
                version=self.map.version, map_id=self.unchanged_id, unchanged=True
            )
        return self.map


@pytest.mark.parametrize(("version", "map_id"), [(0, ""), (11, "a"), (13, "a"), (11, "b")])
def test_a_map_of_another_version_comes_with_one_request(version: int, map_id: str) -> None:
    map2d = Map2D(12, "a")
    assert newest_snapshot(map2d.ask, version, map_id) == map2d.map
    assert len(map2d.asked) == 1
    assert map2d.asked[0].layers


def test_the_map_held_is_reported_as_unchanged_with_one_request() -> None:
    map2d = Map2D(12, "a")
    assert newest_snapshot(map2d.ask, 12, "a").unchanged
    assert len(map2d.asked) == 1


@pytest.mark.parametrize("held", ["b", ""])
def test_the_whole_map_comes_if_only_its_id_differs(held: str) -> None:
    map2d = Map2D(12, "a")
    assert newest_snapshot(map2d.ask, 12, held) == map2d.map
    assert all(request.layers for request in map2d.asked)


def test_an_unchanged_reply_of_an_earlier_release_without_an_id_is_believed() -> None:
    map2d = Map2D(12, "a", unchanged_id="")
    assert newest_snapshot(map2d.ask, 12, "b").unchanged
    assert len(map2d.asked) == 1


def test_a_missing_answer_is_passed_on() -> None:
    def silent(_: pb.SnapshotRequest) -> pb.MapSnapshot | None:
        return None

    assert newest_snapshot(silent, 12, "a") is None


def test_only_a_reply_without_cells_is_empty() -> None:
    assert is_empty(pb.MapSnapshot())
    assert is_empty(pb.MapSnapshot(version=5, map_id="a"))
    assert not is_empty(snapshot_of(np.zeros((2, 3), np.int8)))


def test_a_blank_map_has_one_unknown_cell_and_no_other_content() -> None:
    full = decode_snapshot(
        snapshot_of(np.full((2, 3), OCCUPIED, np.int8), values={"a": np.ones((2, 3), np.float32)})
    )
    blank = blank_map(full)
    assert blank.occupancy.tolist() == [[UNKNOWN]]
    assert blank.shape == blank.explored.shape == blank.top_m.shape == (1, 1)
    assert (blank.cell_m, blank.origin_m) == (full.cell_m, full.origin_m)
    parts = (blank.values, blank.frontiers, blank.trajectory_m, blank.trajectory_starts)
    assert [len(part) for part in parts] == [0, 0, 0, 0]
