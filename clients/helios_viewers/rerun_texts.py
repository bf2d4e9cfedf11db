"""Tasks and decisions as Markdown. No I/O."""

from __future__ import annotations

from helios_core import proto as pb

MOST_CANDIDATES = 12
MOST_TERMS = 5


def task_text(task: pb.Task) -> str:
    """The task, what it does now, and its progress."""
    lines = [f"**{task.instruction}**", f"{task.state} {task.phase}".strip(), task.message]
    if task.progress:
        lines.append(f"{100 * task.progress:.0f} %, {task.steps} actions")
    return "\n\n".join(line for line in lines if line)


def decision_text(decision: pb.Decision) -> str:
    """The reason, and the best candidates with their terms; the chosen one is bold."""
    shown = sorted(decision.candidates, key=lambda c: -c.terms.get("total", 0.0))
    terms = list(dict.fromkeys(name for c in shown for name in c.terms))[-MOST_TERMS:]
    head = f"Decision {decision.index}: {decision.why}\n\n"
    if not shown:
        return head
    table = [f"| candidate | {' | '.join(terms)} |", f"|---|{'--:|' * len(terms)}"]
    for c in shown[:MOST_CANDIDATES]:
        name = f"**{c.name or c.kind}**" if c.chosen else c.name or c.kind
        values = [f"{c.terms[t]:.3g}" if t in c.terms else "" for t in terms]
        table.append(f"| {name} | {' | '.join(values)} |")
    return head + "\n".join(table)
