"""Decisions of the paper's rules (eq. 8-11, the speed of FM²) against twins in plain numpy."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from helios_core.types import ObjectInstance
from helios_planner.decisions.acceptance import act_or_look
from helios_planner.decisions.decision import Act, Do, FrontierOption, ReceptacleOption, ViewOption
from helios_planner.decisions.global_search import (
    ChosenFrontier,
    FirstSeen,
    SearchMemory,
    by_objective,
)
from helios_planner.motion_planning.path_planner import speed_field
from hypothesis import given, settings
from hypothesis import strategies as st
from planner_rig import TABLE_XY, instance
from planner_things import Thing

SEEDS = st.integers(0, 2**32 - 1)


def thing(id: int) -> ObjectInstance:
    return instance(Thing(id, "table", np.array([*TABLE_XY, 0.5]), np.ones(3)))


def reference_scale(seen: np.ndarray, chosen: np.ndarray, alpha_d: float) -> float:
    """F_0 of eq. 9. seen: [n, 4] S_a0, IG_a0, x, y; chosen: [m, 3] x, y, F."""
    if not len(seen) or not len(chosen) or (chosen[:, 2] == 0).any():
        return 1.0
    away_m = np.linalg.norm(seen[:, None, 2:] - chosen[None, :, :2], axis=2)
    v0 = (seen[:, 0] * seen[:, 1])[:, None] - alpha_d * away_m  # eq. 8, for each pair
    scale = float((v0.max(axis=0) / chosen[:, 2]).mean())
    return scale if scale > 0 else 1.0


@settings(max_examples=300, deadline=None)
@given(SEEDS, st.sampled_from([0.0001, 0.001, 0.01, 0.3]))
def test_values_and_winners_of_random_states_equal_equations_8_to_10(seed, alpha_d):
    rng = np.random.default_rng(seed)
    seen = rng.uniform(0, [1, 20, 10, 10], (rng.integers(0, 5), 4))
    chosen = rng.uniform(0, [10, 10, 1], (rng.integers(0, 5), 3))
    chosen[rng.random(len(chosen)) < 0.1, 2] = 0
    places = rng.uniform(0, [1, 20, 10], (rng.integers(0, 6), 3))  # S, IG, distance
    borders = rng.uniform(0, [1, 10], (rng.integers(0, 6), 2))  # F, distance
    memory = SearchMemory(
        {k: FirstSeen(float(s), float(ig), (x, y)) for k, (s, ig, x, y) in enumerate(seen)},
        [ChosenFrontier((x, y), float(value)) for x, y, value in chosen],
    )
    decision = by_objective(
        [ReceptacleOption(thing(k), s, ig, m) for k, (s, ig, m) in enumerate(places.tolist())],
        [FrontierOption(k, (0.0, 0.0), *map(float, row)) for k, row in enumerate(borders)],
        memory,
        alpha_d,
    )
    scale = reference_scale(seen, chosen, alpha_d)
    wanted = np.concatenate(
        [
            places[:, 0] * places[:, 1] - alpha_d * places[:, 2],
            borders[:, 0] * scale - alpha_d * borders[:, 1],
        ]
    )
    assert [c.terms["total"] for c in decision.candidates] == pytest.approx(wanted.tolist())
    if not len(wanted):
        assert decision.do is Do.NOTHING_LEFT
        return
    best = int(wanted.argmax())
    assert decision.winner == best
    assert decision.do is (Do.SEARCH_RECEPTACLE if best < len(places) else Do.GO_TO_FRONTIER)


def reference_action(psi: np.ndarray, after: np.ndarray, tau: float, tau_inc: float):
    """What the paper does, and with which candidate. after: Psi' of eq. 11, NaN without a view."""
    if (psi >= tau).any():
        return Do.ACT, int(psi.argmax())
    worth = after >= np.minimum(tau, psi + tau_inc)  # False for NaN
    if worth.any():
        return Do.LOOK, int(np.where(worth, after, -math.inf).argmax())
    return Do.SEARCH_ON, None


@settings(max_examples=300, deadline=None)
@given(SEEDS, st.sampled_from([0.3, 0.5, 0.7]), st.sampled_from([0.05, 0.1]))
def test_actions_of_random_states_equal_the_papers_rule(seed, tau, tau_inc):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 5))
    psi = rng.uniform(0, rng.choice([0.6, 1.0]), n)
    after = psi + rng.uniform(-0.05, 0.2, n)
    after[rng.random(n) < 0.3] = np.nan
    options = [
        ViewOption(
            replace(thing(k), score=float(psi[k])),
            float(psi[k]),
            None if np.isnan(after[k]) else float(after[k]),
            1.0,
        )
        for k in range(n)
    ]
    decision = act_or_look(options, tau, tau_inc, "object", Act.PICK)
    assert (decision.do, decision.winner) == reference_action(psi, after, tau, tau_inc)


def test_speed_is_proportional_to_the_distance_from_the_rim_up_to_its_maximum() -> None:
    clearance_m = np.zeros((3, 9), np.float32)
    clearance_m[1] = [9.0, 0.30, 0.34, 0.35, 0.40, 0.45, 0.60, 2.0, 9.0]
    speed = speed_field(clearance_m, required_m=0.35, contact_m=0.30, saturation_m=0.30)
    assert speed[1] == pytest.approx([0, 0, 0, 1 / 6, 1 / 3, 1 / 2, 1, 1, 0])
    assert not speed[[0, -1]].any()
