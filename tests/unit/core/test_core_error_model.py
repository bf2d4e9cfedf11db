"""Files of error models: they come back as they were written, and foreign ones are refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from helios_core.detector_error_model import (
    DetectorErrorModel,
    Estimate,
    FitSource,
    NameErrorEstimates,
    from_text,
    read_error_model,
    to_text,
)
from helios_core.errors import InvalidInput
from hypothesis import given
from hypothesis import strategies as st


def estimate(value: float) -> Estimate:
    return Estimate(value=value, low=value, high=value)


def model(hit: float = 0.9, mistaken: float = 0.1) -> DetectorErrorModel:
    source = FitSource(
        what="a test",
        truth="agreement",
        views=3,
        things=2,
        things_with_truth=0,
        sides=4.5,
        made_with="0",
    )
    names = NameErrorEstimates(
        hit=estimate(hit),
        mistaken=estimate(mistaken),
        sides_correlate=estimate(0.3),
        rival=estimate(0.5),
    )
    return DetectorErrorModel(detector="onnx:a.onnx", source=source, names=names)


@given(st.floats(0.5, 0.999), st.floats(0.001, 0.499))
def test_a_model_is_read_as_it_was_written(hit: float, mistaken: float) -> None:
    written = model(hit, mistaken)
    assert from_text(to_text(written), "it") == written


def changed(**entries: Any) -> str:
    return json.dumps(json.loads(to_text(model())) | entries)


def of_names(**values: float) -> str:
    content = json.loads(to_text(model()))
    for name, value in values.items():
        content["names"][name]["value"] = value
    return json.dumps(content)


@pytest.mark.parametrize(
    "text",
    [
        "", "{", "[]", "null", '"text"', "NaN", changed(version=2), changed(format="other"),
        changed(more=1), changed(detector=""), changed(names={}), of_names(hit=1.0),
        of_names(mistaken=0.0), of_names(hit=0.05), of_names(sides_correlate=1.5),
        of_names(rival=0.0), to_text(model()).replace("0.9", "NaN"), to_text(model())[:-40],
    ],
)  # fmt: skip
def test_a_damaged_or_foreign_file_gives_one_sentence(text: str, tmp_path: Path) -> None:
    path = tmp_path / "model.json"
    path.write_text(text)
    with pytest.raises(InvalidInput, match=r"model\.json is no error model") as caught:
        read_error_model(path)
    assert "\n" not in caught.value.message
    assert "helios calibrate" in caught.value.message


@given(st.binary(max_size=200))
def test_no_bytes_raise_anything_else(data: bytes) -> None:
    with pytest.raises(InvalidInput):
        from_text(data, "it")


@pytest.mark.parametrize("name", ["missing.json", ".", "a\0b"])
def test_a_file_that_cannot_be_read_is_named(name: str, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="cannot be read"):
        read_error_model(tmp_path / name)


def test_a_huge_file_is_refused_unread(tmp_path: Path) -> None:
    path = tmp_path / "huge.json"
    path.write_bytes(b" " * 1_000_001)
    with pytest.raises(InvalidInput, match="no error model"):
        read_error_model(path)
