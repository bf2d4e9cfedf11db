"""The schedule of faults: the same for a seed, every kind and target in turn, within its limits."""

from __future__ import annotations

import itertools
from collections import Counter

from helios_chaos.schedule import (
    FREEZE_S,
    KINDS,
    LINKS,
    SERVICES,
    WEIGHTS,
    Fault,
    Kind,
    schedule,
)
from hypothesis import given
from hypothesis import strategies as st

SEEDS = st.integers(0, 10_000)
ROUND = sum(WEIGHTS.get(kind, 1) for kind in KINDS)


def first(n: int, seed: int, kinds: tuple[Kind, ...] = KINDS, most_s: float = 15.0) -> list[Fault]:
    return list(itertools.islice(schedule(seed, kinds, most_s), n))


@given(SEEDS)
def test_a_seed_gives_one_schedule(seed: int) -> None:
    assert first(60, seed) == first(60, seed)


def test_other_seeds_give_other_schedules() -> None:
    assert len({tuple(first(20, seed)) for seed in range(20)}) == 20


@given(SEEDS)
def test_a_round_has_every_kind_as_often_as_its_weight(seed: int) -> None:
    counts = Counter(fault.kind for fault in first(ROUND, seed))
    assert counts == {kind: WEIGHTS.get(kind, 1) for kind in KINDS}


@given(SEEDS)
def test_every_service_is_killed_and_every_link_cut(seed: int) -> None:
    faults = first(12 * ROUND, seed)
    assert {f.target for f in faults if f.kind == "kill"} == set(SERVICES)
    assert {f.target for f in faults if f.kind == "cut"} == set(LINKS)


@given(SEEDS, st.floats(0.5, 15.0))
def test_durations_keep_their_limits(seed: int, most_s: float) -> None:
    for fault in first(3 * ROUND, seed, most_s=most_s):
        assert fault.lasts_s <= most_s + 0.005
        if fault.kind == "freeze":
            assert fault.lasts_s >= min(FREEZE_S[0], most_s) - 0.005
        assert fault.rest_s > 0


@given(SEEDS, st.sets(st.sampled_from(KINDS), min_size=1))
def test_only_the_wanted_kinds_are_played(seed: int, kinds: set[Kind]) -> None:
    wanted: tuple[Kind, ...] = tuple(kind for kind in KINDS if kind in kinds)
    assert {fault.kind for fault in first(2 * ROUND, seed, wanted)} == kinds
