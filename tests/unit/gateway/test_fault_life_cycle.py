"""Life cycle of faults: raised, confirmed, cleared, with counts."""

from __future__ import annotations

from collections.abc import Iterable

import pytest
from helios_core import proto as pb
from helios_gateway.faults import findings
from helios_gateway.faults.life_cycle import (
    CLEAR_S,
    CONFIRM_S,
    MOST_FAULTS,
    OFTEN,
    Fault,
    FaultRegistry,
    FaultState,
    Finding,
)
from hypothesis import given
from hypothesis import strategies as st

DEGRADED = Finding("detector", "degraded", "the model fails", "warning")
FAILED = Finding("task", "object-not-found", "no mug was found")
EVENT = Finding("map2d", "restarted", "ended by SIGKILL", keep_s=60.0)


def only(registry: FaultRegistry) -> Fault:
    (fault,) = registry.faults()
    return fault


def test_a_condition_that_lasts_is_confirmed_and_cleared_after_it_has_gone() -> None:
    registry = FaultRegistry()
    (raised,) = registry.observe(100.0, [DEGRADED])
    assert (raised.id, raised.state, raised.count) == ("detector-degraded", FaultState.RAISED, 1)
    assert not registry.observe(100.0 + CONFIRM_S - 0.1, [DEGRADED])
    (confirmed,) = registry.observe(100.0 + CONFIRM_S, [DEGRADED])
    assert (confirmed.state, confirmed.confirmed_s) == (FaultState.CONFIRMED, 100.0 + CONFIRM_S)
    assert not registry.observe(110.0, [DEGRADED])
    assert not registry.observe(111.0, [])
    assert not registry.observe(110.0 + CLEAR_S - 0.1, [])
    (cleared,) = registry.observe(110.0 + CLEAR_S, [])
    assert (cleared.state, cleared.last_s, cleared.count) == (FaultState.CLEARED, 110.0, 1)


def test_a_short_condition_is_never_confirmed_unless_it_comes_often() -> None:
    registry = FaultRegistry()
    for number in range(OFTEN):
        registry.observe(10.0 + number, [DEGRADED])
        state = only(registry).state
        registry.observe(10.5 + number, [])
        assert (state is FaultState.CONFIRMED) == (number == OFTEN - 1)
    assert only(registry).count == OFTEN


def test_a_fault_that_returns_after_it_was_cleared_is_raised_again() -> None:
    registry = FaultRegistry()
    for begin in (0.0, 100.0):
        registry.observe(begin, [DEGRADED])
        registry.observe(begin + 1, [])
        registry.observe(begin + 50, [])
        assert only(registry).state is FaultState.CLEARED
    again = registry.observe(200.0, [DEGRADED])[0]
    assert (again.state, again.count, again.episode) == (FaultState.RAISED, 3, 1)
    assert (again.first_s, again.raised_s, again.cleared_s) == (0.0, 200.0, 0.0)


def test_an_event_is_confirmed_at_once_and_counted() -> None:
    registry = FaultRegistry()
    for now_s in (1.0, 2.0):
        (fault,) = registry.occur(now_s, FAILED)
        assert fault.state is FaultState.CONFIRMED
    assert only(registry).count == 2
    assert not registry.observe(1e6, [])  # a failed task is not well again by itself
    (cleared,) = registry.clear(1e6, ["task-object-not-found"])
    assert cleared.state is FaultState.CLEARED
    assert not registry.clear(1e6, ["task-object-not-found", "no-such"])


def test_an_event_with_a_time_is_cleared_after_it() -> None:
    registry = FaultRegistry()
    registry.occur(0.0, EVENT)
    assert not registry.observe(59.0, [])
    assert registry.observe(60.0, [])[0].state is FaultState.CLEARED


def test_confirmed_faults_come_first_and_the_book_is_limited() -> None:
    registry = FaultRegistry()
    for number in range(2 * MOST_FAULTS):
        registry.occur(float(number), Finding(f"s{number}", "restarted", "", keep_s=0.0))
        registry.observe(number + 0.5, [])
    registry.occur(1e6, FAILED)
    faults = registry.faults()
    assert len(faults) == MOST_FAULTS
    assert faults[0].id == "task-object-not-found"


