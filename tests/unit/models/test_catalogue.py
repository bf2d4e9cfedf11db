"""The catalogue of models is the tables of docs/how-to/models.md, and the lock file is checked."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from helios_core.errors import InvalidInput
from helios_core.models.catalogue import CATALOGUE
from helios_core.models.model_folder import (
    LOCK,
    LockedFile,
    LockedModel,
    fetched,
    onnx_file,
    place_of,
    read_lock,
    write_lock,
)
from hypothesis import given
from hypothesis import strategies as st

PAGE = (Path(__file__).resolve().parents[3] / "docs/how-to/models.md").read_text()
ROW = re.compile(r"^\|[^|]*\| `--(\w+) ([^`]+)` \| ([^|]*) \| ([\d.]+ [MB]) \|", re.MULTILINE)


def test_the_catalogue_has_the_models_of_the_page_with_their_parameters() -> None:
    rows = {value: (use, licence, size) for use, value, licence, size in ROW.findall(PAGE)}
    assert rows.keys() == {m.setting for m in CATALOGUE}
    for model in CATALOGUE:
        use, licence, size = rows[model.setting]
        number, unit = size.split()
        assert (use, float(number) * (1000 if unit == "B" else 1)) == (
            "detector" if model.use == "detector" else model.use,
            model.parameters_m,
        )
        assert model.licence.split()[0] in licence


@given(
    st.dictionaries(
        st.from_regex(r"[a-z]{1,8}/[a-z0-9.-]{1,8}[a-z]", fullmatch=True),
        st.integers(0, 2**40),
        max_size=4,
    )
)
def test_a_lock_file_is_read_as_written(sizes: dict[str, int]) -> None:
    import tempfile

    models = {
        id: LockedModel(
            "http://x",
            "c0ffee",
            "mit",
            "2026-01-01",
            {"config.json": LockedFile(size, "0" * 64, "publisher")},
        )
        for id, size in sizes.items()
    }
    with tempfile.TemporaryDirectory() as folder:
        write_lock(Path(folder), models)
        assert read_lock(Path(folder)) == models
        assert all(fetched(id, Path(folder)) is None for id in models)  # the files are not there


@pytest.mark.parametrize("text", ["{", "[]", '{"format": 2}', '{"format": 1, "models": {"a": 1}}'])
def test_a_damaged_lock_file_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / LOCK).write_text(text)
    with pytest.raises(InvalidInput, match="is damaged"):
        read_lock(tmp_path)


def test_a_lock_file_cannot_name_files_outside_its_folder(tmp_path: Path) -> None:
    model = LockedModel("", "", "", "", {"../../x": LockedFile(1, "", "publisher")})
    write_lock(tmp_path, {"a/b": model})
    with pytest.raises(InvalidInput, match="outside the folder"):
        read_lock(tmp_path)


@pytest.mark.parametrize("id", ["../x", "a/..", "/x", "a/b/c", "x", "a\\b/c"])
def test_an_id_that_would_leave_the_folder_is_refused(tmp_path: Path, id: str) -> None:
    with pytest.raises(InvalidInput, match="wanted OWNER/NAME"):
        place_of(tmp_path, id)


def test_a_fetched_onnx_file_is_found_by_its_name_unless_one_is_here(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stored = tmp_path / "models" / "onnx" / "yolox_nano.onnx"
    stored.parent.mkdir(parents=True)
    stored.write_bytes(b"12345")
    lock = LockedModel("", "", "", "", {stored.name: LockedFile(5, "", "first download")})
    write_lock(tmp_path / "models", {stored.name: lock})
    monkeypatch.setenv("HELIOS_MODELS", str(tmp_path / "models"))
    monkeypatch.chdir(tmp_path)
    assert onnx_file("yolox_nano.onnx") == stored
    (tmp_path / "yolox_nano.onnx").touch()
    assert onnx_file("yolox_nano.onnx") == Path("yolox_nano.onnx")


def test_the_lock_file_is_plain_json(tmp_path: Path) -> None:
    write_lock(tmp_path, {})
    assert json.loads((tmp_path / LOCK).read_text()) == {"format": 1, "models": {}}
