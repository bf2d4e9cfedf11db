"""Tiny ONNX models written byte by byte: for every image they give the same fixed array.

They hold only what a runtime needs: one `Identity` node from a constant to the output.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from helios_detector.yolox_detector import STRIDES_PX
from numpy.typing import NDArray

FLOAT = 1  # TensorProto.DataType


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    return bytes([*out, value])


def _number(field: int, value: int) -> bytes:
    return _varint(field << 3) + _varint(value)


def _bytes(field: int, value: bytes | str) -> bytes:
    data = value.encode() if isinstance(value, str) else value
    return _varint(field << 3 | 2) + _varint(len(data)) + data


def _tensor(name: str, shape: Sequence[int | str]) -> bytes:
    """A ValueInfoProto of floats; a dimension given by a name stays dynamic."""
    dims = b"".join(_bytes(1, _number(1, n) if isinstance(n, int) else _bytes(2, n)) for n in shape)
    return _bytes(1, name) + _bytes(2, _bytes(1, _number(1, FLOAT) + _bytes(2, dims)))


def write(
    path: Path,
    output: NDArray[np.float32],
    input_shape: Sequence[int | str],
    metadata: Mapping[str, str] | None = None,
) -> Path:
    """A model of one input that gives `output`."""
    constant = (
        b"".join(_number(1, n) for n in output.shape)
        + _number(2, FLOAT)
        + _bytes(8, "constant")
        + _bytes(9, output.astype("<f4").tobytes())
    )
    node = _bytes(1, "constant") + _bytes(2, "output") + _bytes(4, "Identity")
    graph = (
        _bytes(1, node)
        + _bytes(2, "tiny")
        + _bytes(5, constant)
        + _bytes(11, _tensor("images", input_shape))
        + _bytes(12, _tensor("output", output.shape))
    )
    model = _number(1, 8) + _bytes(7, graph) + _bytes(8, _number(2, 17))
    for key, value in (metadata or {}).items():
        model += _bytes(14, _bytes(1, key) + _bytes(2, value))
    path.write_bytes(model)
    return path


def yolox_cell(
    box_xyxy: tuple[float, float, float, float], size: tuple[int, int]
) -> tuple[int, NDArray[np.float32]]:
    """(row of the output, [4] raw numbers there) that YOLOX decodes to this box in input pixels."""
    x0, y0, x1, y1 = box_xyxy
    stride = STRIDES_PX[0]
    cx, cy = (x0 + x1) / 2 / stride, (y0 + y1) / 2 / stride
    row = int(cy) * (size[1] // stride) + int(cx)
    extent = np.log([(x1 - x0) / stride, (y1 - y0) / stride])
    return row, np.array([cx % 1, cy % 1, *extent], np.float32)


def yolox(
    path: Path,
    found: Sequence[tuple[tuple[float, float, float, float], int, float]],  # box, class, score
    classes: int,
    size: tuple[int, int] = (240, 320),  # a multiple of 32 pixels is not needed
    metadata: Mapping[str, str] | None = None,
) -> Path:
    """A YOLOX model that finds these boxes in every image of this size."""
    cells = sum((size[0] // s) * (size[1] // s) for s in STRIDES_PX)
    output = np.zeros((1, cells, 5 + classes), np.float32)
    for box, class_index, score in found:
        row, numbers = yolox_cell(box, size)
        output[0, row, :4] = numbers
        output[0, row, 4], output[0, row, 5 + class_index] = 1.0, score
    return write(path, output, (1, 3, *size), metadata)
