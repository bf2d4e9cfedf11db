"""The robot's trajectory and its separate pieces."""

from __future__ import annotations

import numpy as np
import pytest
from helios_core.errors import InvalidInput
from helios_core.map_snapshot import decode_snapshot
from helios_map2d.epochs import EpochMaps
from helios_map2d.files.map_file import decode_map, encode_map
from helios_map2d.layers.parameters import MapRules
from helios_map2d.snapshots import trajectory
from helios_map2d.snapshots.messages import snapshot_to_proto
from helios_map2d.snapshots.snapshot import decode_npz, encode_npz
from helios_map2d.snapshots.trajectory import Trajectory
from hypothesis import given, settings
from hypothesis import strategies as st
from map2d_scene import Walk, room

RULES = MapRules(size_cells=400)


@settings(max_examples=60)
@given(st.lists(st.booleans(), max_size=60), st.integers(4, 12))
def test_thinning_a_trajectory_never_joins_or_mixes_its_pieces(
    parted: list[bool], most: int
) -> None:
    way, piece = Trajectory(0.1), 0
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(trajectory, "MOST_POINTS", most)
        for x, part in enumerate(parted):
            if part:
                way.part()
                piece += 1
            way.follow(float(x), float(piece))  # y is the number of the piece
    assert len(way.points_m) <= most
    for one in np.split(way.points_m, way.starts):
        assert len(set(one[:, 1])) <= 1
    assert len(np.unique(way.points_m[:, 1])) == len(way.starts) + (len(parted) > 0)
    np.testing.assert_array_equal(way.points_m, way.points_m[np.argsort(way.points_m[:, 0])])


@pytest.mark.parametrize("starts", [(0,), (3,), (2, 1), (1, 1), (-1,)])
def test_invalid_starts_of_trajectory_pieces_are_refused(starts: tuple[int, ...]) -> None:
    with pytest.raises(InvalidInput, match="begin at"):
        Trajectory(0.1, np.zeros((3, 2)), starts)


def test_no_line_joins_the_trajectory_of_a_loaded_map_to_the_robot() -> None:
    walk, maps = Walk(room()), EpochMaps(RULES, 0.2)
    for x in (1.0, 1.3, 1.6):
        frame = walk.frame(x, 1.5, 0.0)
        maps.map_for(frame).integrate_frame(frame)
    assert maps.current is not None
    file = encode_map(maps.current.published, (), frame.world)
    later = EpochMaps(RULES, 0.2)
    frame = walk.frame(3.0, 2.5, 0.0)
    later.map_for(frame).integrate_frame(frame)
    later.replace(decode_map(file, RULES, 0.2, 0)[0])
    for x in (3.0, 3.2):
        frame = walk.frame(x, 2.5, 0.0)
        later.map_for(frame).integrate_frame(frame)
    assert later.current is not None
    now = later.current.published
    assert now.trajectory_m[:, 0].tolist() == pytest.approx([1.0, 1.3, 1.6, 3.0, 3.2])
    assert now.trajectory_starts == (3,)
    # The wire message and both file formats carry it.
    assert decode_snapshot(snapshot_to_proto(now, False)).trajectory_starts == (3,)
    assert decode_npz(encode_npz(now)).trajectory_starts == (3,)
    again, _ = decode_map(encode_map(now, (), frame.world), RULES, 0.2, 0)
    assert again.published.trajectory_starts == (3,)
