"""Tests the comparison of placing rules: the report for given outcomes, and one real placement."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import pytest
from helios_core.errors import InvalidInput
from helios_eval.studies.placement_rules import RULES, Outcome, play, report, run, trials
from helios_planner.settings import PlaceRule


def outcome(seed: int, rule: PlaceRule, how: str) -> Outcome:
    return Outcome(seed, "table_0", "table", "mug", rule, how == "succeeded", how, "", 9)


def test_the_report_compares_trials_that_both_rules_played() -> None:
    done = [outcome(s, "paper", "rolled off" if s % 2 else "succeeded") for s in range(20)]
    done += [outcome(s, "flat", "succeeded") for s in range(20)]
    done.append(outcome(99, "flat", "refused"))
    text = report(done)
    assert "| paper | 50.0 %" in text
    assert "| flat | 100.0 %" in text
    assert "| 10 | 0 | 0 | 0 | 20 |" in text
    assert "flat - paper: +50.0 points" in text


def test_a_report_without_pairs_is_refused() -> None:
    with pytest.raises(InvalidInput, match="both rules"):
        report([outcome(1, "flat", "succeeded")])


def test_a_folder_of_another_kind_of_homes_is_refused_and_a_torn_line_left_out(
    tmp_path: Path,
) -> None:
    rows = [json.dumps(asdict(outcome(s, rule, "succeeded"))) for s in (1, 2) for rule in RULES]
    (tmp_path / "placements.jsonl").write_text("\n".join(rows) + '\n{"seed": 3, "rec')
    with pytest.raises(InvalidInput, match="in homes of ovmm-v1, not demo-v1"):
        run("demo-v1", 0, 0, 1, tmp_path)
    assert "| 2 |" in run("ovmm-v1", 0, 0, 1, tmp_path)


def test_a_placement_gives_the_same_outcome_when_repeated() -> None:
    trial = next(trials("demo-v1", 3, per_home=1))
    first, again = play("demo-v1", trial, "flat"), play("demo-v1", trial, "flat")
    assert first == again
    assert first is None or first.steps > 3
