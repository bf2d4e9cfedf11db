"""The chain that a step waited for, and its report."""

from __future__ import annotations

import io
from itertools import pairwise

import pytest
from helios_client.answer_types import Task, Trace
from helios_client.commands.trace_view import trace_json, trace_report
from helios_client.terminal_output import Screen
from helios_client.trace_chain import Link, Span, TraceTree, shares
from hypothesis import given
from hypothesis import strategies as st

# Each (service, name, id, parent, start, end); seconds.
Rows = tuple[tuple[str, str, str, str, float, float], ...]
STEP: Rows = (
    ("planner", "action", "a", "task", 0.0, 1.0),
    ("bridge", "bridge/act", "b", "a", 0.1, 0.5),
    ("bridge", "keyframe", "c", "b", 0.3, 0.5),
    ("detector", "detection", "d", "c", 0.6, 0.9),  # begins after its sender has ended
    ("map2d", "update of occupancy", "e", "c", 0.55, 0.6),
    ("objectmap", "update of objects", "f", "d", 0.8, 0.95),  # while the detector goes on
    ("planner", "decision", "g", "task", 1.0, 1.4),
    ("objectmap", "objectmap/objects", "h", "g", 1.1, 1.3),
    ("planner", "action", "i", "task", 1.5, 1.6),
)


def spans(rows: Rows = STEP) -> list[Span]:
    return [Span(s, id, parent, name, start, end, {}) for s, name, id, parent, start, end in rows]


def rounded(chain: tuple[Link, ...]) -> list[tuple[str, float, float]]:
    return [(link.name, round(link.start_s, 3), round(link.end_s, 3)) for link in chain]


def test_the_chain_goes_through_what_ended_last() -> None:
    tree = TraceTree(spans())
    first, second = tree.steps
    assert (first.start_s, first.end_s) == (0.0, 1.5)
    assert rounded(tree.chain_of(first)) == [
        ("action", 0.0, 0.1),
        ("bridge/act", 0.1, 0.3),
        ("keyframe", 0.3, 0.5),
        ("keyframe, on the way", 0.5, 0.55),
        ("update of occupancy", 0.55, 0.6),
        ("detection", 0.6, 0.8),
        ("update of objects", 0.8, 0.95),
        ("action", 0.95, 1.0),
        ("decision", 1.0, 1.1),
        ("objectmap/objects", 1.1, 1.3),
        ("decision", 1.3, 1.4),
        ("decision, on the way", 1.4, 1.5),
    ]
    assert rounded(tree.chain_of(second)) == [("action", 1.5, 1.6)]


def test_work_that_nobody_waited_for_is_not_in_the_chain() -> None:
    slow = ("detector", "preview", "z", "d", 0.85, 3.0)
    chain = TraceTree(spans((*STEP, slow))).chain_of(TraceTree(spans()).steps[0])
    assert sum(link.took_s for link in chain) == pytest.approx(1.5)
    assert all(link.end_s <= 1.5 for link in chain)


times = st.floats(0.0, 10.0, allow_nan=False)


@st.composite
def traces(draw: st.DrawFn) -> list[Span]:
    """Any spans below two actions, also with children that begin before or end after."""
    out = spans(
        (
            ("planner", "action", "0", "task", 2.0, 5.0),
            ("planner", "planning", "1", "task", 5.0, 7.0),
            ("planner", "action", "2", "task", 7.0, 9.0),
        )
    )
    for number in range(3, 3 + draw(st.integers(0, 12))):
        parent = str(draw(st.integers(0, number - 1)))
        a, b = sorted((draw(times), draw(times)))
        out.append(Span("s", str(number), parent, f"work {number}", a, b, {}))
    return out


@given(traces())
def test_a_chain_fills_its_step_without_gap_or_overlap(given_spans: list[Span]) -> None:
    tree = TraceTree(given_spans)
    assert len(tree.steps) == 2
    for step in tree.steps:
        chain = tree.chain_of(step)
        assert chain[0].start_s == step.start_s
        assert chain[-1].end_s == step.end_s
        assert all(a.end_s == b.start_s for a, b in pairwise(chain))
        assert all(link.took_s > 0 for link in chain)
    found = shares(map(tree.chain_of, tree.steps))
    whole_s = sum(step.took_s for step in tree.steps)
    assert sum(share.total_s for share in found) == pytest.approx(whole_s)


def trace(
    note: str = "", rows: tuple[tuple[str, str, str, str, float, float], ...] = STEP
) -> Trace:
    return Trace.from_json(
        {
            "task_id": "c0ffee",
            "trace_id": "0af7651916cd43dd8448eb211c80319c",
            "spans": [{**vars(span), "attributes": {"rule": "eq. 10"}} for span in spans(rows)],
            "sources": [{"service": "map2d", "spans": 0, "note": note}],
        }
    )


def report(shown: Trace) -> str:
    screen = Screen(file=io.StringIO(), width=120)
    screen.print(trace_report(Task(id="c0ffee", instruction="find the mug"), shown))
    assert isinstance(screen.file, io.StringIO)
    return screen.file.getvalue()


def test_the_report_shows_the_shares_and_the_slowest_chain() -> None:
    said = report(trace())
    assert "slowest chain: step 1 of 2, 1500 ms" in said
    assert "update of objects" in said
    assert "eq. 10" in said
    assert "map2d:" not in said
    out = trace_json(trace())
    assert out["slowest"]["step"] == 1
    assert sum(link["took_s"] for link in out["slowest"]["chain"]) == pytest.approx(1.5)


def test_the_report_names_services_whose_spans_are_missing() -> None:
    assert "map2d: it does not answer" in report(trace("it does not answer"))


def test_a_trace_without_an_action_is_no_error() -> None:
    assert "no action of it has ended yet" in report(trace(rows=()))
    assert trace_json(trace(rows=()))["slowest"] is None
