"""Tests the comparison of placing rules: the report for given outcomes, and one real placement."""

from __future__ import annotations

import pytest
from helios_core.errors import InvalidInput
from helios_eval.studies.placement_rules import Outcome, play, report, trials
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


def test_a_placement_gives_the_same_outcome_when_repeated() -> None:
    trial = next(trials("demo-v1", 3, per_home=1))
    first, again = play("demo-v1", trial, "flat"), play("demo-v1", trial, "flat")
    assert first == again
    assert first is None or first.steps > 3
