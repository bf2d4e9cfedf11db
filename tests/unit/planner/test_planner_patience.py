"""Patient searches: they pass doubtful candidates, and accept less when nothing is left."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helios_planner.decisions import global_search
from helios_planner.decisions.acceptance import Rule, paper, patient
from helios_planner.decisions.counterfactual import recompute
from helios_planner.decisions.decision import ANY_SCORE, Do
from helios_planner.instruction.parser import parse
from helios_planner.search.object_search import ObjectSearch
from helios_planner.search.scored_search import (
    MOST_WRITTEN,
    CandidateMemory,
    ReceptacleSearch,
    ScoredSearch,
)
from helios_planner.settings import Settings
from helios_planner.task import Cause, TaskFailed
from helios_planner.tasks.mission import Mission
from hypothesis import given
from hypothesis import strategies as st
from planner_flat import MOVE, coffee_table, counter, flat, mug
from planner_rig import TABLE_XY, Looks, Rig, instance
from planner_things import Thing
from planner_world import FakeWorld


def _relax_fully(search: ScoredSearch) -> None:
    """Relax the search as after its last round."""
    search._round = search.settings.rounds - 1
    while search.relax():
        pass


def test_a_patient_search_accepts_a_doubtful_candidate_only_when_nothing_is_left() -> None:
    rig = Rig(Looks([]))
    rig.known = [instance(counter(), score=0.4)]
    search = ReceptacleSearch(rig.tools, "counter", None, patient)  # tau_b is 0.5
    assert search.decide().do is Do.SEARCH_ON
    _relax_fully(search)
    decision = search.decide()
    assert decision.do is Do.ACT
    assert decision.settings["threshold"] < 0.4
    rig.known.append(instance(counter(), id=9, score=0.45))
    assert search.decide().chosen.id == 9  # the better of two that pass


def test_a_candidate_may_lose_its_surplus_over_the_threshold_from_near() -> None:
    rig = Rig(Looks([]))
    rig.known = [instance(counter(), score=0.8)]  # 1.4 tau_b is 0.7
    search = ReceptacleSearch(rig.tools, "counter", None, patient)
    assert search.decide().do is Do.ACT
    for score, holds in ((0.51, True), (0.46, True), (0.44, False)):
        rig.known = [instance(counter(), score=score)]
        assert search.confirmed(rig.known[0]) is holds


def test_a_receptacle_that_shrinks_in_views_from_near_does_not_refute_the_object_on_it() -> None:
    rig = Rig(Looks([]))
    table = instance(coffee_table(), score=0.9, class_score=0.9)
    rig.known = [instance(mug(), score=0.9), table]
    search = ObjectSearch(rig.tools, "mug", "coffee table", global_search.by_objective, patient)
    assert search.decide().do is Do.ACT
    rig.known = [rig.known[0], replace(table, score=0.02)]
    assert search.place_probability(rig.known[0]) < 0.2
    assert search.confirmed(rig.known[0])
    doubtful = replace(rig.known[0], score=0.05)
    rig.known[0] = doubtful
    assert not search.confirmed(doubtful)
    assert search.why_not(doubtful).startswith("from near its score is 0.05 < ")


def test_a_patient_search_lowers_its_threshold_as_steps_run_out_also_after_a_restart() -> None:
    rig = Rig(Looks([]))
    rig.known = [instance(counter(), score=0.4)]
    search = ReceptacleSearch(rig.tools, "counter", None, patient)
    rig.world.steps = int(0.5 * rig.world.max_steps)
    assert search.decide().do is Do.ACT
    rig.world.steps = 0
    again = ReceptacleSearch(rig.tools, "counter", None, patient)
    again.restore(search.checkpoint())
    assert again.decide().do is Do.ACT


def test_a_mug_on_the_start_receptacle_outranks_a_mug_of_higher_score_elsewhere() -> None:
    rig = Rig(Looks([]))
    search = ObjectSearch(rig.tools, "mug", "coffee table", global_search.by_objective, patient)
    size = np.array([0.1, 0.1, 0.1])
    here = instance(Thing(3, "mug", np.array([*TABLE_XY, 0.5]), size), score=0.5)
    elsewhere = instance(Thing(4, "mug", np.array([1.0, 1.0, 0.5]), size), score=0.6)
    rig.known = [instance(coffee_table(), score=0.6), here, elsewhere]
    _relax_fully(search)
    decision = search.decide()
    assert decision.chosen.id == 3
    assert search.place_probability(here) == 1.0
    assert search.place_probability(elsewhere) == pytest.approx(0.05 / 0.65)
    assert decision.candidates[1].terms["total"] == pytest.approx(0.6 * 0.05 / 0.65)
    rig.known = [here, elsewhere]  # no table is known
    assert search.place_probability(elsewhere) == search.place_probability(here)


def test_an_object_on_no_known_start_receptacle_is_not_picked_at_once() -> None:
    """An object on no known receptacle is not picked at once, however high its own score is."""
    rig = Rig(Looks([]))
    search = ObjectSearch(rig.tools, "mug", "coffee table", global_search.by_objective, patient)
    on_the_table = Thing(3, "mug", np.array([*TABLE_XY, 0.5]), np.array([0.1, 0.1, 0.1]))
    thing = instance(on_the_table, score=0.9)
    rig.known = [thing]
    assert search.place_probability(thing) == pytest.approx(0.05 / 0.45)
    assert search.decide().do is not Do.ACT
    rig.known = [instance(coffee_table(), score=0.3), thing]
    assert search.place_probability(thing) == pytest.approx(0.35 / 0.45)
    assert search.decide().do is Do.ACT


def test_a_patient_search_searches_everything_again_before_it_goes_below_the_threshold() -> None:
    search = ReceptacleSearch(Rig(Looks([])).tools, "counter", None, patient)
    search.accept_any_after_share(0.92)
    while search.relax():
        pass
    assert search.threshold == search.settings.tau_b
    search._round = Settings().rounds - 1
    assert search.relax()
    assert search.threshold < search.settings.tau_b


def test_a_held_object_is_placed_on_the_likeliest_receptacle_when_nothing_is_left() -> None:
    """The counter is detected in two views of five and never passes the threshold (saturation)."""
    doubtful = counter()
    doubtful.rate = 0.4
    world = flat([coffee_table(), doubtful, mug()])
    said = Mission(world, parse(MOVE), Settings(agent="helios-paper")).run()
    assert world.released is world.things[3]
    assert "no surer counter was found than this one (0." in said
    (at_last,) = [d for d in world.decisions if d.settings.get("threshold") == ANY_SCORE]
    assert at_last.do is Do.ACT
    assert "place on the counter" in at_last.why
    assert "at last" in at_last.why
    assert not recompute(at_last, {"tau_b": 0.9}).flips


def test_the_likeliest_object_is_brought_when_nothing_is_left_unless_this_is_disabled() -> None:
    def world() -> FakeWorld:
        doubtful = mug()
        doubtful.rate = 0.4
        return flat([coffee_table(), counter(), doubtful])

    bold, shy = world(), world()
    said = Mission(bold, parse(MOVE), Settings(agent="helios-paper")).run()
    assert bold.released is bold.things[3]
    assert "no surer mug was found than this one (0." in said
    with pytest.raises(TaskFailed) as failure:
        Mission(shy, parse(MOVE), Settings(agent="helios-paper", pick_at_last=1, rounds=1)).run()
    assert failure.value.cause is Cause.OBJECT_NOT_FOUND
    assert shy.picks == 0


def test_a_find_task_accepts_no_doubtful_object() -> None:
    doubtful = mug()
    doubtful.rate = 0.4
    with pytest.raises(TaskFailed) as failure:
        Mission(
            flat([coffee_table(), doubtful]),
            parse("find the mug"),
            Settings(agent="helios-paper", rounds=1),
        ).run()
    assert failure.value.cause is Cause.OBJECT_NOT_FOUND


def test_a_go_task_accepts_no_doubtful_receptacle() -> None:
    doubtful = counter()
    doubtful.rate = 0.4
    with pytest.raises(TaskFailed) as failure:
        Mission(
            flat([doubtful]), parse("go to the counter"), Settings(agent="helios-paper", rounds=1)
        ).run()
    assert failure.value.cause is Cause.RECEPTACLE_NOT_FOUND


def test_the_likeliest_receptacle_is_accepted_before_the_steps_run_out() -> None:
    rig = Rig(Looks([]))
    rig.known = [instance(counter(), score=0.3)]
    search = ReceptacleSearch(rig.tools, "counter", None, paper)
    search.accept_any_after_share(0.92)
    rig.world.steps = int(0.9 * rig.world.max_steps)
    assert search.decide().do is not Do.ACT
    rig.world.steps = int(0.93 * rig.world.max_steps)
    assert search.decide().do is Do.ACT
    assert search.accepted_as_likeliest(rig.known[0])
    assert search.confirmed(rig.known[0])
    assert not search.accepted_as_likeliest(
        instance(counter(), score=0.9)
    )  # it passes the usual threshold
    rig.known = [replace(rig.known[0], score=-0.01)]  # Ψ is S − U
    assert search.decide().do is Do.ACT
    again = ReceptacleSearch(rig.tools, "counter", None, paper)
    again.accept_any_after_share(0.92)
    again.restore(search.checkpoint())
    assert again.accepted_as_likeliest(rig.known[0])


def test_all_rounds_are_searched_before_the_likeliest_candidate_is_accepted() -> None:
    search = ReceptacleSearch(Rig(Looks([])).tools, "counter", None, paper)
    search.accept_any_after_share(0.92)
    assert not search.relax()
    search._round = Settings().rounds - 1
    assert search.relax()
    assert not search.relax()


@pytest.mark.parametrize(("rounds", "rounds_held", "relaxes_in"), [(2, 1, 1), (2, 6, 2), (1, 3, 1)])
def test_the_lower_thresholds_apply_in_the_last_round_that_is_searched_or_in_round_rounds(
    rounds: int, rounds_held: int, relaxes_in: int
) -> None:
    search = ReceptacleSearch(Rig(Looks([]), rounds=rounds).tools, "counter", None, paper)
    search.accept_any_after_share(0.92)
    search.rounds = rounds_held  # as a mission sets it once the object is held
    for number in range(1, relaxes_in + 1):
        search._round = number - 1
        assert search.relax() is (number == relaxes_in)


def test_a_usable_receptacle_is_used_although_it_is_searched_for_only_once() -> None:
    doubtful = replace(counter(), rate=0.4)
    world = flat([coffee_table(), doubtful, mug()])
    Mission(world, parse(MOVE), Settings(rounds=2, rounds_held=1)).run()
    assert world.released is world.things[3]


def test_a_chosen_candidate_that_the_map_dropped_ends_the_task_with_advice() -> None:
    rig = Rig(Looks([]))
    rig.known = [instance(counter(), id=7, score=0.9)]
    search = ReceptacleSearch(rig.tools, "counter", None, paper)
    decision = search.decide()
    rig.known = []
    with pytest.raises(TaskFailed, match="the object map no longer holds counter 7") as failure:
        search.chosen(decision)
    assert failure.value.cause is Cause.SYSTEM_ERROR
    assert "submit the task again" in failure.value.message


def test_the_paper_rule_ignores_the_place_of_an_object() -> None:
    rig = Rig(Looks([]))
    thing = Thing(4, "mug", np.array([1.0, 1.0, 0.5]), np.array([0.1, 0.1, 0.1]))
    rig.known = [instance(coffee_table(), score=0.6), instance(thing, score=0.9)]
    rig.search.relax()
    decision = rig.search.decide()
    assert decision.do is Do.ACT
    assert "place" not in decision.candidates[0].terms


def _search_with_forgotten_candidates(agent: Rule, **settings: Any) -> tuple[Rig, ReceptacleSearch]:
    """Make a search that forgot its candidates: one of many views, and a surer one of few."""
    rig = Rig(Looks([]), **settings)
    search = ReceptacleSearch(rig.tools, "counter", None, agent)
    search.accept_any_after_share(0.9)
    once, fleeting = instance(counter(), score=0.3), instance(coffee_table(), score=0.45)
    rig.known = [replace(once, views=20), replace(fleeting, class_name="counter", views=1)]
    assert search.decide().do is not Do.ACT
    rig.known = []
    return rig, search


@pytest.mark.parametrize("agent", [paper, patient])
def test_the_forgotten_candidate_of_most_views_is_chosen_before_the_steps_run_out(
    agent: Rule,
) -> None:
    rig, search = _search_with_forgotten_candidates(agent)
    assert search.decide().do is not Do.ACT
    rig.world.steps = int(0.95 * rig.world.max_steps)
    decision = search.decide()
    assert decision.do is Do.ACT
    found = search.chosen(decision)
    assert found.views == 20
    assert search.accepted_as_likeliest(found)
    assert search.confirmed(None)
    search.reject_or_postpone(found, out_of_reach=False)  # rejected: the next one follows
    assert search.chosen(search.decide()).views == 1
    rig.known = [instance(counter(), id=9, score=0.1)]
    search.next_round()
    assert search.decide().chosen.id == 9  # a candidate in the map comes first
    assert search.chosen(search.decide()) is rig.known[0]


def test_the_path_to_an_unreachable_candidate_is_not_cleared_near_the_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    cleared: list[object] = []
    rig, search = _search_with_forgotten_candidates(paper)
    monkeypatch.setattr(rig.tools.base, "clear_way", lambda *at: bool(cleared.append(at)) or True)
    rig.known = [instance(counter(), score=0.3)]
    search.decide()
    search.reject_or_postpone(rig.known[0], out_of_reach=True)
    assert cleared
    assert search.candidates()
    rig.world.steps = int(0.95 * rig.world.max_steps)
    search.decide()
    search.reject_or_postpone(rig.known[0], out_of_reach=True)
    assert len(cleared) == 1
    assert not search.candidates()


def test_forgotten_candidates_are_remembered_after_a_restart() -> None:
    rig, search = _search_with_forgotten_candidates(paper)
    again = ReceptacleSearch(rig.tools, "counter", None, paper)
    again.accept_any_after_share(0.9)
    again.restore(json.loads(json.dumps(search.checkpoint())))
    rig.world.steps = int(0.95 * rig.world.max_steps)
    assert again.chosen(again.decide()).views == 20


@given(st.permutations(range(1, MOST_WRITTEN + 10)))
def test_only_the_likeliest_of_many_past_candidates_are_in_the_checkpoint(views: list[int]) -> None:
    before, after = CandidateMemory(), CandidateMemory()
    before.note(replace(instance(counter(), id=v), views=v) for v in views)
    assert len(before.checkpoint()) == MOST_WRITTEN
    after.restore(before.checkpoint())
    refused: set[int] = set()
    for _ in range(MOST_WRITTEN):
        best, as_before = (r.best(lambda c: c.id not in refused) for r in (after, before))
        assert best is not None
        assert as_before is not None
        assert best.id == as_before.id
        refused.add(best.id)
    assert after.best(lambda c: c.id not in refused) is None


def test_a_forgotten_object_is_not_confirmed_before_the_end() -> None:
    rig = Rig(Looks([]))
    thing = Thing(4, "mug", np.array([*TABLE_XY, 0.5]), np.array([0.1, 0.1, 0.1]))
    rig.known = [instance(coffee_table(), score=0.6), instance(thing, score=0.9)]
    assert rig.search.decide().do is Do.ACT
    assert not rig.search.confirmed(None)
