"""Reasons of decisions, one sentence each: the action, the sum that decided, the runner-up.

Sentences name numbers as the paper does: score is Ψ, class score is S, uncertainty is U.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

from helios_core.printable_text import counted

from helios_planner.decisions.decision import ANY_SCORE, Act, Candidate, CompleteSearch
from helios_planner.decisions.held_object import HeldObject

Rounding = Callable[[float], float]


def search_receptacle(candidates: Sequence[Candidate], winner: int, alpha_d: float) -> str:
    """Sentence for a receptacle chosen by eq. 10, first case."""
    c, t = candidates[winner], candidates[winner].terms
    return (
        f"search the {c.name}{_away(c)}: worth {t['total']:.3f} = class score "
        f"{t['class_score']:.2f} × gain {t['information_gain']:.2f} − {alpha_d:g}/m × "
        f"{t['distance_m']:.1f} m{_ahead(candidates, winner)}"
    )


def go_to_frontier(candidates: Sequence[Candidate], winner: int, alpha_d: float) -> str:
    """Sentence for a frontier chosen by eq. 10, second case."""
    c, t = candidates[winner], candidates[winner].terms
    return (
        f"explore {c.name}{_away(c)}: worth {t['total']:.3f} = value {t['value']:.2f} × scale "
        f"{t['frontier_scale']:.2f} − {alpha_d:g}/m × {t['distance_m']:.1f} m"
        f"{_ahead(candidates, winner)}"
    )


def nearest_receptacle(candidates: Sequence[Candidate], winner: int) -> str:
    """Sentence for a choice without the objective: receptacles come before frontiers."""
    c = candidates[winner]
    places = sum(k.kind == "receptacle" for k in candidates)
    frontiers = len(candidates) - places
    return (
        f"search the {c.name}{_away(c)}: the nearest of {counted(places, 'receptacle')} left, "
        f"all of which come before {counted(frontiers, 'frontier')}"
    )


def highest_frontier(candidates: Sequence[Candidate], winner: int, layer: str) -> str:
    """Sentence for the frontier of highest value: trusting agent, and VLFM's first choice."""
    c = candidates[winner]
    return (
        f"explore {c.name}{_away(c)}: its {layer} value {c.terms['value']:.2f} is the highest"
        f"{_ahead(candidates, winner, 'value')}"
    )


def kept_frontier(candidates: Sequence[Candidate], winner: int, layer: str, value: float) -> str:
    """Sentence for a frontier that VLFM keeps. value: when it was chosen."""
    c = candidates[winner]
    return (
        f"go on to {c.name}{_away(c)}: its {layer} value was {value:.2f} and is "
        f"{c.terms['value']:.2f}, so it is kept"
    )


def nearest_frontier(candidates: Sequence[Candidate], winner: int) -> str:
    """Sentence of the heuristic agent for the nearest frontier."""
    c = candidates[winner]
    return f"explore {c.name}{_away(c)}: the nearest of {counted(len(candidates), 'frontier')}"


def unvisited_receptacle(candidates: Sequence[Candidate], winner: int) -> str:
    """Sentence of the heuristic agent for a start receptacle that it has not been near."""
    c = candidates[winner]
    return (
        f"look at the {c.name}{_away(c)}: the nearest of "
        f"{counted(len(candidates), 'start receptacle')} not visited yet"
    )


def nearest_way(candidates: Sequence[Candidate], winner: int) -> str:
    """Sentence of an exploration task for the frontier with the shortest path."""
    c = candidates[winner]
    way = f"explore {c.name}: its way is {c.terms['way_m']:.1f} m"
    rest = sorted(k.terms["way_m"] for k in candidates if k is not c)
    if not rest:
        return f"{way}; there is no other"
    return f"{way}, the shortest of {len(candidates)}; the next one is {rest[0]:.1f} m"


def way_ends(goal: str, x_m: float, y_m: float, before_m: float, after_m: float) -> str:
    """Sentence for a path to a point over ground that is not known yet."""
    return (
        f"go on to {goal} by ({x_m:.2f}, {y_m:.2f}) m, where the known ground ends: {before_m:.1f} "
        f"m to there, then {after_m:.1f} m that nobody has seen yet"
    )


def drawn_frontier(candidates: Sequence[Candidate], winner: int) -> str:
    """Sentence for a random frontier."""
    c = candidates[winner]
    return f"explore {c.name}{_away(c)}: drawn from {counted(len(candidates), 'frontier')}"


def own_rule(candidates: Sequence[Candidate], winner: int, name: str) -> str:
    """Sentence for a choice by a plug-in's rule."""
    c = candidates[winner]
    do = f"search the {c.name}" if c.kind == "receptacle" else f"explore {c.name}"
    return (
        f"{do}{_away(c)}: the {name} scores it highest, {c.terms['total']:.3g}"
        f"{_ahead(candidates, winner)}"
    )


