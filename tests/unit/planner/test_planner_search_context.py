"""The search context: thresholds of Table 3 by role, and the prompts of the value layers."""

from __future__ import annotations

import pytest
from helios_core.household_names import HOUSEHOLD_NAMES
from helios_planner.decisions import global_search
from helios_planner.decisions.acceptance import paper, patient
from helios_planner.decisions.decision import ANY_SCORE
from helios_planner.instruction.parser import parse
from helios_planner.search.object_search import ObjectSearch
from helios_planner.search.scored_search import ReceptacleSearch
from helios_planner.settings import LEAST_TAU, Settings
from helios_planner.tasks.search_context import search_context
from planner_rig import Rig
from pydantic import ValidationError

MOVE = "move the mug from the table to the counter"


@pytest.mark.parametrize(
    "prompt",
    ["", "a thing ahead", "a {thing} ahead", "a {} on a {}", "a {0.x}", "a {", "{:d}", "{{}}"],
)
def test_a_prompt_without_a_place_for_the_class_alone_is_refused_with_what_is_wanted(
    prompt: str,
) -> None:
    with pytest.raises(ValidationError, match=r"wanted a text with \{\} where the class stands"):
        Settings(prompt=prompt)


@pytest.mark.parametrize("prompt", ["{}", "a {} ahead", "a {0}, really a {0}"])
def test_a_prompt_with_a_place_for_the_class_is_accepted(prompt: str) -> None:
    (said, *_) = search_context(
        "c", parse("find the mug"), Settings(prompt=prompt)
    ).prompts.values()
    assert said == prompt.format("mug")


@pytest.mark.parametrize("margins_m", [(), (-0.01,), (0.1, -1.0)])
def test_margins_that_are_no_distances_are_refused_with_what_came(margins_m: tuple) -> None:
    with pytest.raises(ValidationError, match="wanted at least one, each 0 m or more") as refusal:
        Settings(margins_m=margins_m)
    assert f"the margins are {list(margins_m)} m" in str(refusal.value)


@pytest.mark.parametrize("name", ["tau_g", "tau_b"])
def test_no_threshold_can_be_as_low_as_that_of_the_last_resort(name: str) -> None:
    lowest = Settings(tau_g=LEAST_TAU, tau_b=LEAST_TAU)
    steps = [
        t.score
        for rule in (paper, patient)
        for known in (True, False)
        for t in rule(getattr(lowest, name), known).steps
    ]
    assert min(steps) > ANY_SCORE
    with pytest.raises(ValidationError, match=r"greater than or equal to -0\.5"):
        Settings.model_validate({name: ANY_SCORE})


def test_each_role_has_its_own_detector_threshold() -> None:
    context = search_context("c", parse(MOVE), Settings(od_a=0.1, od_g=0.2, od_b=0.3))
    assert {(c.name, str(c.role), c.threshold) for c in context.classes} == {
        ("table", "start_receptacle", 0.1),
        ("mug", "object", 0.2),
        ("counter", "goal_receptacle", 0.3),
    }


@pytest.mark.parametrize(
    ("text", "prompts"),
    [
        (MOVE, {"pick": "a table ahead", "place": "a counter ahead"}),
        ("move the mug to the counter", {"pick": "a mug ahead", "place": "a counter ahead"}),
        ("find the mug", {"pick": "a mug ahead"}),
        ("go to the counter", {"place": "a counter ahead"}),
    ],
)
def test_the_pick_layer_asks_for_the_start_receptacle_or_else_for_the_object(
    text: str, prompts: dict[str, str]
) -> None:
    context = search_context("c", parse(text), Settings())
    assert context.prompts == {k: f"Seems like there is {v}" for k, v in prompts.items()}


def test_every_class_has_a_prompt_of_its_own() -> None:
    context = search_context("c", parse(MOVE), Settings())
    assert context.class_prompts == {
        name: f"Seems like there is a {name} ahead" for name in ("mug", "table", "counter")
    }


def test_objects_are_judged_by_tau_g_and_goals_by_tau_b() -> None:
    tools = Rig(tau_g=0.6, tau_b=0.7).tools
    thing = ObjectSearch(tools, "mug", "table", global_search.by_objective, paper)
    assert thing.threshold == 0.6
    assert ReceptacleSearch(tools, "counter", None, paper).threshold == 0.7


def test_household_names_are_asked_for_beside_the_classes_if_the_setting_says_so() -> None:
    assert search_context("c", parse(MOVE), Settings()).also == ()
    also = search_context("c", parse(MOVE), Settings(ask_also="household")).also
    assert also == HOUSEHOLD_NAMES
    assert len(set(also)) == len(also)
    assert {"glass", "coffee table"} < set(also)
