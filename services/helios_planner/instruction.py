"""From what people type to what the planner does, without a language model.

"Move (object) from the (start receptacle) to the (goal receptacle)" and its relatives: `clauses`
reads the sentence, here its phrases are put together. What cannot be read is refused with what was
understood and what is missing.
"""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum

from helios_core.errors import InvalidInput

from helios_planner import words as w
from helios_planner.clauses import Clause, PlacePhrase, clauses_of, noun
from helios_planner.words import Place, Verb, length_at

LONGEST = 400
EXAMPLE = '"Move the mug from the coffee table to the kitchen counter"'


class Kind(StrEnum):
    MOVE = "move"
    FIND = "find"
    GO_TO = "go_to"


@dataclass(frozen=True)
class Instruction:
    """kind MOVE has object and goal, start if it was said; FIND an object; GO_TO a goal. unused:
    what was said and does not change the task, such as "in the kitchen"."""

    kind: Kind
    object: str | None = None
    start: str | None = None
    goal: str | None = None
    unused: tuple[str, ...] = ()


class NotRead(InvalidInput):
    """No sentence was recognised; somebody with more language might."""


def parse(text: str) -> Instruction:
    """Read an instruction. Raises InvalidInput: what was understood and what is missing."""
    if len(text) > LONGEST:
        raise InvalidInput(
            f"the instruction has {len(text)} characters; send one sentence of at most {LONGEST}, "
            f"for example {EXAMPLE}"
        )
    words = w.tokens(text)
    if not words:
        raise InvalidInput(f"the instruction is empty; send a sentence, for example {EXAMPLE}")
    if strange := w.strange_letter(text):
        raise NotRead(
            f"no verb was understood in {_short(text)}: “{strange[0]}” is a letter of another "
            f"script ({strange[1]}); write in English, for example {EXAMPLE}"
        )
    _refuse_negation(words, text)
    clauses = clauses_of(words)
    if not clauses or w.language_of(words, surely=True):
        raise NotRead(_no_verb(words, text))
    _refuse_conditions(clauses, text)
    if all(c.verb is Verb.GO for c in clauses):
        return _go_to(clauses, text)
    return _Reading(text).of(clauses)


def closest(name: str, known: Sequence[str], count: int = 3) -> list[str]:
    """Known names most like `name`: by letters, then by shared words."""
    words = set(name.split())
    sharing = [k for k in known if words & set(k.replace("_", " ").split())]
    like = difflib.get_close_matches(name, known, n=count, cutoff=0.5)
    return list(dict.fromkeys([*like, *sharing]))[:count]


