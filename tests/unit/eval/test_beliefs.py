"""Tests the rule that judges a belief as right or wrong, on constructed scenes."""

import math
from dataclasses import dataclass

import numpy as np
import pytest
from helios_core.types import ObjectInstance
from helios_eval.episodes.belief_truth import Role, TrueObject, judge_instances
from hypothesis import given, settings
from hypothesis import strategies as st


@dataclass(frozen=True)
class HomeObject:
    class_name: str
    center_m: tuple[float, float, float]
    size_m: tuple[float, float, float]
    yaw_rad: float = 0.0


MUG = HomeObject("mug", (1.0, 2.0, 0.80), (0.10, 0.10, 0.12))
TABLE = HomeObject("coffee table", (1.0, 2.0, 0.20), (1.2, 0.6, 0.40))
TURNED = HomeObject("counter", (4.0, 0.0, 0.45), (2.0, 0.6, 0.90), math.pi / 2)
HOME: tuple[TrueObject, ...] = (MUG, TABLE, TURNED)
ROLES: dict[str, Role] = {"mug": "object", "coffee table": "start", "counter": "goal"}


def instance(class_name: str, *center_m: float, **figures: float) -> ObjectInstance:
    return ObjectInstance(
        id=7, class_name=class_name, center_m=np.array(center_m), size_m=np.full(3, 0.1),
        score=figures.get("score", 0.6), class_score=0.7, uncertainty=0.1, views=5, gaussians=123,
        probabilities={class_name: 0.7, "other": 0.3}, top_m=1.0, outline_m=np.zeros((0, 2)),
    )  # fmt: skip


def is_right(seen: ObjectInstance) -> bool:
    (belief,) = judge_instances([seen], HOME, ROLES, 1)
    return belief.correct


@pytest.mark.parametrize(
    ("center_m", "right"),
    [
        ((1.0, 2.0, 0.80), True),
        ((1.149, 2.0, 0.80), True),  # half of 0.10, plus 0.10
        ((1.151, 2.0, 0.80), False),
        ((1.0, 2.0, 0.959), True),
        ((1.0, 2.0, 0.961), False),
        ((5.0, 5.0, 0.80), False),
    ],
)
def test_a_small_object_is_right_within_its_grown_box(center_m, right):
    assert is_right(instance("mug", *center_m)) is right


@pytest.mark.parametrize(
    ("center_m", "right"),
    [
        ((1.0, 2.0, 0.40), True),
        ((1.74, 2.44, 0.40), True),  # a corner, grown by 0.15
        ((1.76, 2.0, 0.40), False),
        ((1.0, 2.0, 0.02), True),  # only the legs were seen
        ((1.0, 2.0, 0.54), True),
        ((1.0, 2.0, 0.90), False),  # a lamp above the table
    ],
)
def test_a_receptacle_is_right_over_its_footprint_at_a_plausible_height(center_m, right):
    assert is_right(instance("coffee table", *center_m)) is right


def test_the_box_of_a_rotated_object_is_rotated():
    assert is_right(instance("counter", 4.0, 0.9, 0.9))  # 2 m long, along y
    assert not is_right(instance("counter", 4.9, 0.0, 0.9))


def test_an_instance_at_the_place_of_another_class_is_wrong():
    assert not is_right(instance("coffee table", 4.0, 0.0, 0.45))
    assert not is_right(instance("mug", 1.0, 2.0, 0.20))


@pytest.mark.parametrize("spelling", ["Coffee_Table", "coffee-table", " COFFEE  table "])
def test_class_names_match_in_any_case_and_separator(spelling):
    seen = instance(spelling, 1.0, 2.0, 0.4)
    (belief,) = judge_instances([seen], HOME, ROLES, 1)
    assert (belief.correct, belief.role) == (True, "start")
    (belief,) = judge_instances(
        [instance("coffee table", 1.0, 2.0, 0.4)], HOME, {spelling: "goal"}, 1
    )
    assert (belief.correct, belief.role) == (True, "goal")


def test_a_more_general_class_name_does_not_match():
    (belief,) = judge_instances([instance("table", 1.0, 2.0, 0.4)], HOME, {"table": "goal"}, 1)
    assert not belief.correct


def test_instances_without_a_role_are_left_out_and_the_order_is_kept():
    seen = [
        instance("mug", 9, 9, 9, score=0.1),
        instance("cat", 0, 0, 0),
        instance("mug", 1, 2, 0.8),
    ]
    beliefs = judge_instances(seen, HOME, ROLES, 42)
    assert [(b.correct, b.step, b.role) for b in beliefs] == [
        (False, 42, "object"),
        (True, 42, "object"),
    ]
    assert beliefs[0].score == 0.1
    assert (beliefs[1].instance, beliefs[1].views) == (7, 5)
    assert (beliefs[1].gaussians, beliefs[1].uncertainty) == (123, 0.1)


def test_two_instances_of_one_object_are_both_right():
    beliefs = judge_instances(
        [instance("mug", 1, 2, 0.8), instance("mug", 1.05, 2, 0.8)], HOME, ROLES, 0
    )
    assert [b.correct for b in beliefs] == [True, True]


def test_an_empty_home_makes_every_belief_wrong():
    assert [b.correct for b in judge_instances([instance("mug", 1, 2, 0.8)], [], ROLES, 0)] == [
        False
    ]


small = st.floats(-3, 3)


@settings(deadline=None)
@given(small, small, small, st.floats(-7, 7), st.sampled_from(["object", "start"]))
def test_rotating_the_whole_home_changes_no_verdict(dx, dy, dz, turn_rad, role):
    def verdict(yaw_rad: float) -> bool:
        c, s = math.cos(yaw_rad), math.sin(yaw_rad)
        seen = instance("shelf", c * dx - s * dy, s * dx + c * dy, dz)
        shelf = HomeObject("shelf", (0.0, 0.0, 0.0), (1.0, 2.0, 3.0), yaw_rad)
        return judge_instances([seen], [shelf], {"shelf": role}, 0)[0].correct

    margin_m = 0.10 if role == "object" else 0.15
    near_an_edge = any(
        abs(abs(v) - half - margin_m) < 1e-6 for v, half in ((dx, 0.5), (dy, 1.0), (dz, 1.5))
    )
    assert near_an_edge or verdict(turn_rad) == verdict(0.0)
