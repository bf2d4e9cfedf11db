"""Grids and point clouds as Rerun's meshes, points and Gaussian splats. No I/O."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rerun as rr
from foxglove_schemas_protobuf.Grid_pb2 import Grid
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from helios_core.errors import InvalidInput
from numpy.typing import NDArray

NUMERIC = {
    PackedElementField.UINT8: "u1",
    PackedElementField.INT8: "i1",
    PackedElementField.UINT32: "<u4",
    PackedElementField.FLOAT32: "<f4",
}
POSITION, COLOR = ("x", "y", "z"), ("red", "green", "blue", "alpha")
POINT_M = 0.02  # radius of a drawn point


def grid_mesh(grid: Grid) -> rr.Mesh3D:
    """The cells that are not transparent, as a textured mesh at the grid's place.

    Rerun ignores the transparency of a texture, so the mesh has one rectangle for each run of drawn
    cells in a row. Raises InvalidInput if the data does not fit.
    """
    rows, columns = _shape(grid)
    cells = _elements(grid.data, grid.cell_stride, grid, COLOR).reshape(rows, columns)
    drawn = np.zeros((rows, columns + 2), np.int8)
    drawn[:, 1:-1] = cells["alpha"] > 0
    steps = np.diff(drawn, axis=1)
    row, begin = np.nonzero(steps == 1)
    _, end = np.nonzero(steps == -1)  # in the same order: row by row
    x, y = np.stack([begin, end, end, begin], 1), np.stack([row, row, row + 1, row + 1], 1)
    corner = grid.pose.position
    at = np.zeros((len(row), 4, 3), np.float32)
    at[..., 0] = corner.x + x * grid.cell_size.x
    at[..., 1] = corner.y + y * grid.cell_size.y
    at[..., 2] = corner.z
    shares = np.stack([x / columns, y / rows], -1).astype(np.float32)
    first = 4 * np.arange(len(row), dtype=np.uint32)[:, None, None]
    corners = first + np.array([[0, 1, 2], [0, 2, 3]], np.uint32)
    rgb = np.stack([cells["red"], cells["green"], cells["blue"]], -1)
    return rr.Mesh3D(
        vertex_positions=at.reshape(-1, 3),
        triangle_indices=corners.reshape(-1, 3),
        vertex_texcoords=shares.reshape(-1, 2),
        albedo_texture=rgb,
    )


def cloud_points(cloud: PointCloud) -> rr.Points3D:
    """Coloured points. Raises InvalidInput if the data does not fit."""
    points = _elements(cloud.data, cloud.point_stride, cloud, (*POSITION, *COLOR))
    return rr.Points3D(_positions(points), colors=_rgba(points), radii=POINT_M)


def cloud_splats(cloud: PointCloud) -> rr.GaussianSplats3D:
    """The Gaussians of the object map: round, with their colour, opacity and standard deviation.

    Raises InvalidInput if the data does not fit.
    """
    points = _elements(cloud.data, cloud.point_stride, cloud, (*POSITION, *COLOR, "radius"))
    return rr.GaussianSplats3D(
        _positions(points),
        scales=np.repeat(points["radius"][:, None], 3, axis=1),
        quaternions=np.tile(np.array([0, 0, 0, 1], np.float32), (len(points), 1)),
        colors=_rgba(points),
    )


def _shape(grid: Grid) -> tuple[int, int]:
    """(rows, columns). Raises InvalidInput for padded or incomplete rows."""
    stride = grid.column_count * grid.cell_stride
    if stride == 0 or grid.row_stride != stride or len(grid.data) % stride:
        raise InvalidInput(
            f"a grid has {len(grid.data)} bytes and rows of {grid.row_stride}; wanted rows of "
            f"{stride} bytes"
        )
    return len(grid.data) // stride, grid.column_count


def _elements(
    data: bytes, stride: int, of: Grid | PointCloud, needed: Sequence[str]
) -> NDArray[np.void]:
    """Structured array [n] of the fields that are known. Raises InvalidInput, also if one that is
    needed is missing."""
    fields = [f for f in of.fields if f.type in NUMERIC]
    if missing := set(needed) - {f.name for f in fields}:
        raise InvalidInput(f"a grid or cloud has no field {', '.join(sorted(missing))}")
    try:
        kind = np.dtype(
            {
                "names": [f.name for f in fields],
                "formats": [NUMERIC[f.type] for f in fields],
                "offsets": [f.offset for f in fields],
                "itemsize": stride,
            }
        )
        return np.frombuffer(data, kind)
    except ValueError as error:
        raise InvalidInput(f"the fields of a grid or cloud do not fit: {error}") from error


def _positions(points: NDArray[np.void]) -> NDArray[np.float32]:
    return np.stack([points[name] for name in POSITION], -1)


def _rgba(points: NDArray[np.void]) -> NDArray[np.uint8]:
    return np.stack([points[name] for name in COLOR], -1)