# --- move and find -----------------------------------------------------------------------------
@dataclass
class _Reading:
    """Clauses as they are put together."""

    text: str
    things: list[str] = field(default_factory=list)
    starts: list[str] = field(default_factory=list)
    goals: list[str] = field(default_factory=list)
    unused: list[str] = field(default_factory=list)
    no_goal: str = ""  # why a place that was named is none to put a thing on

    def of(self, clauses: list[Clause]) -> Instruction:
        for number, clause in enumerate(clauses):
            if clause.verb is Verb.FIND:
                self._find(clause)
            elif clause.verb is Verb.GO:
                self._go(clause, number)
            else:
                self._move(clause)
            self.unused += clause.asides
        moved = any(c.verb in (Verb.PUT, Verb.TAKE) for c in clauses)
        self._check_counts()
        thing = self.things[0] if self.things else None
        if not moved and not self.goals:
            return self._found(thing)
        if thing is None and len(clauses) == 1 and len(self.goals) == 1 and not self.starts and (
            clauses[0].verb_words in ("move", "return")
        ):  # fmt: skip
            return Instruction(Kind.GO_TO, goal=self.goals[0], unused=tuple(self.unused))
        return self._moved(thing)

    def _found(self, thing: str | None) -> Instruction:
        if thing is None:
            raise InvalidInput(self._understood(["the object to find"]))
        start = self.starts[0] if self.starts else None
        self._check_thing(thing, start, None)
        return Instruction(Kind.FIND, thing, start, unused=tuple(self.unused))

    def _moved(self, thing: str | None) -> Instruction:
        missing = [] if thing else ["the object to move"]
        if not self.goals:
            missing.append("the place to bring it to" + (f" ({self.no_goal})" * bool(self.no_goal)))
        if missing or thing is None:
            raise InvalidInput(self._understood(missing))
        start, goal = self.starts[0] if self.starts else None, self.goals[0]
        self._check_thing(thing, start, goal)
        return Instruction(Kind.MOVE, thing, start, goal, tuple(self.unused))

    # --- clauses ---
    def _move(self, clause: Clause) -> None:
        self._add_thing(clause.thing)
        on: list[PlacePhrase] = []
        goals_before = len(self.goals)
        for place in self._usable(clause):
            if place.kind is Place.FROM:
                self._add(self.starts, place)
            elif place.kind is Place.TO:
                self._add_goal(place)
            elif place.kind is Place.ON:
                on.append(place)
        no_goal = len(self.goals) == goals_before and not self.no_goal
        if on and no_goal and (clause.verb is Verb.PUT or self.starts):
            self._add_goal(on.pop())
        for place in on:
            self._add(self.starts, place)

    def _find(self, clause: Clause) -> None:
        places = self._usable(clause)
        sought = [p for p in places if p.kind is Place.FOR]
        if sought:  # "search the desk for the mug"
            self._add_thing(list(sought[0].words))
            if noun(clause.thing):
                phrase = PlacePhrase(Place.ON, "in", tuple(clause.thing))
                self._add(self.starts, phrase)
        else:
            self._add_thing([t for t in clause.thing if t not in ("is", "are")])
        for place in places:
            if place.kind in (Place.ON, Place.FROM):
                self._add(self.starts, place)
            elif place.kind is Place.TO:
                self._add_goal(place)

    def _go(self, clause: Clause, number: int) -> None:
        """ "Go to the desk and take the mug": where to take it from."""
        if number:
            raise InvalidInput(
                f"{_short(self.text)} asks for several things at once; submit a task for each"
            )
        for place in self._usable(clause, beside=True):
            self._add(self.starts, place)

    def _usable(self, clause: Clause, beside: bool = False) -> list[PlacePhrase]:
        """The places of a clause without rooms; a room narrows a place, and is none itself."""
        usable = []
        for at, place in enumerate(clause.places):
            if place.kind is Place.BESIDE and self._says_which(clause, at):
                self.unused.append(str(place))
                continue
            if place.kind is Place.BESIDE and not beside:
                raise InvalidInput(
                    f"“{place}” cannot be done: a thing is taken from and put on or in a piece of "
                    f"furniture, not {place.preposition} something; for example {EXAMPLE}"
                )
            if tuple(place.name.split()) in w.ROOMS:
                self.unused.append(str(place))
                wanted = place.kind is Place.TO or (
                    place.kind is Place.ON and clause.verb is Verb.PUT
                )
                if wanted and not self.goals and len(usable) == 0:
                    self.no_goal = f"“{place.name}” is a room; name a piece of furniture in it"
            elif place.kind is Place.FOR and clause.verb is not Verb.FIND:
                self.unused.append(str(place))
            else:
                usable.append(place)
        if any(p.kind in (Place.TO, Place.ON) for p in usable):
            self.no_goal = ""
        return usable

    @staticmethod
    def _says_which(clause: Clause, at: int) -> bool:
        """Whether a place beside something says where the place before it is, from which a thing
        is taken: "from the table next to the sofa"."""
        before = clause.places[at - 1] if at else None
        if before is None or not before.name:
            return False
        on = before.kind is Place.ON and (
            clause.verb is not Verb.PUT or any(p.kind is Place.TO for p in clause.places[at:])
        )
        return on or before.kind is Place.FROM

    # --- phrases ---
    def _add_thing(self, words: list[str]) -> None:
        words = noun(words)
        while len(words) > 1 and words[0] in w.PEOPLE:
            words = noun(words[1:])
        name = " ".join(words)
        if not name or name in w.PRONOUNS or name in w.PEOPLE:
            return
        name = _one(words, self.text)
        if name not in self.things:
            self.things.append(name)

    def _add(self, to: list[str], place: PlacePhrase) -> None:
        words = place.name.split()
        if words and place.name not in w.PRONOUNS and place.name not in w.PEOPLE:
            name = _one(words, self.text)
            if name not in to:
                to.append(name)

    def _add_goal(self, place: PlacePhrase) -> None:
        if place.name in w.PEOPLE:
            self.no_goal = f"“{place.name}” is no piece of furniture"
        self._add(self.goals, place)

    # --- refusals ---
    def _check_counts(self) -> None:
        for role, named in (
            ("objects", self.things), ("goals", self.goals), ("places to take it from", self.starts)
        ):  # fmt: skip
            if len(named) > 1:
                raise InvalidInput(
                    f"{_short(self.text)} names {len(named)} {role} ({', '.join(named)}): several "
                    f"things at once; name one, and submit a task for each, for example {EXAMPLE}"
                )

    def _check_thing(self, thing: str, start: str | None, goal: str | None) -> None:
        if thing in (start, goal):
            raise InvalidInput(
                f"understood object “{thing}”, and the same name as a place; missing: a piece of "
                f"furniture other than the {thing} itself, for example {EXAMPLE}"
            )

    def _understood(self, missing: list[str]) -> str:
        parts = [f"object “{t}”" for t in self.things]
        parts += [f"from “{s}”" for s in self.starts]
        parts += [f"to “{g}”" for g in self.goals]
        understood = ", ".join(parts) or "only the verb"
        return f"understood {understood}; missing: {' and '.join(missing)}; for example {EXAMPLE}"


