"""Progress never falls and rises with every step; the time left is a range, or not given."""

from __future__ import annotations

import itertools

from helios_core import proto as pb
from helios_core.topics import TASK
from helios_planner.instruction.parser import Kind
from helios_planner.task import Phase
from helios_planner.tasks.progress import LEAST_STEPS, MOST_PROGRESS, ProgressEstimate
from hypothesis import given, settings
from hypothesis import strategies as st
from planner_bus import Start, ended, submit

events = st.one_of(
    st.tuples(st.just("step"), st.floats(0.0, 300.0)),
    st.tuples(st.just("phase"), st.sampled_from(Phase)),
    st.tuples(st.just("choice"), st.integers(1, 60)),
    st.tuples(st.just("way"), st.floats(0.0, 40.0)),
    st.tuples(st.just("rest"), st.none()),
)


@settings(deadline=None)
@given(
    st.sampled_from(Kind),
    st.integers(1, 400),
    st.lists(events, max_size=120),
    st.floats(0.0, 1000.0),
)
def test_progress_never_falls_and_every_time_range_is_valid(
    kind: Kind, max_steps: int, reported: list[tuple[str, object]], left_s: float
) -> None:
    pace, now_s, steps, before = ProgressEstimate(kind, max_steps, 0, 0.0), 0.0, 0, 0.0
    for what, value in reported:
        match what, value:
            case "step", float(took_s):
                now_s, steps = now_s + took_s, steps + 1
                pace.on_step(steps, now_s)
                assert pace.progress > before or before > MOST_PROGRESS - 1e-6
            case "phase", Phase() as phase:
                pace.on_phase(phase)
            case "choice", int(places):
                pace.on_choice(places)
            case "way", float(length_m):
                pace.on_way(length_m)
            case _:
                pace.on_rest()
        assert before <= pace.progress <= MOST_PROGRESS
        before = pace.progress
        low, high = pace.steps_left()
        assert 0 <= low <= high <= max(max_steps - steps, 0)
        eta_s = pace.eta_s(left_s)
        if steps <= LEAST_STEPS:
            assert eta_s is None
        if eta_s is not None:
            assert 0 <= eta_s[0] <= eta_s[1] <= left_s


def test_the_time_range_follows_the_pace_of_the_task_without_its_pauses() -> None:
    pace = ProgressEstimate(Kind.FIND, 1000, 0, 0.0)
    pace.on_phase(Phase.FIND_OBJECT)
    for n in range(1, 11):
        pace.on_step(n, 2.0 * n)
    before = pace.eta_s()
    pace.on_rest()
    pace.on_step(11, 90.0)
    pace.on_step(12, 92.0)
    assert before is not None
    assert before[1] == 2.0 * (300 - 10)
    after = pace.eta_s()
    assert after is not None
    assert after[1] == 2.0 * (300 - 12)


def test_fewer_places_left_to_search_lower_the_estimated_steps() -> None:
    pace = ProgressEstimate(Kind.FIND, 1000, 0, 0.0)
    pace.on_phase(Phase.FIND_OBJECT)
    most = []
    for places in (20, 10, 3, 1):
        pace.on_choice(places)
        most.append(pace.steps_left()[1])
    assert most == sorted(most, reverse=True)


def test_a_task_that_is_resumed_after_its_planner_died_keeps_its_progress() -> None:
    pace = ProgressEstimate(Kind.MOVE, 1000, 120, 0.4)
    assert pace.progress == 0.4
    pace.on_step(121, 1.0)
    assert pace.progress > 0.4


def test_a_whole_task_reports_progress_that_never_falls_and_a_time_range(start: Start) -> None:
    _, bus, _ = start()
    reported: list[pb.Task] = []
    bus.subscribe(TASK, reported.append)
    done = ended(bus, submit(bus).id)
    assert (done.state, done.progress) == ("succeeded", 1.0)
    assert all(a.progress <= b.progress for a, b in itertools.pairwise(reported))
    assert len({t.progress for t in reported}) > done.steps
    ranges = [(t.eta_low_s, t.eta_high_s) for t in reported if t.HasField("eta_low_s")]
    assert len(ranges) > done.steps / 2
    assert all(0 <= low <= high for low, high in ranges)
    assert not any(t.HasField("eta_high_s") for t in reported if t.steps <= LEAST_STEPS)
    assert not done.HasField("eta_low_s")
