"""Matching of the search context's class names with the names that a detector knows.

The lookup tries the name itself, then its synonyms (`synonyms.toml` and the search context), then
its narrower kinds ("table" accepts "coffee table"). A detector with a fixed vocabulary may also
substitute a wider or neighbouring kind (it finds "coffee table" as "dining table" if it knows only
that). In every case the detection carries the search context's name.
"""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from importlib import resources

from helios_core.errors import InvalidInput
from helios_core.household_names import FURNITURE
from helios_core.name_rules import plain
from helios_core.types import SearchClass, SearchContext

from helios_detector.coco_classes import COCO_NAMES


@dataclass(frozen=True)
class SearchTarget:
    """One search class with the detector names that match it."""

    name: str  # as in the search context
    names: frozenset[str]  # normalised names of the detector that match it
    threshold: float
    keep_surface: bool  # True if one of its roles is a receptacle
    is_object: bool  # True if one of its roles is the task's object
    is_also: bool = False  # True for one of the context's other names


@cache
def _tables() -> tuple[dict[str, frozenset[str]], dict[str, tuple[str, ...]]]:
    text = resources.files("helios_detector").joinpath("synonyms.toml").read_text()
    table = tomllib.loads(text)
    equal = {name: frozenset(row) for row in table["equal"] for name in row}
    return equal, {kind: tuple(names) for kind, names in table["kinds"].items()}


def synonyms_of(name: str) -> frozenset[str]:
    """The normalised name and its synonyms."""
    name = plain(name)
    return _tables()[0].get(name, frozenset({name}))


@cache
def known_names() -> frozenset[str]:
    """Every name in the synonym tables and in COCO."""
    equal, kinds = _tables()
    narrower = (n for names in kinds.values() for n in names)
    return frozenset((*equal, *kinds, *narrower, *COCO_NAMES))


@lru_cache(maxsize=4096)
def accepted_names(asked: str, synonyms: tuple[str, ...] = ()) -> frozenset[str]:
    """All names that match `asked`: itself, its synonyms, and the narrower kinds of these."""
    same = synonyms_of(asked).union(*(synonyms_of(s) for s in synonyms))
    kinds = _tables()[1]
    narrower = (k for name in same for k in kinds.get(name, ()))
    return same.union(*(synonyms_of(k) for k in narrower))


def neighbours(asked: str) -> frozenset[str]:
    """Wider names and their other kinds, which a fixed vocabulary may substitute."""
    same = synonyms_of(asked)
    out: frozenset[str] = frozenset()
    for kind, names in _tables()[1].items():
        if same & set(names):
            out = out.union(synonyms_of(kind), *(synonyms_of(n) for n in names))
    return out - same


def near_matches(asked: str, vocabulary: Iterable[str], count: int = 3) -> list[str]:
    """The vocabulary's names spelled most like `asked`; at most `count`."""
    name, names = plain(asked), list(vocabulary)
    shared = [n for n in names if set(plain(n).split()) & set(name.split())]
    alike = difflib.get_close_matches(name, names, count, cutoff=0.5)
    return list(dict.fromkeys([*shared, *alike]))[:count]


def _wanted(c: SearchClass, names: frozenset[str], context: SearchContext) -> SearchTarget:
    roles = {o.role for o in context.classes if plain(o.name) == plain(c.name)}
    receptacle = any(r.is_receptacle for r in roles)
    return SearchTarget(c.name, names, c.threshold, receptacle, "object" in roles)


def open_wanted(context: SearchContext) -> tuple[SearchTarget, ...]:
    """Search classes for an open vocabulary, then the context's other names. A class's own name
    matches no other class."""
    classes = context.distinct(plain)
    exact = {plain(c.name) for c in classes}
    wanted = tuple(
        _wanted(c, accepted_names(c.name, c.synonyms) - (exact - {plain(c.name)}), context)
        for c in classes
    )
    return wanted + _also_wanted(context, wanted)


def _also_wanted(
    context: SearchContext, wanted: Sequence[SearchTarget]
) -> tuple[SearchTarget, ...]:
    """The context's other names, without those that match a class or that a class matches."""
    taken = frozenset().union(*(w.names for w in wanted))
    least = min((w.threshold for w in wanted), default=0.0)
    out: list[SearchTarget] = []
    for name in context.also:
        names = synonyms_of(name)
        if not (taken & names or {plain(w.name) for w in wanted} & accepted_names(name)):
            taken |= names
            large = name in FURNITURE
            out.append(SearchTarget(name, names, least, large, not large, is_also=True))
    return tuple(out)


def fixed_wanted(
    context: SearchContext,
    vocabulary: tuple[str, ...],
    similar: Callable[[str], str | None] | None = None,  # most similar name of the vocabulary
) -> tuple[tuple[SearchTarget, ...], Mapping[str, str]]:
    """(findable classes and then other names, class name -> reason of its refusal) for a fixed
    vocabulary.

    Each detector name serves one search class. Exact names are served first, then synonyms and
    narrower kinds, then neighbours, then similar names.
    """
    known = {plain(n): n for n in vocabulary}
    classes = context.distinct(plain)
    taken: dict[str, str] = {}
    got: dict[str, frozenset[str]] = {}
    ways: list[Callable[[SearchClass], frozenset[str]]] = [
        lambda c: frozenset({plain(c.name)}),
        lambda c: accepted_names(c.name, c.synonyms),
        lambda c: neighbours(c.name),
    ]
    if similar is not None:
        ways.append(lambda c: frozenset(filter(None, [similar(c.name)])))
    for way in ways:
        for c in classes:
            if c.name in got:
                continue
            names = (way(c) & known.keys()) - taken.keys()
            if names:
                got[c.name] = names
                taken.update(dict.fromkeys(names, c.name))
    refused: dict[str, str] = {}
    for c in classes:
        if c.name in got:
            continue
        lost = sorted((accepted_names(c.name, c.synonyms) | neighbours(c.name)) & taken.keys())
        if lost:
            refused[c.name] = (
                f"this detector calls both {c.name!r} and {taken[lost[0]]!r} {known[lost[0]]!r} "
                "and cannot tell them apart; ask for one of them, or use a detector that knows both"
            )
        else:
            near = near_matches(c.name, vocabulary)
            hint = f"near matches: {', '.join(near)}" if near else "nothing in it is near"
            refused[c.name] = (
                f"{c.name!r} is not among the {len(vocabulary)} classes this detector knows; "
                f"{hint}; ask for one it knows, or use an open-vocabulary detector"
            )
    wanted = tuple(_wanted(c, got[c.name], context) for c in classes if c.name in got)
    also = (replace(w, names=w.names & known.keys()) for w in _also_wanted(context, wanted))
    return wanted + tuple(w for w in also if w.names), refused


def refuse_unknown(refused: Mapping[str, str]) -> None:
    """Raises InvalidInput when a class cannot be found."""
    if refused:
        raise InvalidInput("; ".join(refused.values()))
