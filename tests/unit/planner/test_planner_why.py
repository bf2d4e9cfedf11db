"""Explanations of decisions, and decisions recomputed under other settings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helios_core.errors import InvalidInput
from helios_core.types import ObjectInstance
from helios_planner.decisions.acceptance import act_or_look, best_view
from helios_planner.decisions.counterfactual import (
    SETTINGS,
    changes_of,
    flips,
    recompute,
    under_gain_norm,
    with_replay_settings,
)
from helios_planner.decisions.decision import (
    Act,
    Decision,
    DecisionRule,
    Do,
    FrontierOption,
    ReceptacleOption,
    ViewOption,
)
from helios_planner.decisions.gain import Gain
from helios_planner.decisions.global_search import (
    ChosenFrontier,
    FirstSeen,
    SearchMemory,
    by_distance,
    by_objective,
    drawn,
    frontier_scale,
    highest_value,
    nearest,
    receptacles_first,
)
from helios_planner.settings import Settings
from helios_planner.tasks.messages import decision_from_proto, decision_to_proto
from hypothesis import given, settings
from hypothesis import strategies as st
from planner_tasks import a_task

USED = Settings()
OWN = {name: float(getattr(USED, name)) for name in SETTINGS}


def instance(
    id: int,
    name: str = "mug",
    score: float = 0.4,
    class_score: float = 0.6,
    xy: tuple[float, float] = (1.0, 2.0),
) -> ObjectInstance:
    return ObjectInstance(
        id=id, class_name=name, center_m=np.array([*xy, 0.5]), size_m=np.ones(3) * 0.1,
        score=score, class_score=class_score, uncertainty=class_score - score, views=4,
        gaussians=100, probabilities={name: class_score}, top_m=0.6, outline_m=np.empty((0, 2)),
    )  # fmt: skip


def stored(decision: Decision) -> Decision:
    """Return the decision as it is read back from the store."""
    reported = with_replay_settings(decision, USED)
    return decision_from_proto(decision_to_proto(reported, a_task(), 0, None, 1.0))


TABLE = ReceptacleOption(instance(7, "coffee table"), 0.62, 1.20, 3.1)
SHELF = ReceptacleOption(instance(8, "shelf"), 0.40, 1.85, 9.0)
FRONTIERS = [FrontierOption(5, (2.0, 1.0), 0.25, 2.3), FrontierOption(6, (9.0, 1.0), 0.24, 8.0)]
MEMORY = SearchMemory({7: FirstSeen(0.5, 1.0, (3.0, 0.0))}, [ChosenFrontier((0.0, 0.0), 0.2)])


# --- sentences -----------------------------------------------------------------------------------
def view(
    score: float, after: float | None = None, in_place: bool = True, id: int = 1
) -> ViewOption:
    return ViewOption(instance(id, score=score), score, after, 1.2, in_place)


def pick(*options: ViewOption, anywhere: bool = True) -> Decision:
    return act_or_look(options, 0.5, 0.05, "object", Act.PICK, anywhere)


RNG = np.random.default_rng(0)
SENTENCES = [
    (by_objective([TABLE, SHELF], FRONTIERS, SearchMemory(), 0.001),
     "search the coffee table, 3.1 m away: worth 0.741 = class score 0.62 × gain 1.20 − 0.001/m × "
     "3.1 m; next the shelf with 0.731, then 2 more"),
    (by_objective([], FRONTIERS, SearchMemory(), 0.001),
     "explore frontier 5, 2.3 m away: worth 0.248 = value 0.25 × scale 1.00 − 0.001/m × 2.3 m; "
     "next frontier 6 with 0.232"),
    (by_objective([TABLE], [], SearchMemory(), 0.001),
     "search the coffee table, 3.1 m away: worth 0.741 = class score 0.62 × gain 1.20 − 0.001/m × "
     "3.1 m; there is no other"),
    (by_objective([], [], SearchMemory(), 0.001),
     "nothing is left: no receptacle to search and no frontier to explore is in reach"),
    (receptacles_first([SHELF, TABLE], FRONTIERS, SearchMemory(), 0.001),
     "search the coffee table, 3.1 m away: the nearest of 2 receptacles left, all of which come "
     "before 2 frontiers"),
    (highest_value(FRONTIERS, "place", RNG),
     "explore frontier 5, 2.3 m away: its place value 0.25 is the highest; next frontier 6 with "
     "0.240"),
    (nearest(FRONTIERS, "place", RNG),
     "explore frontier 5, 2.3 m away: the nearest of 2 frontiers"),
    (drawn(FRONTIERS[:1], "place", RNG),
     "explore frontier 5, 2.3 m away: drawn from 1 frontier"),
    (pick(view(0.55)),
     "pick the mug, 1.2 m away: score 0.55 ≥ 0.50 after 4 views (class score 0.60, uncertainty "
     "0.05)"),
    (act_or_look([view(0.55), view(0.58, id=2)], 0.5, 0.05, "receptacle", Act.PLACE),
     "place on the mug, 1.2 m away: score 0.58 ≥ 0.50 after 4 views (class score 0.60, "
     "uncertainty 0.02), the best of 2 that pass"),
    (pick(view(0.41, 0.53)),
     "look again at the mug, 1.2 m away: score 0.41 < 0.50, and one more view could bring it to "
     "0.53 (worth it from 0.46)"),
    (pick(), "search on: nothing to pick has been seen yet"),
    (pick(view(0.41, 0.43)),
     "search on: the mug has score 0.41 < 0.50, and one more view would bring only 0.43 (worth it "
     "from 0.46)"),
    (pick(view(0.2), view(0.41, id=2)),
     "search on: the best mug of 2 has score 0.41 < 0.50, and no view of it is left"),
    (pick(view(0.9, in_place=False), anywhere=False),
     "search on: 1 candidate to pick is remembered, none where it was said to be"),
    (best_view(instance(1), [0.45, 0.53], [(0.0, 0.0), (1.0, 0.0)]),
     "of 2 views left of the mug, view 2 would raise its score most, from 0.40 to 0.53; the next "
     "one to 0.45"),
]  # fmt: skip


@pytest.mark.parametrize(("decision", "why"), SENTENCES)
def test_a_sentence_gives_the_action_its_sum_and_the_runner_up(
    decision: Decision, why: str
) -> None:
    assert decision.why == why


# --- kept and read back --------------------------------------------------------------------------
@pytest.mark.parametrize("decision", [d for d, _ in SENTENCES])
def test_a_stored_decision_is_read_back_unchanged(decision: Decision) -> None:
    again = stored(decision)
    assert replace(again, settings=decision.settings) == decision
    assert again.settings.items() >= decision.settings.items()


def test_the_memory_of_equations_8_and_9_is_stored_with_the_decision() -> None:
    again = stored(by_objective([TABLE], FRONTIERS, MEMORY, 0.001))
    assert again.settings["frontier_scale"] == pytest.approx(frontier_scale(MEMORY, 0.001))
    under = recompute(again, {"alpha_d": 0.1}).decision
    assert under.settings["frontier_scale"] == pytest.approx(frontier_scale(MEMORY, 0.1))


# --- under other settings ------------------------------------------------------------------------
def test_a_higher_weight_of_distance_prefers_the_nearer_candidate() -> None:
    far = ReceptacleOption(instance(8, "shelf"), 0.40, 1.95, 9.0)
    decision = stored(by_objective([TABLE, far], FRONTIERS, SearchMemory(), 0.001))
    assert decision.chosen.name == "shelf"
    again = recompute(decision, {"alpha_d": 0.01})
    assert again.flips
    assert again.certain
    assert again.decision.chosen.name == "coffee table"
    assert not recompute(decision, {"alpha_d": 0.0, "tau_g": 0.9}).flips


def test_a_decision_is_repeated_in_other_units_of_the_gain_only_if_it_holds_them() -> None:
    """Per Gaussian the shelf has more, by the sum the table."""
    gains = Gain(1200.0, 1000, 1.0, 5000.0), Gain(185.0, 100)
    table, shelf = replace(TABLE, gain=gains[0]), replace(SHELF, gain=gains[1])
    first = Gain(1000.0, 1000, 1.0, 4000.0)
    memory = SearchMemory({7: FirstSeen(0.5, 1.0, (3.0, 0.0), first)}, MEMORY.chosen)
    decision = stored(by_objective([table, shelf], FRONTIERS, memory, 0.001))
    again = under_gain_norm(decision, "per_gaussian")
    assert again is not None
    assert not flips(decision, again)
    assert again.settings["frontier_scale"] == pytest.approx(0.5 / 0.2, rel=0.02)
    by_sum = under_gain_norm(decision, "sum")
    assert by_sum is not None
    assert by_sum.chosen.terms["information_gain"] == 1200.0
    assert by_sum.settings["frontier_scale"] == pytest.approx(0.5 * 1000.0 / 0.2, rel=0.02)
    assert under_gain_norm(decision, "per_pixel") is None  # the shelf's pixels are unknown
    assert under_gain_norm(stored(by_objective([TABLE], FRONTIERS, MEMORY, 0.001)), "sum") is None


def test_a_recomputed_threshold_is_uncertain_where_a_view_was_never_evaluated() -> None:
    sure, doubted = stored(pick(view(0.55))), stored(pick(view(0.41, 0.53)))
    stricter = recompute(sure, {"tau_g": 0.7})
    assert (stricter.flips, stricter.certain) == (True, False)
    assert stricter.decision.why == (
        "not pick yet: no score reaches 0.70, and what one more view would bring was not asked for "
        "then"
    )
    assert (recompute(sure, {"tau_g": 0.3}).flips, recompute(sure, {"tau_b": 0.9}).flips) == (
        False,
        False,
    )
    bolder = recompute(doubted, {"tau_g": 0.4})
    assert (bolder.flips, bolder.certain, bolder.decision.do) == (True, True, Do.ACT)
    lazier = recompute(doubted, {"tau_inc": 0.2, "tau_g": 0.6})
    assert (lazier.flips, lazier.decision.do) == (True, Do.SEARCH_ON)


def test_a_higher_class_threshold_drops_candidates_and_a_lower_one_is_not_certain() -> None:
    decision = stored(by_objective([TABLE, SHELF], FRONTIERS, SearchMemory(), 0.001))
    higher = recompute(decision, {"cs_a": 0.7})
    assert (higher.flips, higher.certain) == (True, True)
    assert higher.decision.chosen.kind == "frontier"
    lower = recompute(decision, {"cs_a": 0.1})
    assert (lower.flips, lower.certain) == (False, False)


@pytest.mark.parametrize(("borders", "certain"), [(FRONTIERS, False), (FRONTIERS[:1], True)])
def test_which_frontier_follows_the_receptacles_is_not_certain_as_no_path_is_stored(
    borders: list[FrontierOption], certain: bool
) -> None:
    decision = stored(by_distance([TABLE, SHELF], borders, SearchMemory(), 0.001))
    higher = recompute(decision, {"cs_a": 0.7})
    assert (higher.flips, higher.certain) == (True, certain)


@pytest.mark.parametrize(
    ("texts", "says"),
    [
        ({"alpha": "1"}, "choose among alpha_d"),
        ({"alpha_d": "much"}, "wanted a number"),
        ({"tau_g": "nan"}, "wanted a number"),
        ({"alpha_d": "-1"}, "from 0 to 1000000"),
        ({"alpha_d": "1e308"}, "from 0 to 1000000"),
    ],
)
def test_invalid_settings_are_refused(texts: dict[str, str], says: str) -> None:
    with pytest.raises(InvalidInput, match=says):
        changes_of(texts)


shares = st.floats(0, 1)
ways_m = st.floats(0, 30)
receptacles = st.lists(
    st.builds(
        lambda id, s, ig, d: ReceptacleOption(instance(id, class_score=s), s, ig, d),
        st.integers(1, 50),
        st.floats(0.3, 1),
        st.floats(0, 5),
        ways_m,
    ),
    max_size=6,
    unique_by=lambda r: r.instance.id,
)
frontiers = st.lists(
    st.builds(FrontierOption, st.integers(1, 50), st.tuples(ways_m, ways_m), shares, ways_m),
    max_size=6,
    unique_by=lambda f: f.id,
)
memories = st.builds(
    SearchMemory,
    st.dictionaries(
        st.integers(1, 9),
        st.builds(FirstSeen, st.floats(0.3, 1), st.floats(0, 5), st.tuples(ways_m, ways_m)),
        max_size=5,
    ),
    st.lists(st.builds(ChosenFrontier, st.tuples(ways_m, ways_m), shares), max_size=4),
)
views = st.lists(
    st.builds(
        lambda id, psi, after, d, there: ViewOption(
            instance(id, score=psi, class_score=max(psi, 0.3)), psi, after, d, there
        ),
        st.integers(1, 50),
        shares,
        st.none() | shares,
        ways_m,
        st.booleans(),
    ),
    max_size=6,
    unique_by=lambda v: v.instance.id,
)


def test_rule_names_are_those_of_stored_decisions() -> None:
    assert [act.rule for act in Act] == [
        "pick (eq. 7, 11)",
        "place (eq. 7, 11)",
        "stop (eq. 7, 11)",
    ]
    assert DecisionRule.BY_OBJECTIVE == "global search (eq. 8-10)"
    assert DecisionRule.RECEPTACLES_FIRST == "receptacles first"


decisions = st.one_of(
    st.builds(by_objective, receptacles, frontiers, memories, st.just(USED.alpha_d)),
    st.builds(receptacles_first, receptacles, frontiers, memories, st.just(USED.alpha_d)),
    st.builds(
        lambda v, what, anywhere: act_or_look(v, 0.5, 0.05, "object", what, anywhere),
        views,
        st.sampled_from(Act),
        st.booleans(),
    ),
    frontiers.map(lambda f: highest_value(f, "place", RNG)),
    frontiers.map(lambda f: nearest(f, "place", RNG)),
)


@pytest.mark.parametrize(("kind", "reads"), [("object", "tau_g"), ("receptacle", "tau_b")])
def test_a_stop_is_recomputed_with_the_thresholds_of_what_it_stops_at(
    kind: str, reads: str
) -> None:
    s = Settings(tau_g=0.35, tau_b=0.2, cs_g=0.2, cs_b=0.15)
    view = ViewOption(instance(1, score=0.3), 0.3, None, 1.0)
    threshold = getattr(s, reads)
    decision = with_replay_settings(
        act_or_look([view], threshold, s.tau_inc, kind, Act.STOP, False), s
    )
    assert decision.settings["class_threshold"] == (s.cs_g if kind == "object" else s.cs_b)
    for name in ("tau_g", "tau_b"):
        opposite = 0.9 if decision.do is Do.ACT else 0.1
        assert recompute(decision, {name: opposite}).flips is (name == reads)


@pytest.mark.parametrize(("share", "flips"), [(1.0, False), (1.25, True)])
def test_a_threshold_that_was_a_share_of_tau_stays_that_share(share: float, flips: bool) -> None:
    there = [ViewOption(instance(1, score=0.6), 0.6, None, 2.0, True)]
    tau, share_of_tau = USED.tau_g, share * USED.tau_g
    then = stored(act_or_look(there, share_of_tau, 0.05, "object", Act.PICK, True))
    for same in (tau, tau + 1e-6):
        assert not recompute(then, {"tau_g": same}).flips
    lower = recompute(then, {"tau_g": 0.9 * tau})
    assert (lower.decision.settings["threshold"], lower.flips) == (
        pytest.approx(0.9 * share_of_tau),
        flips,
    )


@settings(deadline=None)
@given(decisions)
def test_a_decision_does_not_flip_under_the_same_settings(decision: Decision) -> None:
    for changes in ({}, OWN):
        again = recompute(stored(decision), changes)
        assert not again.flips
        assert again.certain
        assert again.decision.candidates == decision.candidates
        assert again.decision.why == decision.why


@settings(deadline=None)
@given(receptacles, frontiers, memories, st.floats(0, 1))
def test_a_recomputed_decision_is_the_one_that_would_have_been_made(
    r: list[ReceptacleOption], f: list[FrontierOption], memory: SearchMemory, alpha_d: float
) -> None:
    then = by_objective(r, f, memory, alpha_d)
    now = recompute(stored(by_objective(r, f, memory, USED.alpha_d)), {"alpha_d": alpha_d})
    assert (now.decision.do, now.decision.winner, now.decision.why) == (
        then.do,
        then.winner,
        then.why,
    )
    assert now.certain


@settings(deadline=None)
@given(decisions, st.sampled_from(SETTINGS), shares)
def test_any_setting_can_be_tried_on_any_decision(
    decision: Decision, name: str, value: float
) -> None:
    again = recompute(stored(decision), {name: value})
    assert again.decision.why
    assert (again.decision.winner is None) == (again.decision.do in (Do.SEARCH_ON, Do.NOTHING_LEFT))
