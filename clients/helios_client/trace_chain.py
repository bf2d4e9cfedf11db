"""The chain of work that a task waited for, from the spans of its trace. No I/O.

A step begins with an action and ends where the next action begins. Its chain is found backwards
from its end: at each moment the span that ended last is the one that the rest waited for.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

ACTION = "action"
STEP_PARTS = (ACTION, "planning", "decision")  # spans of the planner that follow each other
ON_THE_WAY = "on the way"  # between the end of one span and the start of the next


@dataclass(frozen=True)
class Span:
    """One piece of work; seconds since 1970."""

    service: str
    id: str
    parent_id: str
    name: str
    start_s: float
    end_s: float
    attributes: dict[str, str]
    error: str = ""

    @classmethod
    def from_json(cls, raw: dict[str, Any]) -> Span:
        return cls(**{name: raw[name] for name in cls.__dataclass_fields__})


@dataclass(frozen=True)
class Link:
    """One part of a chain: the time in which `span` itself was waited for."""

    span: Span
    start_s: float
    end_s: float
    on_the_way: bool = False  # True: the next span had not begun yet

    @property
    def name(self) -> str:
        return f"{self.span.name}, {ON_THE_WAY}" if self.on_the_way else self.span.name

    @property
    def took_s(self) -> float:
        return self.end_s - self.start_s


@dataclass(frozen=True)
class Step:
    """One action with what follows until the next one."""

    parts: tuple[Span, ...]
    end_s: float

    @property
    def start_s(self) -> float:
        return self.parts[0].start_s

    @property
    def took_s(self) -> float:
        return self.end_s - self.start_s


class TraceTree:
    """Spans of one trace by their parents."""

    def __init__(self, spans: Iterable[Span]) -> None:
        self.spans = tuple(sorted(spans, key=lambda span: span.start_s))
        self._children: dict[str, list[Span]] = defaultdict(list)
        for span in self.spans:
            self._children[span.parent_id].append(span)

    @cached_property
    def steps(self) -> tuple[Step, ...]:
        """Steps of the task in order; the time before its first action belongs to none."""
        parts = [s for s in self.spans if s.service == "planner" and s.name in STEP_PARTS]
        starts = [i for i, part in enumerate(parts) if part.name == ACTION]
        out = []
        for start, end in zip(starts, [*starts, len(parts)][1:], strict=True):
            mine = tuple(parts[start:end])
            ends_s = parts[end].start_s if end < len(parts) else mine[-1].end_s
            out.append(Step(mine, ends_s))
        return tuple(out)

    def chain_of(self, step: Step) -> tuple[Link, ...]:
        """Chain of a step, oldest part first; together the parts fill its time."""
        out: list[Link] = []
        until = step.end_s
        for part in reversed(step.parts):
            out += self._chain(part, until, whole=True)
            until = part.start_s
        return tuple(link for link in reversed(out) if link.took_s > 0)

    def _chain(self, span: Span, until: float, whole: bool = False) -> list[Link]:
        """Chain of a span that was waited for until then, newest part first.

        whole: the span itself fills the time until then.
        """
        out: list[Link] = []
        at = until if whole else self._reach(span, until)
        while True:
            begun = [c for c in self._children[span.id] if span.start_s <= c.start_s < at]
            last = max(begun, key=lambda c: self._reach(c, at), default=None)
            reached = span.start_s if last is None else self._reach(last, at)
            out += _own(span, reached, at)
            if last is None:
                return out
            out += self._chain(last, reached)
            at = last.start_s

    def _reach(self, span: Span, until: float) -> float:
        """End of the span's own or caused work that was waited for until then.

        A span that runs on after that was not waited for itself, only what it has caused.
        """
        caused = [
            self._reach(child, until)
            for child in self._children[span.id]
            if span.start_s <= child.start_s < until
        ]
        own = span.end_s if span.end_s <= until else (span.start_s if caused else until)
        return max((own, *caused))


def _own(span: Span, start_s: float, end_s: float) -> list[Link]:
    """Links for a stretch of time of a span, newest first. What lies after its end is the way to
    the next span."""
    cut = min(max(span.end_s, start_s), end_s)
    links = [Link(span, cut, end_s, on_the_way=True), Link(span, start_s, cut)]
    return [link for link in links if link.took_s > 0]


@dataclass(frozen=True)
class Share:
    """Time of all chains that one kind of work took."""

    service: str
    name: str
    count: int
    total_s: float
    longest_s: float


def shares(chains: Iterable[Sequence[Link]]) -> tuple[Share, ...]:
    """Where the time of these chains went, most first."""
    took: dict[tuple[str, str], list[float]] = defaultdict(list)
    for chain in chains:
        for link in chain:
            took[link.span.service, link.name].append(link.took_s)
    out = [Share(*key, len(all_s), sum(all_s), max(all_s)) for key, all_s in took.items()]
    return tuple(sorted(out, key=lambda share: -share.total_s))
