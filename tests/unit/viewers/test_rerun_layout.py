"""The layout file of Rerun is that of the code."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("rerun", reason="pip install 'helios-ovmm[rerun]'")
FILE = Path(__file__).resolve().parents[3] / "deploy/viewers/rerun-layout.rbl"


def contents_of(path: Path) -> set[tuple[str, ...]]:
    """Name and contents of every view in a layout file; ids and times differ in each file."""
    from rerun.chunk import RrdReader

    reader = RrdReader(path)
    (stored,) = reader.blueprints()
    found = set()
    for chunk in reader.stream(store=stored):
        batch = chunk.to_record_batch()
        for name in batch.schema.names:
            if name.endswith((":display_name", ":query", ":space_origin")):
                found |= {(name, *row.as_py()) for row in batch.column(name) if row.is_valid}
    return found


def test_the_layout_file_is_that_of_the_code(tmp_path: Path) -> None:
    """Write it anew with `python -m helios_viewers.rerun_layout`."""
    from helios_viewers.rerun_layout import APPLICATION, layout

    layout().save(APPLICATION, tmp_path / "now.rbl")
    now = contents_of(tmp_path / "now.rbl")
    assert any("World" in row for row in now)
    assert contents_of(FILE) == now
