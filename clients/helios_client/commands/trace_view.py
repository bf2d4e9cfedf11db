"""The trace of a task as text: where its time went, and its slowest chain."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from helios_core.printable_text import counted
from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from helios_client.answer_types import Task, Trace
from helios_client.terminal_output import plain_table
from helios_client.trace_chain import Link, Share, Span, Step, TraceTree, shares

MOST_SHARES = 12
LEAST_S = 0.001  # shorter links of a chain are left out of its table
SHOWN = ("action", "rule", "do", "detector", "scorer", "helios.keyframe")  # attributes, in order


def trace_report(task: Task, trace: Trace) -> Group:
    """Tables of the parts and of the slowest step's chain."""
    tree = TraceTree(map(Span.from_json, trace.spans))
    parts: list[RenderableType] = [_head(task, trace, tree)]
    parts += [Text(f"{s['service']}: {s['note']}", style="yellow") for s in missing(trace)]
    if tree.steps:
        chains = [tree.chain_of(step) for step in tree.steps]
        parts += ["", Text("where the time went", style="bold"), _shares(shares(chains))]
        slowest = max(range(len(chains)), key=lambda i: tree.steps[i].took_s)
        parts += ["", *_slowest(tree.steps, slowest, chains[slowest])]
    else:
        parts.append("no action of it has ended yet; try again later")
    return Group(*parts)


def trace_json(trace: Trace) -> dict[str, Any]:
    """The trace with its slowest chain and the shares, for programs."""
    tree = TraceTree(map(Span.from_json, trace.spans))
    chains = [tree.chain_of(step) for step in tree.steps]
    slowest = max(range(len(chains)), key=lambda i: tree.steps[i].took_s, default=None)
    return {
        "trace": trace.raw,
        "shares": [
            {
                "service": s.service, "name": s.name, "count": s.count,
                "total_s": s.total_s, "longest_s": s.longest_s,
            }
            for s in shares(chains)
        ],
        "slowest": None if slowest is None else {
            "step": slowest + 1, "steps": len(chains),
            "start_s": tree.steps[slowest].start_s, "took_s": tree.steps[slowest].took_s,
            "chain": [
                {
                    "service": link.span.service, "name": link.name, "start_s": link.start_s,
                    "took_s": link.took_s, "attributes": link.span.attributes,
                }
                for link in chains[slowest]
            ],
        },
    }  # fmt: skip


def missing(trace: Trace) -> list[dict[str, Any]]:
    """Services whose spans are missing."""
    return [source for source in trace.sources if source["note"]]


def _head(task: Task, trace: Trace, tree: TraceTree) -> Group:
    waited = ""
    if task.started_s:
        waited = f", {task.started_s - task.created_s:.1f} s in the queue"
    counts = f"{counted(len(tree.steps), 'step')}, {counted(len(trace.spans), 'span')}"
    return Group(
        Text(task.instruction, style="bold"),
        Text(f"task {task.id}, trace {trace.trace_id}, {counts}{waited}", style="dim"),
    )


def _shares(found: Sequence[Share]) -> Table:
    out = plain_table("service", "work", "times", "in all (s)", "share", "longest (ms)")
    whole_s = sum(share.total_s for share in found)
    for share in found[:MOST_SHARES]:
        out.add_row(
            share.service,
            escape(share.name),
            str(share.count),
            f"{share.total_s:.2f}",
            f"{100 * share.total_s / whole_s:.0f} %",
            f"{1e3 * share.longest_s:.0f}",
        )
    rest = found[MOST_SHARES:]
    if rest:
        rest_s = sum(share.total_s for share in rest)
        out.add_row(
            "", f"{len(rest)} others", "", f"{rest_s:.2f}", f"{100 * rest_s / whole_s:.0f} %", ""
        )
    return out


def _slowest(steps: Sequence[Step], at: int, chain: Sequence[Link]) -> list[RenderableType]:
    step = steps[at]
    title = f"slowest chain: step {at + 1} of {len(steps)}, {1e3 * step.took_s:.0f} ms"
    table = plain_table("at (ms)", "took (ms)", "service", "work", "")
    for link in chain:
        if link.took_s < LEAST_S:
            continue
        table.add_row(
            f"{1e3 * (link.start_s - step.start_s):.0f}",
            f"{1e3 * link.took_s:.0f}",
            link.span.service,
            escape(link.name),
            escape(_detail(link)),
        )
    return [Text(title, style="bold"), table]


def _detail(link: Link) -> str:
    found = [link.span.attributes[name] for name in SHOWN if name in link.span.attributes]
    missing, error = link.span.attributes.get("missing"), link.span.error
    found += [f"without an answer of {missing}"] if missing else []
    return ", ".join([*found, *([f"failed: {error}"] if error else [])])
