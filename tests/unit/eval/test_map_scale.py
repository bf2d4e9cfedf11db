"""The study of large maps, on small ones."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from helios_eval.studies import map_scale
from helios_eval.studies.map_scale import Scale, growth, slope


def of_size(size: float, step_ms: float) -> Scale:
    return Scale("ground", size, step_ms, 1.0, 0.0, 0.0, 1.0)


def test_growth_and_slope_compare_the_largest_map_with_the_smallest() -> None:
    linear = [of_size(100, 20.0), of_size(10, 2.0), of_size(1000, 200.0)]
    assert growth(linear) == pytest.approx(100)
    assert slope(linear) == pytest.approx(1)
    assert slope([of_size(10, 3.0), of_size(1000, 3.0)]) == pytest.approx(0)


def test_a_short_run_prints_a_table_and_draws_the_chart(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sizes = ["--areas", "5", "20", "--gaussians", "20000", "40000"]
    assert map_scale.main(["--out", str(tmp_path), *sizes]) == 0
    told = capsys.readouterr().out
    assert "objects: a step grows by" in told
    rows = [Scale(**row) for row in json.loads((tmp_path / "scale.json").read_text())]
    small, large = [r for r in rows if r.part == "ground"]
    assert 5 <= small.size < 20 <= large.size
    assert small.file_mb < large.file_mb
    few, many = [r for r in rows if r.part == "objects"]
    assert many.memory_mb / few.memory_mb == pytest.approx(many.size / few.size, rel=0.05)
    assert (tmp_path / "scale.png").stat().st_size > 10_000


def test_a_folder_that_cannot_be_written_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    given = ["--out", str(tmp_path / "file"), "--areas", "5", "--gaussians"]
    assert map_scale.main(given) == 2
    assert "map_scale: " in capsys.readouterr().err
