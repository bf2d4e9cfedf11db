"""Decisions as text for a person: one sentence each, and the candidates with their terms."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from helios_core.printable_text import counted
from rich.console import Group, RenderableType
from rich.markup import escape
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from helios_client.answer_types import Decision, Task
from helios_client.commands.candidate_table import INDENT, Candidates
from helios_client.commands.tables import TASK_COLORS


def flips(decisions: Iterable[Decision]) -> list[Decision]:
    """Decisions that would change under the requested settings."""
    return [d for d in decisions if d.recomputed and d.recomputed["flips"]]


def report(
    task: Task, decisions: Sequence[Decision], changes: Sequence[str], top: int, everything: bool
) -> Group:
    """All decisions with `top` candidates each. With changes only those that would flip or are
    uncertain, unless `everything` is set."""
    parts: list[RenderableType] = [_head(task, decisions)]
    shown = list(decisions)
    if changes:
        parts.append(_verdict(decisions, changes))
        shown = [d for d in decisions if everything or _matters(d)]
    phase = None
    for decision in shown:
        if decision.phase != phase:
            phase = decision.phase
            parts += ["", Text(phase.replace("_", " ") or "start", style="bold")]
        parts.append(_line(decision, task.started_s))
        if changes and decision.recomputed:
            parts.append(_instead(decision))
        if top and decision.candidates:
            parts.append(Candidates(decision, top))
    return Group(*parts)


# --- parts -------------------------------------------------------------------------------------
def _head(task: Task, decisions: Sequence[Decision]) -> Group:
    color = TASK_COLORS.get(task.state, "default")
    steps, count = counted(task.steps, "step"), counted(len(decisions), "decision")
    ended = f"[{color}]{task.state}[/]" + (f": {escape(task.message)}" if task.message else "")
    return Group(
        Text(task.instruction, style="bold"),
        Text.from_markup(ended),
        Text(f"task {task.id}, {steps}, {count}", style="dim"),
    )


def _verdict(decisions: Sequence[Decision], changes: Sequence[str]) -> Text:
    flipped = flips(decisions)
    unsure = sum(1 for d in decisions if d.recomputed and not d.recomputed["certain"])
    out = Text("\nunder ").append(", ".join(changes), style="bold")
    out.append(f" {len(flipped)} of {counted(len(decisions), 'decision')} would flip")
    if unsure:
        out.append(
            f"; {unsure} depend{'s' if unsure == 1 else ''} on values not queried at the time",
            style="yellow",
        )
    if flipped:
        out.append("\nafter the first flip, the run would have continued differently", style="dim")
    return out


def _matters(decision: Decision) -> bool:
    again = decision.recomputed
    return again is not None and (again["flips"] or not again["certain"])


def _line(decision: Decision, started_s: float) -> Table:
    row = Table.grid(padding=(0, 2, 0, 0))
    row.add_column(justify="right", style="dim", width=4)
    row.add_column(justify="right", style="dim", width=7)
    row.add_column()
    after_s = decision.made_s - started_s if started_s and decision.made_s else None
    row.add_row(
        str(decision.index), "" if after_s is None else f"{after_s:.0f} s", _sentence(decision.why)
    )
    return row


def _sentence(why: str) -> Text:
    """Sentence of a decision, with its action highlighted."""
    what, colon, reason = why.partition(": ")
    return Text(what, style="bold cyan").append(colon + reason, style="default")


def _instead(decision: Decision) -> Padding:
    again: dict[str, Any] = decision.recomputed or {}
    if again["flips"]:
        mark = Text("would " if again["certain"] else "might ", style="bold yellow")
        return Padding(mark.append(again["why"], style="yellow"), (0, 0, 0, INDENT), expand=False)
    words = "would stay the same" if again["certain"] else "unknown: not queried at the time"
    return Padding(Text(words, style="dim"), (0, 0, 0, INDENT), expand=False)
