"""Tests the labels of the rows of a report."""

from __future__ import annotations

from helios_eval.report.agent_groups import arms_of, pairs, plain_arm
from synthetic_episodes import episode


def labels(*settings: dict) -> set[str]:
    return {arm.label for arm in arms_of([episode(1, settings=s) for s in settings])}


def test_a_label_names_two_settings_and_counts_the_others() -> None:
    many = {f"planner.{name}": 1 for name in "abcd"}
    assert labels({}, {"planner.a": 1}, many) == {
        "helios-paper",
        "helios-paper · a=1",
        "helios-paper · a=1 · b=1 · 2 more settings",
    }


def test_a_label_names_a_third_setting_instead_of_counting_it() -> None:
    assert labels({}, {"x.a": 1, "x.b": 2, "x.c": 3}) == {
        "helios-paper",
        "helios-paper · a=1 · b=2 · c=3",
    }


def test_rows_with_equal_short_labels_name_all_settings() -> None:
    first = {f"planner.{name}": 1 for name in "abcd"}
    assert labels({}, first, first | {"planner.d": 2}) == {
        "helios-paper",
        "helios-paper · a=1 · b=1 · c=1 · d=1",
        "helios-paper · a=1 · b=1 · c=1 · d=2",
    }


def test_different_agents_are_compared_only_under_one_pick_rule() -> None:
    ovmm = {"pick_rule": "ovmm"}
    arms = arms_of(
        [
            *(episode(s, "helios-paper") for s in range(3)),
            *(episode(s, a, settings=ovmm) for s in range(2) for a in ("helios-paper", "trusting")),
        ]
    )
    compared = {(a.agent, a.pick_rule, b.agent, b.pick_rule) for a, b in pairs(arms)}
    assert compared == {
        ("helios-paper", "ovmm", "trusting", "ovmm"),
        ("helios-paper", "ovmm", "helios-paper", "physical"),
    }
    main = plain_arm(arms, "ovmm", "trusting", "noisy")
    assert main is not None
    assert main.pick_rule == "ovmm"
