"""Tests the labels of the rows of a report, and which rows it compares."""

from __future__ import annotations

import pytest
from helios_eval.report.agent_groups import arms_of, comparable, pairs, plain_arm
from synthetic_episodes import NOISE, episode

LOUDER = NOISE.model_copy(update={"level": 2.0})
OTHER_TABLE = NOISE.model_copy(update={"table": "other", "digest": "1" * 64})


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


def test_the_main_condition_has_the_table_of_the_preset_even_with_fewer_episodes() -> None:
    few = [episode(s) for s in range(2)]
    arms = arms_of([*few, *(episode(s, noise=OTHER_TABLE) for s in range(5))])
    main = plain_arm(arms, "ovmm", "helios-paper", "noisy")
    assert main is not None
    assert main.noise == NOISE
    assert arms[0] is main


def compared(*episodes) -> set[tuple[str, str]]:
    return {(a.label, b.label) for a, b in pairs(arms_of(episodes))}


def test_without_a_reference_agent_the_plainest_arm_with_most_episodes_is_the_reference() -> None:
    more = [episode(s, "a2") for s in range(3)]
    found = compared(episode(0, "a1"), episode(0, "a1", settings={"x": 1}), *more, episode(0, "a3"))
    assert found == {("a1", "a2"), ("a3", "a2"), ("a1 · x=1", "a1")}


def test_an_arm_with_a_setting_is_paired_with_the_plain_arm_of_its_own_noise() -> None:
    found = compared(
        *(episode(0, settings=s, noise=n) for s in ({}, {"x": 1}) for n in (NOISE, LOUDER))
    )
    assert found == {
        ("helios-paper · x=1", "helios-paper"),
        ("helios-paper · noise ×2", "helios-paper"),
        ("helios-paper · noise ×2 · x=1", "helios-paper · noise ×2"),
    }


def test_across_conditions_an_arm_is_paired_with_one_of_equal_settings() -> None:
    x = {"x": 1}
    found = compared(episode(0), episode(0, settings=x), episode(0, settings=x, noise=LOUDER))
    assert ("helios-paper · noise ×2 · x=1", "helios-paper · x=1") in found
    assert ("helios-paper · noise ×2 · x=1", "helios-paper") not in found


@pytest.mark.parametrize(
    ("changes", "is_comparable"),
    [
        ({}, True),
        ({"semantics": "ground-truth"}, True),
        ({"noise": LOUDER}, False),
        ({"semantics": "ground-truth", "settings": {"pick_rule": "ovmm"}}, False),
        ({"semantics": "ground-truth", "settings": {"sensor": "realistic"}}, False),
        ({"semantics": "ground-truth", "preset": "other"}, False),
        ({"settings": {"planner.alpha_d": 9}}, False),
    ],
)
def test_two_arms_are_comparable_if_only_agent_or_semantics_differ(changes, is_comparable) -> None:
    (first,), (second,) = arms_of([episode(0)]), arms_of([episode(0, "trusting", **changes)])
    assert comparable(first, second) == comparable(second, first) == is_comparable
