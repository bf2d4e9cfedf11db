"""Tests of `helios bench --compare`: noise is no slow-down, and a slow-down is not noise."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from helios_core.errors import InvalidInput
from helios_eval.bench import benchmark_run
from helios_eval.bench.comparison import changes, read_run
from helios_eval.bench.timing import Row, compare, deviation
from hypothesis import given
from hypothesis import strategies as st


def _row(name: str = "render", ratio: float = 2.0, **more: Any) -> dict[str, Any]:
    return {"name": name, "size": "some", "ratio": ratio, **more}


@given(st.floats(0.1, 100), st.floats(0.0, 5.0))
def test_an_equal_or_faster_run_is_never_slower(ratio: float, spread: float) -> None:
    old = _row(ratio=ratio, ratio_spread=spread)
    for factor in (1.0, 1.5):
        (found,), _ = changes([old], [old | {"ratio": ratio * factor}])
        assert not found.slower


@pytest.mark.parametrize(
    ("now", "spread", "slower"),
    [(1.85, 0.01, False), (1.75, 0.01, True), (1.5, 0.2, False), (0.5, 0.2, True)],
)
def test_only_a_fall_beyond_the_noise_is_slower(now: float, spread: float, slower: bool) -> None:
    old, new = _row(ratio_spread=spread), _row(ratio=now, ratio_spread=spread)
    (found,), _ = changes([old], [new])
    assert found.slower is slower


def test_more_repeats_leave_less_noise() -> None:
    def slower(repeats: int) -> bool:
        old = _row(ratio_spread=0.2, repeats=repeats)
        (found,), _ = changes([old], [old | {"ratio": 1.5}])
        return found.slower

    assert [slower(n) for n in (1, 3, 16, 60)] == [False, False, True, True]


def test_runs_that_differ_leave_more_noise_than_their_repeats_tell() -> None:
    def slower(*ratios: float) -> bool:
        old = _row(ratio_spread=0.01, repeats=60, ratios=ratios)
        (found,), _ = changes([old], [old | {"ratio": 1.5}])
        return found.slower

    assert slower(2.0, 2.0, 2.0)
    assert slower(0.5, 1.99, 2.0)  # one run was disturbed
    assert not slower(1.7, 2.0, 2.3)
    assert slower(1.7, 2.3)  # too few to tell


def test_an_old_file_without_spreads_allows_a_fifth() -> None:
    (small,), _ = changes([_row()], [_row(ratio=1.65, ratio_spread=0.01)])
    (large,), _ = changes([_row()], [_row(ratio=1.55, ratio_spread=0.01)])
    assert (small.slower, large.slower) == (False, True)


def test_rows_of_one_name_are_matched_in_order() -> None:
    old = [_row(ratio=r, ratio_spread=0.01) for r in (1.0, 10.0)] + [_row("gone")]
    found, alone = changes(old, [_row(ratio=1.0), _row(ratio=5.0), _row("new")])
    assert [c.slower for c in found] == [False, True]
    assert alone == ["gone", "new"]


@pytest.mark.parametrize("text", ["", "[]", '{"rows": [{}]}', '{"rows": [{"name": "a"}]}'])
def test_another_file_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "old.json"
    path.write_text(text)
    with pytest.raises(InvalidInput, match=r"helios bench --json"):
        read_run(path)


def test_a_run_measures_its_spread_and_reports_a_slower_row(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    row = Row("view_scores", "x", 10.0, "peer", 20.0, 9, 0.1, 0.1, 0.02)
    module = type("Rows", (), {"view_scores": staticmethod(lambda: row)})
    monkeypatch.setattr(benchmark_run.importlib, "import_module", lambda _: module)
    old = tmp_path / "old.json"
    for ratio, slower in ((2.0, False), (4.0, True)):
        old.write_text(
            json.dumps({"machine": "another", "rows": [row.as_dict() | {"ratio": ratio}]})
        )
        assert benchmark_run.main("view_scores", tmp_path / "new.json", old) is slower
    said = capsys.readouterr().out
    assert "another machine" in said
    assert "slower: view_scores (x): ratio 4.00 before, 2.00 now" in said
    assert read_run(tmp_path / "new.json")[1][0]["ratio_spread"] == 0.02


def test_of_several_runs_the_median_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    coming = iter([30.0, 10.0, 20.0])
    module = type(
        "Rows",
        (),
        {
            "view_scores": staticmethod(
                lambda: Row("view_scores", "x", 10.0, "peer", next(coming), 9, 0.1, 0.1, 0.02)
            )
        },
    )
    monkeypatch.setattr(benchmark_run.importlib, "import_module", lambda _: module)
    assert not benchmark_run.main("view_scores", tmp_path / "new.json", runs=3)
    (row,) = read_run(tmp_path / "new.json")[1]
    assert (row["ratio"], row["ratios"]) == (2.0, [1.0, 2.0, 3.0])


def test_every_row_has_its_module() -> None:
    for name, module in benchmark_run.ROWS.items():
        found = (Path(benchmark_run.__file__).parent / f"{module}.py").read_text()
        assert f"def {name}(" in found


def test_deviation_ignores_an_outlier() -> None:
    assert deviation([1.0, 2.0, 3.0, 1000.0, 2.0]) == 1.0
    row = compare("a", "b", lambda _: None, "c", lambda _: None, 5)
    assert row.repeats == 5
