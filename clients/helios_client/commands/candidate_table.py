"""Table of a decision's candidates and their terms, as wide as the terminal allows."""

from __future__ import annotations

from typing import Any

from rich.console import Console, ConsoleOptions, RenderResult
from rich.measure import Measurement
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from helios_client.answer_types import Decision

INDENT = 15  # indent of the details below a sentence
_ORDER = (  # a term follows those that it is computed from
    "class_score", "uncertainty", "information_gain", "value", "frontier_scale", "size_m",
    "distance_m", "way_m", "unknown_m", "views", "in_place", "place", "in_hand", "score",
    "score_after_view", "total",
)  # fmt: skip
_ALL_OF_TOTAL = ("score", "score_after_view")  # a total equal to one of these is not shown
_LAYOUTS = ((False, INDENT), (True, INDENT), (True, 2))  # one word per line in the heading?, indent


class Candidates:
    """Table of the best candidates and the chosen one, with a column per term; if too wide, with a
    row per term. Names and numbers are never cut."""

    def __init__(self, decision: Decision, top: int) -> None:
        by_total = sorted(decision.candidates, key=lambda c: -(c["terms"].get("total") or 0.0))
        self._shown = by_total[:top] + [c for c in by_total[top:] if c["chosen"]]
        hidden = len(decision.candidates) - len(self._shown)
        self._rest = Text(f"and {hidden} more" if hidden else "", style="dim")
        self._terms = sorted(
            dict.fromkeys(name for c in self._shown for name in c["terms"]),
            key=lambda n: _ORDER.index(n) if n in _ORDER else -1,
        )
        if any(self._is_total(name) for name in _ALL_OF_TOTAL):
            self._terms.remove("total")

    def _is_total(self, name: str) -> bool:
        both = [(c["terms"].get(name), c["terms"].get("total")) for c in self._shown]
        return all(value is not None and value == total for value, total in both)

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        for stacked, indent in _LAYOUTS:
            table = self._by_candidate(stacked)
            if indent + Measurement.get(console, options, table).maximum <= options.max_width:
                break
        else:
            table, indent = self._by_term(), 2
        yield Padding(table, (0, 0, 0, indent), expand=False)
        if self._rest:
            yield Padding(self._rest, (0, 0, 0, indent + 3), expand=False)

    def _by_candidate(self, stacked: bool) -> Table:
        out = Table.grid(padding=(0, 2, 0, 0))
        out.add_column(width=1)
        out.add_column(vertical="bottom")
        for _ in self._terms:
            out.add_column(justify="right", no_wrap=True, vertical="bottom")
        titles = [_title(n).replace(" ", "\n" if stacked else " ") for n in self._terms]
        out.add_row("", *(Text(title, style="dim") for title in ["candidate", *titles]))
        for c in self._shown:
            mark = Text("›", style="bold cyan") if c["chosen"] else Text("")
            out.add_row(mark, _name(c), *(_cell(c, n) for n in self._terms))
        return out

    def _by_term(self) -> Table:
        out = Table.grid(padding=(0, 2, 0, 0))
        out.add_column(style="dim", no_wrap=True)
        for _ in self._shown:
            out.add_column(justify="right", vertical="bottom", overflow="fold")
        marks = [Text("› " if c["chosen"] else "", style="bold cyan") for c in self._shown]
        names = [mark.append_text(_name(c)) for mark, c in zip(marks, self._shown, strict=True)]
        out.add_row("candidate", *names)
        for n in self._terms:
            out.add_row(_title(n), *(_cell(c, n) for c in self._shown))
        return out


def _name(candidate: dict[str, Any]) -> Text:
    return Text(candidate["name"] or candidate["kind"], style=_style(candidate))


def _cell(candidate: dict[str, Any], term: str) -> Text:
    return Text(_value(term, candidate["terms"].get(term)), style=_style(candidate))


def _style(candidate: dict[str, Any]) -> str:
    return "bold" if candidate["chosen"] else "default"


def _title(name: str) -> str:
    return name.removesuffix("_m").replace("_", " ")


def _value(name: str, value: float | None) -> str:
    if value is None:
        return ""
    if name.endswith("_m"):
        return f"{value:.1f} m"
    if name == "in_place":
        return "yes" if value else "no"
    return f"{value:.0f}" if name == "views" else f"{value:.3f}"
