"""From what people type to what the planner does, without a language model.

"Move (object) from the (start receptacle) to the (goal receptacle)" and its relatives. A sentence
is a verb, then phrases that prepositions open. What cannot be read is refused with what was
understood and what is missing.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from helios_core.errors import InvalidInput

LONGEST = 400
EXAMPLE = '"Move the mug from the coffee table to the kitchen counter"'


class Kind(StrEnum):
    MOVE = "move"
    FIND = "find"
    GO_TO = "go_to"


@dataclass(frozen=True)
class Instruction:
    """kind MOVE has object and goal, start if it was said; FIND an object; GO_TO a goal."""

    kind: Kind
    object: str | None = None
    start: str | None = None
    goal: str | None = None


# Where a preposition without another hint points: verbs of putting name the goal ("put it on the
# table"), verbs of taking the start ("grab the cup on the table").
_PUT = (
    "move bring put place set lay carry transport relocate transfer deliver drop shift return leave"
)
_TAKE = "take fetch grab get pick collect retrieve remove"
_FIND = "find locate"
_TWO_WORDS = {
    "pick up": "pick", "look for": "find", "search for": "find", "search": "find",
    "where is": "find", "where are": "find", "put down": "put", "set down": "set",
    "show me": "find", "hand over": "deliver", "put away": "put", "hand": "deliver",
}  # fmt: skip
_GO = "go drive navigate walk head come travel run"
_KINDS: tuple[tuple[str, str], ...] = (
    ("put", _PUT), ("take", _TAKE), ("find", _FIND), ("go", _GO)
)  # fmt: skip
_VERBS: dict[str, str] = {verb: kind for kind, verbs in _KINDS for verb in verbs.split()}

_START_WORDS = (
    "out of", "off of", "from on", "from off", "from inside", "from in", "from within",
    "from the top of",     "from", "off",
)  # fmt: skip
_GOAL_WORDS = (
    "over to", "on to", "in to", "back to", "up to", "down to", "towards", "toward", "to", "into",
    "onto",
)  # fmt: skip
_WEAK_WORDS = ("on top of", "back on", "back in", "down on", "upon", "on", "inside", "in", "at")
_BELONGS = (
    r"(?:that|which)(?: is|'s| are)?(?: \w+ing)?|(?:lying|standing|sitting|located|placed|resting)"
)
_POLITE = (
    r"^(?:hey|hi|hello|ok|okay|robot|helios|please|kindly|now|then|just|can you|could you|"
    r"would you|will you|i want you to|i would like you to|i'd like you to|i need you to|"
    r"you should|you must|your task is to|try to|let's|go and|go ahead and|help me|"
    r"help me to)\b[\s,:]*"
)
_TAIL = (
    r"[\s,]*\b(?:please|now|for me|for us|immediately|quickly|carefully|thanks|"
    r"thank you|right away)$"
)
_ARTICLES = (
    r"^(?:one of the|any of the|all of the|the|a|an|my|your|our|his|her|their|this|that|these|"
    r"those|some|any)\s+"
)
_PRONOUNS = {"it", "them", "that", "this", "one", "something", "anything", "stuff", "thing"}
_PEOPLE = {"me", "us", "him", "her", "them", "you", "here", "there", "somewhere"}


def parse(text: str) -> Instruction:
    """Read an instruction. Raises InvalidInput: what was understood and what is missing."""
    words = _cleaned(text)
    verb, rest = _verb_of(words)
    if verb is None:
        raise InvalidInput(
            f"no verb was understood in {_short(text)}; start with move, bring, take, put, fetch, "
            f"grab, find or go to, for example {EXAMPLE}"
        )
    rest = _joined_clauses(rest)
    kind = _VERBS[verb]
    if kind == "go":
        return _go_to(rest, text)
    thing, starts, goals = _phrases(rest, weak_is_goal=kind == "put")
    thing, starts, goals = _clean(thing), [_clean(s) for s in starts], [_clean(g) for g in goals]
    if verb in ("move", "return") and not thing and len(goals) == 1 and not starts:
        return _go_to("to " + goals[0], text)
    if kind == "find" and not goals:
        return _find(thing, starts, text)
    return _move(thing, starts, goals, text)


def closest(name: str, known: Sequence[str], count: int = 3) -> list[str]:
    """Known names most like `name`: by letters, then by shared words."""
    words = set(name.split())
    sharing = [k for k in known if words & set(k.replace("_", " ").split())]
    like = difflib.get_close_matches(name, known, n=count, cutoff=0.5)
    return list(dict.fromkeys([*like, *sharing]))[:count]


# --- sentences -------------------------------------------------------------------------------
def _move(thing: str, starts: list[str], goals: list[str], text: str) -> Instruction:
    missing = []
    if not thing or thing in _PRONOUNS:
        missing.append("the object to move")
    goals_named = [g for g in goals if g]
    if not goals_named:
        missing.append("the place to bring it to")
    elif len(goals_named) == 1 and goals_named[0] in _PEOPLE:
        missing.append(f"the place to bring it to (“{goals_named[0]}” is no piece of furniture)")
        goals_named = []
    for role, named in (("goals", goals_named), ("places to take it from", starts)):
        if len(named) > 1:
            raise InvalidInput(
                f"{_short(text)} names {len(named)} {role} ({', '.join(named)}); name one, for "
                f"example {EXAMPLE}"
            )
    for what in (thing, *starts, *goals_named):
        _refuse_lists(what, text)
    if missing:
        raise InvalidInput(_understood(thing, starts, goals_named, missing))
    start = starts[0] if starts and starts[0] else None
    return Instruction(Kind.MOVE, thing, start, goals_named[0])


def _find(thing: str, starts: list[str], text: str) -> Instruction:
    if not thing or thing in _PRONOUNS:
        raise InvalidInput(_understood("", starts, [], ["the object to find"]))
    if len(starts) > 1:
        raise InvalidInput(f"{_short(text)} names {len(starts)} places to look; name one")
    _refuse_lists(thing, text)
    return Instruction(Kind.FIND, thing, starts[0] if starts and starts[0] else None)


def _go_to(rest: str, text: str) -> Instruction:
    goal = _clean(re.sub(rf"^(?:{'|'.join(_GOAL_WORDS)}|near|by|next to)\b", "", rest.strip()))
    if not goal or goal in _PEOPLE:
        raise InvalidInput(
            f"understood “go to” in {_short(text)}; missing: a piece of furniture to go to, for "
            'example "go to the sofa"'
        )
    _refuse_lists(goal, text)
    _, starts, goals = _phrases(goal, weak_is_goal=True)
    if goals or starts:
        raise InvalidInput(f"{_short(text)} names more than one place to go to; name one")
    return Instruction(Kind.GO_TO, goal=goal)


def _refuse_lists(what: str, text: str) -> None:
    parts = re.split(r"\s+(?:and|or|then)\s+|\s*[,;]\s*", what)
    if len(parts) > 1:
        raise InvalidInput(
            f"{_short(text)} names several things at once ({', '.join(p for p in parts if p)}); "
            "give one object and one place, and submit a task for each"
        )


def _understood(thing: str, starts: list[str], goals: list[str], missing: list[str]) -> str:
    parts = []
    if thing and thing not in _PRONOUNS:
        parts.append(f"object “{thing}”")
    parts += [f"from “{s}”" for s in starts if s]
    parts += [f"to “{g}”" for g in goals]
    understood = ", ".join(parts) or "only the verb"
    return f"understood {understood}; missing: {' and '.join(missing)}; for example {EXAMPLE}"


# --- words -----------------------------------------------------------------------------------
def _cleaned(text: str) -> str:
    if len(text) > LONGEST:
        raise InvalidInput(
            f"the instruction has {len(text)} characters; send one sentence of at most {LONGEST}, "
            f"for example {EXAMPLE}"
        )
    words = re.sub(r"[\"“”()<>\[\]{}*]", " ", text.lower().replace("_", " ").replace("’", "'"))
    words = re.sub(r"[.!?;]+(?=\s|$)", " , ", words)
    words = re.sub(r"\s+", " ", words).strip(" ,:-")
    if not words:
        raise InvalidInput(f"the instruction is empty; send a sentence, for example {EXAMPLE}")
    while (shorter := re.sub(_POLITE, "", words)) != words:
        words = shorter
    while (shorter := re.sub(_TAIL, "", words)) != words:
        words = shorter.strip(" ,")
    return words


def _verb_of(words: str) -> tuple[str | None, str]:
    for phrase, verb in _TWO_WORDS.items():
        if re.match(rf"{phrase}\b", words):
            return verb, words[len(phrase) :].strip()
    first, _, rest = words.partition(" ")
    return (first, rest.strip()) if first in _VERBS else (None, words)


def _joined_clauses(rest: str) -> str:
    """ "… and put it on the sofa" says the goal of what went before."""
    verbs = "|".join(v for v, k in _VERBS.items() if k in ("put", "take"))
    goal = "|".join((*_GOAL_WORDS, *_WEAK_WORDS))
    rest = re.sub(
        rf"[\s,]+(?:and then|and|then|,)?\s*(?:{verbs})\s+(?:it|them|that|this)\s+"
        rf"(?:down |back |over |away )?(?:{goal})\b",
        " to ", rest,
    )  # fmt: skip
    # "find the mug and take it from the table": what is taken is not moved yet.
    return re.sub(
        r"[\s,]+(?:and then|and|then)\s+(?:pick|grab|take)\s+(?:it|them)(?: up)?\b", " ", rest
    )


def _phrases(rest: str, weak_is_goal: bool) -> tuple[str, list[str], list[str]]:
    """(object, start phrases, goal phrases)."""
    groups = (
        rf"(?P<rel>(?:{_BELONGS})\s+(?:{'|'.join(_WEAK_WORDS)}))",
        rf"(?P<start>{'|'.join(_START_WORDS)})",
        rf"(?P<goal>{'|'.join(_GOAL_WORDS)})",
        rf"(?P<weak>{'|'.join(_WEAK_WORDS)})",
    )
    marks = list(re.finditer(rf"(?:^|(?<=\s))(?:{'|'.join(groups)})(?=\s|$)", rest))
    ends = [m.start() for m in marks[1:]] + [len(rest)] * bool(marks)
    thing = rest[: marks[0].start()] if marks else rest
    found = [(m.lastgroup or "", rest[m.end() : end]) for m, end in zip(marks, ends, strict=True)]
    starts = [p for g, p in found if g in ("start", "rel")]
    goals = [p for g, p in found if g == "goal"]
    weak = [p for g, p in found if g == "weak"]
    if weak and not goals and (weak_is_goal or starts):
        goals.append(weak.pop())
    starts += weak
    return thing, starts, goals


def _clean(phrase: str) -> str:
    phrase = phrase.strip(" ,.:-")
    phrase = re.sub(r"^(?:me|us|up|over|back|away|down)\s+(?=\w)", "", phrase)
    while (shorter := re.sub(_ARTICLES, "", phrase)) != phrase:
        phrase = shorter
    phrase = re.sub(r"\s+(?:up|over|back|away|down|again|there|and|then)$", "", phrase)
    return phrase.strip(" ,.:-") if phrase not in ("the", "a", "an", "me", "up") else ""


def _short(text: str) -> str:
    shown = " ".join(text.split())
    return f"“{shown[:80]}…”" if len(shown) > 80 else f"“{shown}”"