def nothing_left(receptacles: bool) -> str:
    """Sentence for a finished search. receptacles: True if receptacles were candidates, too."""
    if receptacles:
        return "nothing is left: no receptacle to search and no frontier to explore is in reach"
    return "nothing is left: no frontier to explore is in reach"


def act(what: Act, c: Candidate, threshold: float, sure: int) -> str:
    """Sentence for a candidate that passes eq. 7."""
    t = c.terms
    of = f", the best of {sure} that pass" if sure > 1 else ""
    n = _digits(lambda r: _value(t, "score", r) >= r(threshold))
    if threshold == ANY_SCORE:
        return (
            f"{what} {_on(what)}the {c.name}{_away(c)} at last: of {counted(sure, 'candidate')} it "
            f"has the highest score, {_scored(t, 'score')}, and the search has come to its end"
        )
    return (
        f"{what} {_on(what)}the {c.name}{_away(c)}: score {_scored(t, 'score', n)} ≥ "
        f"{threshold:.{n}f} after {counted(int(t['views']), 'view')} (class score "
        f"{t['class_score']:.2f}, uncertainty {t['uncertainty']:.2f}{_image_text(t)}){of}"
    )


def look(c: Candidate, threshold: float, tau_inc: float) -> str:
    """Sentence for one more view that is worth it (below eq. 11)."""
    t, worth = c.terms, min(threshold, c.terms["total"] + tau_inc)
    n = _digits(
        lambda r: (
            _value(t, "score", r) < r(threshold) and _value(t, "score_after_view", r) >= r(worth)
        )
    )
    return (
        f"look again at the {c.name}{_away(c)}: score {_scored(t, 'score', n)} < "
        f"{threshold:.{n}f}, and one more view could bring it to "
        f"{_scored(t, 'score_after_view', n)} (worth it from {worth:.{n}f})"
    )


def try_unnamed(name: str, start: str, candidates: Sequence[Candidate]) -> str:
    """Sentence for a pick of something that lies where the object should be."""
    first = candidates[0]
    which = "the only thing" if len(candidates) == 1 else f"the likeliest of {len(candidates)}"
    return (
        f"pick what lies on the {start}{_away(first)}, and look at it: no {name} was found, and it "
        f"is {which} there of the right size (score {first.terms['score']:.2f})"
    )


def in_hand(name: str, held: HeldObject, hand_from: float, kept_why: str) -> str:
    """Sentence for a picked object that was looked at from several sides."""
    if held.sides:
        called = [f"{n} on {share:.0%}" for n, share in held.names if n != name][:1]
        seen = " and ".join([f"{name} on {held.share(name):.0%}", *called])
        sure = f"{counted(held.sides, 'side')} in the hand show {seen}"
    else:
        sure = "the detector gave it no name from any side"
    sure += _image_text({"image_text_nats": held.image_text_nats or 0.0})
    if held.probability >= hand_from:
        return f"keep the {name}: {sure}; probability {held.probability:.2f}"
    wrong = f"{sure}; probability {less(held.probability, hand_from)}"
    return f"keep the {name}, {kept_why}: {wrong}" if kept_why else f"put it back: {wrong}"


def visit_first(candidates: Sequence[Candidate], winner: int) -> str:
    """Sentence for a candidate whose gaze points come before its score."""
    c = candidates[winner]
    of = f", the nearest of {len(candidates)}" if len(candidates) > 1 else ""
    return (
        f"look at the {c.name}{_away(c)}{of} from the gaze points around it: its class score is "
        f"{c.terms['class_score']:.2f}; its score, now {c.terms['score']:.2f}, counts after that"
    )


def search_on(
    what: Act, candidates: Sequence[Candidate], threshold: float, tau_inc: float, anywhere: bool
) -> str:
    """Sentence for a search that goes on: no candidate is accepted or worth a view."""
    if not candidates:
        return f"search on: nothing to {what} {_on(what)}has been seen yet"
    usable = [c for c in candidates if anywhere or c.terms["in_place"]]
    if not usable:
        return (
            f"search on: {counted(len(candidates), 'candidate')} to {what} {_is(len(candidates))} "
            "remembered, none where it was said to be"
        )
    best = max(usable, key=lambda c: c.terms["total"])
    t, need = best.terms, min(threshold, best.terms["total"] + tau_inc)
    seen = "score_after_view" in t
    n = _digits(
        lambda r: (
            _value(t, "score", r) < r(threshold)
            and not (seen and _value(t, "score_after_view", r) >= r(need))
        )
    )
    view = "no view of it is left"
    if seen:
        after = _scored(t, "score_after_view", n)
        view = f"one more view would bring only {after} (worth it from {need:.{n}f})"
    which = f"the {best.name}" if len(usable) == 1 else f"the best {best.name} of {len(usable)}"
    return f"search on: {which} has score {_scored(t, 'score', n)} < {threshold:.{n}f}, and {view}"


