"""The Gaussians as a point cloud, and grids as meshes."""

from __future__ import annotations

import numpy as np
import pytest
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from helios_core.errors import InvalidInput
from helios_core.viewing.gaussian_cloud import SPLAT, gaussian_entry, splats
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tests.unit.recorder.recorder_maps import gaussians_of


def test_each_gaussian_is_a_point_with_its_opacity_size_and_probability() -> None:
    entry = gaussian_entry(gaussians_of(4), 5)
    assert isinstance(entry.message, PointCloud)
    points = np.frombuffer(entry.message.data, SPLAT)
    np.testing.assert_array_equal(points["x"], [0, 1, 2, 3])
    np.testing.assert_array_equal(points["alpha"], 128)
    np.testing.assert_allclose(points["radius"], 0.01)
    np.testing.assert_allclose(points["probability"], 0.75)
    assert [f.name for f in entry.message.fields] == list(SPLAT.names or ())


def test_lengths_that_differ_are_refused() -> None:
    reply = gaussians_of(4)
    reply.count = 5
    with pytest.raises(InvalidInput, match="do not fit"):
        gaussian_entry(reply, 0)


@given(arrays(np.float32, (3, 3)))
def test_no_point_is_at_an_invalid_place(means_m: np.ndarray) -> None:
    reply = gaussians_of(3)
    reply.means_m = means_m.astype("<f4").tobytes()
    points = splats(reply)
    assert len(points) == np.isfinite(means_m).all(axis=1).sum()


def test_a_cloud_without_a_needed_field_is_refused() -> None:
    pytest.importorskip("rerun", reason="pip install 'helios-ovmm[rerun]'")
    from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
    from helios_viewers.rerun_grids import cloud_points

    fields = [
        PackedElementField(name=name, offset=4 * k, type=PackedElementField.FLOAT32)
        for k, name in enumerate("xyz")
    ]
    with pytest.raises(InvalidInput, match="has no field alpha, blue, green, red"):
        cloud_points(PointCloud(point_stride=12, fields=fields, data=bytes(24)))


@given(st.data())
def test_a_grid_mesh_covers_exactly_the_drawn_cells(data: st.DataObject) -> None:
    pytest.importorskip("rerun", reason="pip install 'helios-ovmm[rerun]'")
    from helios_core.map_snapshot import decode_snapshot
    from helios_core.viewing.map_entries import occupancy_grid
    from helios_viewers.rerun_grids import grid_mesh

    from tests.unit.recorder.recorder_maps import snapshot_of

    cells = data.draw(arrays(np.int8, (5, 7), elements=st.sampled_from([-1, 0, 100])))
    mesh = grid_mesh(occupancy_grid(decode_snapshot(snapshot_of(cells)), 0))
    assert mesh.vertex_positions is not None
    corners = np.array(mesh.vertex_positions.as_arrow_array().to_pylist()).reshape(-1, 4, 3)
    covered = np.zeros(cells.shape, int)
    for box in corners:
        low = np.rint((box.min(axis=0)[:2] - (-1.0, 0.5)) / 0.05).astype(int)
        high = np.rint((box.max(axis=0)[:2] - (-1.0, 0.5)) / 0.05).astype(int)
        covered[low[1] : high[1], low[0] : high[0]] += 1
    np.testing.assert_array_equal(covered, cells >= 0)
