"""A patient search looks on past what is doubtful, and settles for less when nothing is left."""

from __future__ import annotations

import numpy as np
import pytest
from helios_planner import global_search
from helios_planner.decide import Do
from helios_planner.object_search import ObjectSearch
from helios_planner.receptacle_search import ReceptacleSearch
from helios_planner.standards import patient
from planner_flat import coffee_table, counter
from planner_rig import TABLE_XY, Looks, Rig, instance
from planner_things import Thing


def test_a_patient_search_goes_on_past_a_doubtful_thing_and_takes_it_when_nothing_is_left() -> None:
    rig = Rig(Looks([]))
    rig.known = [instance(counter(), score=0.4)]
    search = ReceptacleSearch(rig.kit, "counter", None, patient)  # tau_b is 0.5
    assert search.decide().do is Do.SEARCH_ON
    while search.settle_for_less():
        pass
    decision = search.decide()
    assert decision.do is Do.ACT
    assert decision.settings["threshold"] < 0.4
    rig.known.append(instance(counter(), id=9, score=0.45))
    assert search.decide().chosen.id == 9  # the better of two, now that both will do


def test_a_patient_search_settles_for_less_as_its_steps_run_out_also_after_a_restart() -> None:
    rig = Rig(Looks([]))
    rig.known = [instance(counter(), score=0.4)]
    search = ReceptacleSearch(rig.kit, "counter", None, patient)
    rig.world.steps = int(0.5 * rig.world.max_steps)
    assert search.decide().do is Do.ACT
    rig.world.steps = 0
    again = ReceptacleSearch(rig.kit, "counter", None, patient)
    again.recall(search.memory())
    assert again.decide().do is Do.ACT


def test_a_mug_on_the_likely_table_counts_more_than_a_likelier_mug_elsewhere() -> None:
    rig = Rig(Looks([]))
    search = ObjectSearch(rig.kit, "mug", "coffee table", global_search.by_objective, patient)
    size = np.array([0.1, 0.1, 0.1])
    here = instance(Thing(3, "mug", np.array([*TABLE_XY, 0.5]), size), score=0.5)
    elsewhere = instance(Thing(4, "mug", np.array([1.0, 1.0, 0.5]), size), score=0.6)
    rig.known = [instance(coffee_table(), score=0.6), here, elsewhere]
    while search.settle_for_less():
        pass
    decision = search.decide()
    assert decision.chosen.id == 3
    assert search.place_of(here) == 1.0
    assert search.place_of(elsewhere) == pytest.approx(0.2 / 0.8)
    assert decision.candidates[1].terms["total"] == pytest.approx(0.6 * 0.25)
    rig.known = [here, elsewhere]  # no start receptacle is known: a place says nothing
    assert search.decide().chosen.id == 4


def test_the_paper_counts_no_place() -> None:
    rig = Rig(Looks([]))
    thing = Thing(4, "mug", np.array([1.0, 1.0, 0.5]), np.array([0.1, 0.1, 0.1]))
    rig.known = [instance(coffee_table(), score=0.6), instance(thing, score=0.9)]
    rig.search.settle_for_less()
    decision = rig.search.decide()
    assert decision.do is Do.ACT
    assert "place" not in decision.candidates[0].terms
