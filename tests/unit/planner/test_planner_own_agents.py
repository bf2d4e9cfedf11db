"""Agents of other packages: rules and whole agents, loaded, checked and reported by name."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helios_core import proto as pb
from helios_core.errors import Internal, InvalidInput
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import DECISIONS
from helios_core.types import ObjectInstance
from helios_examples.left_first import left_first
from helios_planner.agents import agent_named
from helios_planner.decisions.decision import Decision, Do, FrontierOption, ReceptacleOption
from helios_planner.decisions.plugin_rule import Places, by_own_rule
from helios_planner.instruction.parser import parse
from helios_planner.plugins import exploring_by
from helios_planner.service import PlannerService
from helios_planner.settings import Settings
from helios_planner.task import TaskFailed
from helios_planner.tasks.mission import Mission
from hypothesis import given
from hypothesis import strategies as st
from planner_bus import Start, ended, submit
from planner_flat import MOVE, coffee_table, counter, flat, mug
from planner_world import FakeWorld
from pydantic import ValidationError

from tests.support import python_blocks

SOURCE = """
import numpy as np
from helios_planner.plugins import exploring_by
def rule(places): return -places.distance_m
agent = exploring_by(rule)
trusting = exploring_by(rule, trusts_detector=True)
def few(places): return [1.0]
wrong = exploring_by(few)
def broken_rule(places): return places.nothing
broken = exploring_by(broken_rule)
def called(): raise AssertionError("nothing of a plug-in is called to load it")
number = 3
"""
EXAMPLES = ("helios_examples.left_first:agent", "helios_examples.careful_agent:agent")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "agents_of_a_test.py").write_text(SOURCE)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "agents_of_a_test", raising=False)
    monkeypatch.setattr("helios_planner.agents._loaded", {})
    return tmp_path


def options() -> tuple[list[ReceptacleOption], list[FrontierOption]]:
    table = ObjectInstance(
        3, "coffee table", np.array([2.0, 1.0, 0.4]), np.ones(3), 0.6, 0.7, 0.1, 4, 900,
        {"coffee table": 0.7}, 0.45, np.zeros((0, 2)),
    )  # fmt: skip
    receptacles = [ReceptacleOption(table, 0.7, 1.5, 2.0, 0.3)]
    frontiers = [
        FrontierOption(7, (4.0, 1.0), 0.2, 3.0, np.pi / 2),
        FrontierOption(8, (1.0, 5.0), 0.6, 3.0, -np.pi / 2),
    ]
    return receptacles, frontiers


def chosen(rule: Callable[[Places], Any], *, frontiers_only: bool = False) -> Decision:
    receptacles, frontiers = options()
    rng = np.random.default_rng(0)
    given = None if frontiers_only else receptacles
    return by_own_rule(rule, given, frontiers, "mug", "pick", rng)


# --- rules -------------------------------------------------------------------------------------
def test_a_rule_gets_every_place_with_its_figures() -> None:
    seen: list[Places] = []

    def rule(places: Places) -> np.ndarray:
        seen.append(places)
        return places.value

    decision = chosen(rule)
    (places,) = seen
    assert len(places) == len(places.is_frontier) == 3
    assert (places.sought, places.layer) == ("mug", "pick")
    assert places.is_frontier.tolist() == [False, True, True]
    assert places.xy_m.shape == (3, 2)
    assert places.value.tolist() == [0.0, 0.2, 0.6]
    assert places.class_score.tolist() == [0.7, 0.0, 0.0]
    assert places.information_gain.tolist() == [1.5, 0.0, 0.0]
    assert (decision.do, decision.chosen.id) == (Do.GO_TO_FRONTIER, 8)
    assert decision.rule == "rule rule"
    assert "the rule rule scores it highest, 0.6" in decision.why


def test_a_receptacle_that_is_scored_highest_is_searched() -> None:
    decision = chosen(lambda places: ~places.is_frontier)
    assert decision.do is Do.SEARCH_RECEPTACLE
    assert decision.chosen.name == "coffee table"


def test_the_example_rule_goes_left_between_paths_of_equal_length() -> None:
    assert chosen(left_first, frontiers_only=True).chosen.id == 7


def test_a_place_with_score_minus_infinity_is_never_chosen() -> None:
    decision = chosen(lambda p: np.where(p.is_frontier, -np.inf, 0.0))
    assert [c.kind for c in decision.candidates] == ["receptacle"]
    assert chosen(lambda p: np.full(len(p), -np.inf)).do is Do.NOTHING_LEFT


@pytest.mark.parametrize(
    ("frontiers_only", "what"), [(True, "no frontier"), (False, "no receptacle to search and no")]
)
def test_a_search_without_places_tells_among_which_kinds_it_chose(
    frontiers_only: bool, what: str
) -> None:
    decision = chosen(lambda p: np.full(len(p), -np.inf), frontiers_only=frontiers_only)
    assert decision.why.startswith(f"nothing is left: {what}")
    given = None if frontiers_only else []
    rng = np.random.default_rng(0)
    assert by_own_rule(left_first, given, [], "mug", "pick", rng).why == decision.why


@pytest.mark.parametrize(
    ("gives", "said"),
    [
        (lambda p: [1.0], r"gave scores of shape \(1,\), wanted 3 numbers"),
        (lambda p: 1.0, r"gave scores of shape \(\), wanted 3 numbers"),
        (lambda p: None, "gave scores of shape|value of type NoneType"),
        (lambda p: "left", "value of type str, wanted 3 numbers"),
        (lambda p: [1.0, np.nan, 0.0], "that are nan or inf"),
        (lambda p: [1.0, np.inf, 0.0], "that are nan or inf"),
        (lambda p: p.nothing, "failed .AttributeError: .*the traceback is in its log"),
    ],
)
def test_a_failing_rule_is_reported_with_what_was_expected(
    gives: Callable[[Places], object], said: str
) -> None:
    with pytest.raises(Internal, match=f"the exploration rule <lambda> .*({said})"):
        chosen(gives)


@given(scores=st.lists(st.floats(-1e6, 1e6), min_size=3, max_size=3))
def test_the_highest_score_wins(scores: list[float]) -> None:
    decision = chosen(lambda places: scores)
    assert decision.chosen.terms["total"] == max(scores)


# --- whole tasks -------------------------------------------------------------------------------
def run(world: FakeWorld, agent: str) -> Mission:
    mission = Mission(world, parse(MOVE), Settings(agent=agent))
    mission.run()
    return mission


@pytest.mark.parametrize("agent", ["agents_of_a_test:agent", "agents_of_a_test:trusting"])
def test_an_agent_of_another_package_brings_a_mug(agent: str) -> None:
    world = flat([coffee_table(), counter(), mug()])
    run(world, agent)
    assert world.released is world.things[3]
    assert world.contacts == 0


@pytest.mark.parametrize(
    "agent",
    [
        "mine_of_the_tutorial:agent",
        "likely_of_the_tutorial:agent",
        "careful_of_the_tutorial:agent",
    ],
)
def test_every_agent_of_the_tutorial_brings_a_mug(agent: str, folder: Path) -> None:
    """Runs the code of docs/tutorials/your-own-agent.md; the examples package has the same."""
    page = Path(__file__).parents[3] / "docs/tutorials/your-own-agent.md"
    mine, likely, careful = python_blocks(page)
    (folder / "mine_of_the_tutorial.py").write_text(mine)
    (folder / "likely_of_the_tutorial.py").write_text(likely)
    (folder / "careful_of_the_tutorial.py").write_text(careful)
    world = flat([coffee_table(), counter(), mug()])
    run(world, agent)
    assert world.released is world.things[3]


def test_an_agent_chooses_frontiers_by_its_own_rule() -> None:
    world = flat([coffee_table(), counter(), mug()])
    run(world, "helios_examples.left_first:agent")
    rules = {d.rule for d in world.decisions if d.do is Do.GO_TO_FRONTIER}
    assert rules == {"rule left_first"}


def test_the_memory_of_an_own_agent_survives_a_restart() -> None:
    world = flat([coffee_table(), counter(), mug()])
    mission = run(world, "helios_examples.careful_agent:agent")
    search = mission.agent.seek_object(mission.tools, "mug", None)
    again = mission.agent.seek_object(mission.tools, "mug", None)
    again.restore(search.checkpoint())
    assert again.checkpoint() == search.checkpoint()


# --- over the bus ------------------------------------------------------------------------------
OPEN = {"agent": EXAMPLES[0], "agents_of_tasks": "any"}  # its settings are those of every own agent


def test_a_task_is_stored_with_the_agent_that_it_names(start: Start) -> None:
    _, bus, _ = start(**OPEN)
    done = ended(bus, submit(bus, agent=EXAMPLES[0]).id)
    assert (done.state, done.agent) == ("succeeded", EXAMPLES[0])
    kept = bus.call(DECISIONS, pb.TaskRequest(id=done.id), 5).decisions
    assert "rule left_first" in {d.rule for d in kept}


@pytest.mark.parametrize(
    ("agent", "said"),
    [
        ("clever", "choose one of helios, .*or package:agent of your own"),
        ("surely_not_there:agent", "no package or module 'surely_not_there'.*PYTHONPATH"),
        ("agents_of_a_test:agnet", "has no 'agnet'; did you mean agent"),
        ("agents_of_a_test:rule", "is the function rule; wanted .*exploring_by"),
        ("agents_of_a_test:called", "is the function called; wanted"),
        ("agents_of_a_test:number", "is of type int; wanted"),
        ("agents_of_a_test:agent:x", "takes no argument"),
        ("os:abort", "of Python's own library"),
        ("this:s", "of Python's own library"),
    ],
)
def test_a_task_for_an_agent_that_cannot_be_loaded_is_refused_with_the_reason(
    start: Start, agent: str, said: str
) -> None:
    _, bus, _ = start(**OPEN)
    with pytest.raises(InvalidInput, match=said):
        submit(bus, agent=agent)


@pytest.mark.parametrize(
    ("agent", "said"),
    [
        ("agents_of_a_test:wrong", "the exploration rule few gave scores of shape (1,)"),
        ("agents_of_a_test:broken", "the exploration rule broken_rule failed (AttributeError"),
    ],
)
def test_a_failing_agent_ends_only_its_own_task(start: Start, agent: str, said: str) -> None:
    _, bus, _ = start(flat([coffee_table(), counter(), mug()]), **OPEN)
    done = ended(bus, submit(bus, agent=agent).id)
    assert (done.state, done.cause) == ("failed", "system error")
    assert said in done.message
    assert ended(bus, submit(bus).id).state == "succeeded"


def test_a_search_that_raises_is_reported_with_the_name_of_its_agent(
    start: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    def boom(self: object) -> None:
        raise ValueError("no idea")

    monkeypatch.setattr("helios_examples.careful_agent.CarefulSearch.decide", boom)
    _, bus, _ = start(**OPEN)
    done = ended(bus, submit(bus, agent=EXAMPLES[1]).id)
    assert f"the agent {EXAMPLES[1]} failed (ValueError: no idea)" in done.message
    assert "the traceback is in" in done.message


def test_a_search_that_exits_the_process_ends_only_its_own_task(
    start: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("helios_examples.careful_agent.CarefulSearch.decide", lambda _: sys.exit(3))
    _, bus, _ = start(**OPEN)
    done = ended(bus, submit(bus, agent=EXAMPLES[1]).id)
    assert f"the agent {EXAMPLES[1]} failed (SystemExit: 3)" in done.message
    assert ended(bus, submit(bus).id).state == "succeeded"


def test_a_decision_of_the_wrong_type_is_reported_with_what_was_expected(
    start: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("helios_examples.careful_agent.CarefulSearch.decide", lambda _: "go left")
    _, bus, _ = start(**OPEN)
    done = ended(bus, submit(bus, agent=EXAMPLES[1]).id)
    assert "decide() gave a value of type str; wanted a Decision" in done.message


def test_a_task_names_only_agents_that_the_operator_listed(tmp_path: Path) -> None:
    hub = MemoryHub()
    service = PlannerService(
        MemoryBus(hub), Settings(state_dir=tmp_path, agent=EXAMPLES[0]), Health()
    )
    try:
        bus = MemoryBus(hub)
        for agent in ("", EXAMPLES[0]):
            submit(bus, agent=agent)
        with pytest.raises(InvalidInput, match=r"there is no agent.*AGENTS_OF_TASKS"):
            submit(bus, agent=EXAMPLES[1])
    finally:
        service.close()


@pytest.mark.parametrize(
    "agent",
    ["agents_of_a_test:agent", "agents_of_a_test:agent:x", "agents_of_a_test", ":", "os:abort"],
)
def test_by_default_no_task_makes_the_planner_import_a_module(start: Start, agent: str) -> None:
    _, bus, _ = start()
    with pytest.raises(InvalidInput, match="there is no agent"):
        submit(bus, agent=agent)
    assert "agents_of_a_test" not in sys.modules


def test_a_planner_whose_own_agent_cannot_be_loaded_does_not_start(tmp_path: Path) -> None:
    settings = Settings(state_dir=tmp_path, agent="agents_of_a_test:agnet")
    with pytest.raises(InvalidInput, match="did you mean agent"):
        PlannerService(MemoryBus(MemoryHub()), settings, Health())
    with pytest.raises(ValidationError, match="choose one of helios"):
        Settings(agent="hal")


def test_an_agent_is_loaded_once() -> None:
    assert agent_named(EXAMPLES[0]) is agent_named(EXAMPLES[0])
    assert exploring_by(left_first) is not agent_named(EXAMPLES[0])


def test_a_search_of_an_own_agent_ends_if_it_finds_nothing(start: Start) -> None:
    world = flat([coffee_table(), counter()])
    with pytest.raises(TaskFailed, match="no mug was found"):
        Mission(world, parse("find the mug"), Settings(agent=EXAMPLES[1], rounds=1)).run()