def absence(
    name: str,
    candidates: Sequence[Candidate],
    probability: float,
    search: CompleteSearch,
    absent_from: float,
) -> str:
    """Sentence about the probability that the object is not there, after a complete search."""
    times = "once" if search.number == 1 else f"{search.number} times"
    best = max((c.terms["total"] for c in candidates), default=None)
    of = (
        "nothing looked like one"
        if best is None
        else (f"the best of {counted(len(candidates), 'candidate')} has score {best:.2f}")
    )
    named = ""
    if search.start:
        named = f" the likeliest {search.start} has score {search.start_score:.2f},"
    searched = (
        f"the whole floor in reach, {search.floor_m2:.0f} m², was searched {times},{named} and {of}"
    )
    if probability >= absent_from:
        return f"the {name} is probably not here ({probability:.0%}): {searched}"
    return (
        f"search on: {searched}, but the {name} is absent only with probability "
        f"{less(probability, absent_from)}"
    )


def less(value: float, than: float) -> str:
    """Comparison such as "0.42 < 0.50", with as many digits as make it true in print."""
    n = _digits(lambda r: r(value) < r(than))
    return f"{value:.{n}f} < {than:.{n}f}"


def _digits(holds: Callable[[Rounding], bool]) -> int:
    """Decimals, at least two, with which a comparison holds between the printed numbers."""

    def to(decimals: int) -> Rounding:
        return lambda value: float(f"{value:.{decimals}f}")

    return next((n for n in range(2, 16) if holds(to(n))), 2)


def _image_text(terms: Mapping[str, float]) -> str:
    """Text about the part of a score that comes from image-text scores; "" for none."""
    nats = terms.get("image_text_nats", 0.0)
    return f", odds × {math.exp(nats):.2g} by image-text scores" if nats else ""


def _value(terms: Mapping[str, float], name: str, rounded: Rounding) -> float:
    """Number that `_scored` prints last."""
    return rounded(terms[name] * terms.get("place", 1.0) * terms.get("in_hand", 1.0))


def _scored(terms: Mapping[str, float], name: str, digits: int = 2) -> str:
    """Text of a score, "0.42" or "0.84 × place 0.50 = 0.42"."""
    said, total = f"{terms[name]:.{digits}f}", terms[name]
    for factor, of in (("place", "place"), ("in_hand", "hand")):
        if factor in terms:
            said += f" × {of} {terms[factor]:.{digits}f}"
            total *= terms[factor]
    return said if said.count("×") == 0 else f"{said} = {total:.{digits}f}"


def best_view(name: str, score: float, candidates: Sequence[Candidate], winner: int) -> str:
    """Sentence for the gaze point that raises Ψ most (eq. 11). score: Ψ now."""
    after = candidates[winner].terms["score_after_view"]
    rest = sorted((c.terms["total"] for k, c in enumerate(candidates) if k != winner), reverse=True)
    other = f"; the next one to {rest[0]:.2f}" if rest else ""
    return (
        f"of {counted(len(candidates), 'view')} left of the {name}, view {winner + 1} would raise "
        f"its score most, from {score:.2f} to {after:.2f}{other}"
    )


def give_up(what: Act, name: str, reason: str) -> str:
    """Sentence for leaving a chosen candidate."""
    doing = {
        Act.PICK: "picking the",
        Act.PLACE: "placing on the",
        Act.STOP: "stopping at the",
    }
    return f"give up {doing[what]} {name}: {reason}"


def trusted(candidates: Sequence[Candidate], winner: int) -> str:
    """Sentence of the trusting agent for a reported object."""
    c = candidates[winner]
    of = f", the nearest of {len(candidates)}" if len(candidates) > 1 else ""
    return f"go to the {c.name} that the detector reported{_away(c)}{of}"


def none_reported(name: str) -> str:
    """Sentence of the trusting agent without any report."""
    return f"search on: the detector has reported no {name} yet"


# --- parts -------------------------------------------------------------------------------------
def _away(c: Candidate) -> str:
    return f", {c.terms['distance_m']:.1f} m away" if "distance_m" in c.terms else ""


def _ahead(candidates: Sequence[Candidate], winner: int, term: str = "total") -> str:
    """Text about the runner-up, such as "; next the sofa with 0.312, then 4 more"."""
    rest = [c for k, c in enumerate(candidates) if k != winner]
    if not rest:
        return "; there is no other"
    second = max(rest, key=lambda c: c.terms["total"])
    the = "" if second.kind == "frontier" else "the "
    more = f", then {len(rest) - 1} more" if len(rest) > 1 else ""
    return f"; next {the}{second.name} with {second.terms[term]:.3f}{more}"


def _is(n: int) -> str:
    return "is" if n == 1 else "are"


def _on(what: Act) -> str:
    return {Act.PLACE: "on ", Act.STOP: "at "}.get(what, "")
