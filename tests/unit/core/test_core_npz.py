"""Untrusted NPZ files: reading their arrays, and refusing some before unpacking."""

from __future__ import annotations

import io
import tracemalloc
import zipfile

import numpy as np
import pytest
from helios_core.errors import InvalidInput
from helios_core.npz_reading import one_array, unpacked


def packed(**arrays: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.savez_compressed(stream, allow_pickle=False, **arrays)
    return stream.getvalue()


def test_arrays_written_by_numpy_round_trip() -> None:
    arrays = {"one": np.arange(12.0).reshape(3, 4), "two": np.array("a text")}
    again = unpacked(packed(**arrays))
    assert list(again) == ["one", "two"]
    for name, array in arrays.items():
        np.testing.assert_array_equal(again[name], array)


def test_an_oversized_file_is_refused_before_unpacking() -> None:
    data = packed(nothing=np.zeros(50_000_000, np.uint8))
    assert len(data) < 100_000
    tracemalloc.start()
    try:
        with pytest.raises(InvalidInput, match="unpacks to 50000128, wanted at most 1000000"):
            unpacked(data, most_bytes=1_000_000)
        assert tracemalloc.get_traced_memory()[1] < 5_000_000
    finally:
        tracemalloc.stop()


def test_the_size_limit_counts_all_arrays_together() -> None:
    data = packed(**{f"part{k}": np.zeros(1000, np.uint8) for k in range(20)})
    assert len(unpacked(data, most_bytes=30_000)) == 20
    with pytest.raises(InvalidInput, match="wanted at most 20000"):
        unpacked(data, most_bytes=20_000)


def test_the_size_limit_does_not_apply_to_an_uncompressed_file() -> None:
    stream = io.BytesIO()
    np.savez(stream, allow_pickle=False, much=np.arange(5000))
    np.testing.assert_array_equal(unpacked(stream.getvalue(), most_bytes=10)["much"], range(5000))


def test_a_compression_that_numpy_does_not_use_is_refused() -> None:
    stream, array = io.BytesIO(), io.BytesIO()
    np.save(array, np.zeros(1000))
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_BZIP2) as file:
        file.writestr("zeros.npy", array.getvalue())
    with pytest.raises(InvalidInput, match=r"numpy\.savez"):
        unpacked(stream.getvalue())
    with pytest.raises(InvalidInput, match=r"ZIP method 12; .*numpy\.savez"):
        one_array(stream.getvalue(), "zeros", 10_000)


@pytest.mark.parametrize("data", [b"", b"no zip"], ids=["empty", "no zip"])
def test_data_that_is_not_a_zip_raises_bad_zip_file(data: bytes) -> None:
    with pytest.raises(zipfile.BadZipFile):
        unpacked(data)
