"""NPZ files from outside: what they hold, and what is refused before it is unpacked."""

from __future__ import annotations

import io
import tracemalloc
import zipfile

import numpy as np
import pytest
from helios_core.errors import InvalidInput
from helios_core.npz_reading import unpacked


def packed(**arrays: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.savez_compressed(stream, allow_pickle=False, **arrays)
    return stream.getvalue()


def test_what_numpy_wrote_comes_back() -> None:
    arrays = {"one": np.arange(12.0).reshape(3, 4), "two": np.array("a text")}
    again = unpacked(packed(**arrays))
    assert list(again) == ["one", "two"]
    for name, array in arrays.items():
        np.testing.assert_array_equal(again[name], array)


def test_a_file_that_holds_too_much_is_refused_before_it_is_unpacked() -> None:
    data = packed(nothing=np.zeros(50_000_000, np.uint8))
    assert len(data) < 100_000
    tracemalloc.start()
    try:
        with pytest.raises(InvalidInput, match="unpacks to 50000128, wanted at most 1000000"):
            unpacked(data, most_bytes=1_000_000)
        assert tracemalloc.get_traced_memory()[1] < 5_000_000
    finally:
        tracemalloc.stop()


def test_many_small_arrays_count_together() -> None:
    data = packed(**{f"part{k}": np.zeros(1000, np.uint8) for k in range(20)})
    assert len(unpacked(data, most_bytes=30_000)) == 20
    with pytest.raises(InvalidInput, match="wanted at most 20000"):
        unpacked(data, most_bytes=20_000)


def test_a_file_that_is_not_packed_may_be_as_large_as_it_is() -> None:
    stream = io.BytesIO()
    np.savez(stream, allow_pickle=False, much=np.arange(5000))
    np.testing.assert_array_equal(unpacked(stream.getvalue(), most_bytes=10)["much"], range(5000))


def test_what_numpy_does_not_pack_with_is_refused() -> None:
    stream, array = io.BytesIO(), io.BytesIO()
    np.save(array, np.zeros(1000))
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_BZIP2) as file:
        file.writestr("zeros.npy", array.getvalue())
    with pytest.raises(InvalidInput, match=r"numpy\.savez"):
        unpacked(stream.getvalue())


@pytest.mark.parametrize("data", [b"", b"no zip"], ids=["empty", "no zip"])
def test_what_is_no_zip_is_reported_as_such(data: bytes) -> None:
    with pytest.raises(zipfile.BadZipFile):
        unpacked(data)