finding_sets = st.lists(
    st.tuples(st.floats(0.01, 10.0), st.sets(st.sampled_from(["a", "b"])), st.booleans()),
    max_size=40,
)


@given(finding_sets)
def test_the_order_of_states_and_times_holds_for_any_sequence(
    given_steps: list[tuple[float, set[str], bool]],
) -> None:
    registry, now_s, occurrences = FaultRegistry(), 1.0, 0
    before: set[str] = set()
    for step_s, present, event in given_steps:
        now_s += step_s
        occurrences += len(present - before)
        before = present
        changed = registry.observe(now_s, [Finding(name, "degraded", "") for name in present])
        assert len({fault.id for fault in changed}) == len(changed)
        if event:
            occurrences += 1
            registry.occur(now_s, FAILED)
        for fault in registry.faults():
            assert fault.first_s <= fault.raised_s <= fault.last_s <= now_s
            if fault.state is FaultState.CONFIRMED:
                assert fault.raised_s <= fault.confirmed_s <= now_s
            if fault.source in present:
                assert fault.present
                assert fault.state is not FaultState.CLEARED
    assert sum(fault.count for fault in registry.faults()) == occurrences


def status(**restarts: int) -> pb.SupervisorStatus:
    """Process table of one supervisor, with the number of restarts of each process."""
    return pb.SupervisorStatus(
        processes=[
            pb.ProcessStatus(name=name, restarts=count, reason="ended by SIGKILL")
            for name, count in restarts.items()
        ]
    )


def found_in(statuses: Iterable[pb.SupervisorStatus]) -> list[list[str]]:
    """Ids of the findings in each of the statuses."""
    known: dict[str, int] = {}
    out = []
    for one in statuses:
        found, known = findings.restarts(known, one)
        out.append([finding.id for finding in found])
    return out


def test_only_new_restarts_are_findings() -> None:
    found, known = findings.restarts({}, status(map2d=4, planner=0))
    assert not found
    found, known = findings.restarts(known, status(map2d=5, planner=0))
    assert [(f.id, f.message) for f in found] == [("map2d-restarted", "ended by SIGKILL")]
    found, _ = findings.restarts(known, status(map2d=5, planner=0))
    assert not found


def test_two_supervisors_of_one_robot_find_each_restart_once() -> None:
    on_robot, on_server = status(bridge=1), status(map2d=3, planner=0)
    before = [on_robot, on_server, on_robot, on_server]
    assert found_in(before) == [[], [], [], []]
    restarted = [status(bridge=2), on_server, status(bridge=2), status(map2d=4, planner=0)]
    assert found_in([*before, *restarted])[4:] == [
        ["bridge-restarted"],
        [],
        [],
        ["map2d-restarted"],
    ]


def test_a_supervisor_that_begins_anew_is_counted_from_its_own_table() -> None:
    tables = [status(map2d=3), status(map2d=0), status(map2d=1)]
    assert found_in(tables) == [[], [], ["map2d-restarted"]]


def test_a_gateway_that_was_restarted_finds_itself_once_in_whichever_table_it_is() -> None:
    tables = [status(bridge=1), status(gateway=2), status(bridge=1), status(gateway=2)]
    assert found_in(tables) == [[], ["gateway-restarted"], [], []]


def test_failed_tasks_are_one_fault_per_cause() -> None:
    task = pb.Task(id="c0ffee", cause="object not found", message="no mug\nwas found")
    found = findings.failed_task(task)
    assert found.id == "task-object-not-found"
    assert found.message.startswith("task c0ffee: no mug")
    assert "\n" not in found.message
    assert findings.failed_task(pb.Task(cause="")).id == "task-unknown-cause"


@pytest.mark.parametrize("name", ["my_driver/v2", "My Driver: v2", "../my driver\x1b/v2/"])
def test_an_id_has_only_small_letters_digits_and_hyphens(name: str) -> None:
    found = findings.restart(pb.ProcessStatus(name=name))
    assert (found.id, found.source) == ("my-driver-v2-restarted", name)