# --- go to -------------------------------------------------------------------------------------
def _go_to(clauses: list[Clause], text: str) -> Instruction:
    places, unused = [], [aside for c in clauses for aside in c.asides]
    for clause in clauses:
        named = [p for p in clause.places if p.kind is not Place.FOR]
        if noun(clause.thing) and not named:
            named = [PlacePhrase(Place.TO, "to", tuple(clause.thing))]
        rooms = [p for p in named if tuple(p.name.split()) in w.ROOMS]
        if rooms and len(rooms) < len(named):  # "go to the bed in the bedroom"
            named = [p for p in named if p not in rooms]
            unused += map(str, rooms)
        places += named
    if len(places) > 1:
        raise InvalidInput(f"{_short(text)} names more than one place to go to; name one")
    name = places[0].name if places else ""
    if not name or name in w.PEOPLE or tuple(name.split()) in w.ROOMS:
        said = f" (“{name}” is none)" if name else ""
        raise InvalidInput(
            f"understood “go to” in {_short(text)}; missing: a piece of furniture to go to{said}, "
            'for example "go to the sofa"'
        )
    return Instruction(Kind.GO_TO, goal=_one(name.split(), text), unused=tuple(unused))


# --- refusals ----------------------------------------------------------------------------------
def _one(words: list[str], text: str) -> str:
    """The name of one thing. Raises InvalidInput for several of them."""
    parts: list[list[str]] = [[]]
    at = 0
    while at < len(words):
        between_adjectives = words[at] == w.PAUSE and parts[-1] and parts[-1][-1] in w.ADJECTIVES
        n = 1 if words[at] == w.PAUSE else length_at(words, at, w.LISTS)
        if between_adjectives:
            at += 1
        elif n:
            parts.append([])
            at += n
        else:
            parts[-1].append(words[at])
            at += 1
    names = [" ".join(noun(p)) for p in parts if noun(p)]
    count = words[0] if words[0].isdigit() and words[0] != "1" else ""
    if n := length_at(words, 0, w.MANY):
        count = " ".join(words[:n])
    if len(names) != 1 or count:
        raise InvalidInput(
            f"{_short(text)} names several things at once ({', '.join(names)}); give one object "
            "and one place, and submit a task for each"
        )
    return names[0]


def _refuse_negation(words: list[str], text: str) -> None:
    polite = length_at(words, 0, w.POLITE)  # "why don't you bring the mug"
    for at in range(polite, len(words)):
        if n := length_at(words, at, w.NEGATIONS):
            said = " ".join(words[at : at + n])
            raise InvalidInput(
                f"{_short(text)} says what is not to be done (“{said}”); say what to do, for "
                f"example {EXAMPLE}"
            )


def _refuse_conditions(clauses: list[Clause], text: str) -> None:
    for clause in clauses:
        for phrase in (clause.thing, *(p.words for p in clause.places)):
            for word in phrase:
                if (word,) in w.CONDITIONS and (word,) not in w.MANY:
                    raise InvalidInput(
                        f"{_short(text)} holds a condition (“{word}”), which is not understood; "
                        f"say what to do now, for example {EXAMPLE}"
                    )


def _no_verb(words: list[str], text: str) -> str:
    if words[0] in w.HALTS:
        return (
            f"{_short(text)} is no task: a robot is stopped at once by `helios stop` (HTTP: "
            "POST /v1/robot/stop), and a task is ended by `helios cancel`"
        )
    language = w.language_of(words)
    hint = f": it looks like {language}; write in English," if language else ";"
    return (
        f"no verb was understood in {_short(text)}{hint} start with move, bring, take, put, fetch, "
        f"grab, find or go to, for example {EXAMPLE}"
    )


def _short(text: str) -> str:
    shown = " ".join("".join(c if c.isprintable() else " " for c in text).split())
    return f"“{shown[:80]}…”" if len(shown) > 80 else f"“{shown}”"
