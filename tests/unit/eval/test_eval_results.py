"""Tests `results.json` of constructed records."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest
from eval_constructed_records import record
from helios_core.errors import InvalidInput
from helios_eval.runs import results
from helios_eval.runs.results import UNLIMITED
from helios_sim.failure_causes import OBJECT_NOT_FOUND, SYSTEM_ERROR

GAVE_UP: dict[str, Any] = {"state": "failed", "reported_cause": OBJECT_NOT_FOUND}
NAMES = [
    "FindObj",
    "Pick",
    "FindRec",
    "Place",
    "SR",
    "partial",
    "collisions",
    "steps",
    "seconds_per_step",
]


def metric(rows: list[dict], picks: object, name: str) -> dict[str, float]:
    (row,) = [r for r in rows if r["picks"] == picks]
    return row["metrics"][name]


def test_one_run_with_unlimited_picks_gives_the_rows_of_every_limit() -> None:
    """An episode that exceeds N picks scores 0 in every score of the row for N picks."""
    tried = [record(k, picks=picks, steps=100) for k, picks in enumerate((1, 2, 5, 6))]
    rows = results.rows(tried, [1, 5, UNLIMITED])
    for name in NAMES[:6]:
        assert metric(rows, 1, name)["mean"] == 0.25
        assert metric(rows, 5, name)["mean"] == 0.75
        assert metric(rows, UNLIMITED, name)["mean"] == 1.0
    assert metric(rows, 1, "steps")["mean"] == 100
    assert {r["picks"] for r in json.loads(json.dumps(rows))} == {1, 5, "unlimited"}


def test_means_have_a_standard_error() -> None:
    row = results.rows([record(k, success=k < 3, collisions=k) for k in range(4)], [UNLIMITED])[0]
    assert set(row) >= {"benchmark", "agent", "picks", "semantics", "preset", "metrics"}
    assert list(row["metrics"]) == NAMES
    success = row["metrics"]["SR"]
    assert success == {"mean": 0.75, "sem": pytest.approx(0.5 / math.sqrt(4)), "n": 4}
    assert row["metrics"]["collisions"]["mean"] == 1.5
    # (FindObj + Pick + FindRec + SR) / 4
    assert row["metrics"]["partial"]["mean"] == pytest.approx((3 * 1.0 + 0.75) / 4)


def test_the_mean_of_one_episode_has_no_standard_error() -> None:
    assert results.rows([record(0)], [UNLIMITED])[0]["metrics"]["SR"] == {
        "mean": 1.0,
        "sem": None,
        "n": 1,
    }


def test_object_navigation_has_its_own_metrics_and_no_pick_limit() -> None:
    ways = [(10.0, 5.0, True), (4.0, 5.0, True), (5.0, 5.0, False)]
    found = [
        record(k, benchmark="objectnav", path_m=path, shortest_path_m=least, success=ok, picks=0)
        for k, (path, least, ok) in enumerate(ways)
    ]
    (row,) = results.rows(found, [1, 5, UNLIMITED])
    assert row["metrics"]["SR"]["mean"] == pytest.approx(2 / 3)
    assert row["metrics"]["SPL"]["mean"] == pytest.approx((0.5 + 1.0 + 0.0) / 3)
    assert {"steps", "seconds_per_step"} <= set(row["metrics"])


def test_records_with_different_conditions_get_separate_rows(tmp_path: Path) -> None:
    some = [
        record(0),
        record(0, agent="trusting"),
        record(0, settings={"planner.alpha_d": 0.1}),
        record(1),
        record(0, semantics="ground-truth", noise=None),
    ]
    results.write(tmp_path, some, [UNLIMITED])
    rows = json.loads((tmp_path / results.RESULTS).read_text())
    assert [r["metrics"]["SR"]["n"] for r in rows] == [2, 1, 1, 1]


def test_absent_targets_add_their_rates() -> None:
    """Of two present targets one is falsely reported as absent, of three absent two rightly."""
    records = [
        record(0),
        record(1, success=False, **GAVE_UP, picks=0),
        record(2, absent=True, **GAVE_UP, picks=0),
        record(3, absent=True, **GAVE_UP, picks=0),
        record(4, absent=True, success=False),
    ]
    metrics = results.rows(records, [UNLIMITED])[0]["metrics"]
    assert list(metrics) == [*NAMES, "SR_present", "SR_absent", "false_not_found"]
    assert metrics["SR_present"] == {"mean": 0.5, "sem": pytest.approx(0.5), "n": 2}
    assert metrics["SR_absent"] == {
        "mean": pytest.approx(2 / 3),
        "sem": pytest.approx(1 / 3),
        "n": 3,
    }
    assert metrics["false_not_found"] == {"mean": 0.5, "sem": pytest.approx(0.5), "n": 2}
    assert metrics["SR"]["mean"] == pytest.approx(3 / 5)


def test_a_report_after_too_many_picks_is_no_false_one() -> None:
    """The limit ends the episode before the agent can give up."""
    records = [
        record(0, success=False, **GAVE_UP, picks=2),
        record(1, absent=True, picks=0),
    ]
    rows = results.rows(records, [1, UNLIMITED])
    assert metric(rows, 1, "false_not_found")["mean"] == 0
    assert metric(rows, UNLIMITED, "false_not_found")["mean"] == 1


def test_rates_of_absent_targets_without_a_present_one() -> None:
    metrics = results.rows([record(0, absent=True, picks=0)], [UNLIMITED])[0]["metrics"]
    assert metrics["SR_absent"]["mean"] == 1
    assert (
        metrics["SR_present"] == metrics["false_not_found"] == {"mean": None, "sem": None, "n": 0}
    )


@pytest.mark.parametrize("text", ["0", "-1", "many", "1.5", ""])
def test_picks_are_a_number_or_unlimited(text: str) -> None:
    with pytest.raises(InvalidInput, match="picks"):
        results.picks_of(text)


def test_steps_are_means_over_the_episodes_that_were_played() -> None:
    never = {"structure_hash": "", "cause": SYSTEM_ERROR, "steps": 0, "success": False}
    (row,) = results.rows([record(0, steps=100), record(1, **never)], [UNLIMITED])
    assert row["metrics"]["steps"] == {"mean": 100.0, "sem": None, "n": 1}
    assert row["metrics"]["SR"]["mean"] == 0.5
