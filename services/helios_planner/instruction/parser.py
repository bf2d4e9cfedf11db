"""Parser of instructions: from a sentence to a task, without a language model.

It reads "Move (object) from the (start receptacle) to the (goal receptacle)" and its variants.
`grammar` cuts the sentence into clauses; this module decides which phrase is the object, the start
and the goal, and the kind of task. Raises InvalidInput with the understood and the missing parts.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

from helios_core.errors import InvalidInput
from helios_core.topics import MAX_INSTRUCTION_CHARACTERS

from helios_planner.instruction import lexicon
from helios_planner.instruction.grammar import (
    EXAMPLE,
    Clause,
    PlacePhrase,
    clauses_of,
    no_verb,
    noun,
    refuse_conditions,
    refuse_negation,
    refuse_return,
    short,
)
from helios_planner.instruction.language_model import LanguageModel, NoHelp
from helios_planner.instruction.lexicon import Place, Verb, length_at
from helios_planner.instruction.move_commands import (
    HOW,
    WHAT_MOVES,
    WORD,
    Move,
    Point,
    Written,
    confirm,
    find_point,
    read_move,
    refuse_time_limit,
)


class Kind(StrEnum):
    MOVE = "move"
    FIND = "find"
    GO_TO = "go_to"
    GO_TO_POINT = "go_to_point"
    EXPLORE = "explore"
    GO_HOME = "go_home"

    @property
    def only_moves(self) -> bool:
        """True if nothing is searched: the robot moves, and its map grows."""
        return self in (Kind.GO_TO_POINT, Kind.EXPLORE, Kind.GO_HOME)


@dataclass(frozen=True)
class Instruction:
    """One parsed instruction. MOVE has object and goal, and start if it was named; FIND an object;
    GO_TO a goal; GO_TO_POINT a point; EXPLORE and GO_HOME nothing. unused: phrases that do not
    change the task, such as "in the kitchen". limit_s: time limit, if one was named."""

    kind: Kind
    object: str | None = None
    start: str | None = None
    goal: str | None = None
    unused: tuple[str, ...] = ()
    point: Point | None = None
    limit_s: float | None = None


class NotRead(InvalidInput):
    """Raised if no sentence was recognised; a language model may help."""


def parse(text: str) -> Instruction:
    """Parse an instruction. Raises InvalidInput with the understood and the missing parts."""
    if len(text) > MAX_INSTRUCTION_CHARACTERS:
        raise InvalidInput(
            f"the instruction has {len(text)} characters; send one sentence of at most "
            f"{MAX_INSTRUCTION_CHARACTERS}, for example {EXAMPLE}"
        )
    if unseen := lexicon.control_character(text):
        raise InvalidInput(
            f"the instruction {short(text)} holds the control character {unseen}; send one line of "
            f"plain text, for example {EXAMPLE}"
        )
    words = lexicon.tokens(text)
    if not words:
        raise InvalidInput(f"the instruction is empty; send a sentence, for example {EXAMPLE}")
    if strange := lexicon.strange_letter(text):
        raise NotRead(
            f"no verb was understood in {short(text)}: “{strange[0]}” is a letter of another "
            f"script ({strange[1]}); write in English, for example {EXAMPLE}"
        )
    refuse_negation(words, text)
    refuse_return(words, text)
    if (point := find_point(text)) and (sent := _sent_to(point, text)):
        return sent
    if moved := read_move(text):
        kind = Kind.EXPLORE if moved.move is Move.EXPLORE else Kind.GO_HOME
        return Instruction(kind, limit_s=moved.limit_s)
    clauses = clauses_of(words)
    if not clauses or lexicon.language_of(words, surely=True):
        raise NotRead(no_verb(words, text))
    refuse_conditions(clauses, text)
    refuse_time_limit(text)
    if all(c.verb is Verb.GO for c in clauses):
        return _go_to(clauses, text)
    return _move_or_find(clauses, text)


def parse_with_help(text: str, model: LanguageModel | None) -> Instruction:
    """Parse by the grammar. A sentence that it does not recognise is rephrased by the model and
    parsed again.

    Raises InvalidInput as `parse` does, with the reason why the model did not help.
    """
    try:
        return parse(text)
    except NotRead as refusal:
        if model is None:
            raise
        try:
            sentence = model.plain_sentence(text)
        except NoHelp as why:
            raise InvalidInput(
                f"{refusal.message} (the language model {model.model} did not help: {why})"
            ) from why
        try:
            return parse(sentence)
        except InvalidInput as again:
            raise InvalidInput(
                f"{again.message} (read by the language model {model.model} as “{sentence:.120}”)"
            ) from again


def _sent_to(written: Written, text: str) -> Instruction | None:
    """Instruction to go to a point; None if the numbers mean something else ("2 mugs").

    Raises InvalidInput if something else is named with the point.
    """
    clauses = clauses_of(lexicon.tokens(written.text))
    phrases = [" ".join(noun(c.thing)) for c in clauses if c.verb is Verb.GO]
    phrases += [p.name for c in clauses for p in c.places if p.kind is not Place.FOR]
    if not any(WORD in phrase.split() for phrase in phrases):
        return None
    point = confirm(written, short(text))
    refuse_conditions(clauses, text)
    refuse_time_limit(text)
    goes = clauses[0].verb is Verb.GO or (
        clauses[0].verb_words in ("move", "return") and not noun(clauses[0].thing)
    )
    if len(clauses) > 1 or not goes:
        raise InvalidInput(
            f"{short(text)} names the point {point}, and only the robot itself can be sent to one; "
            f"submit a task for anything else: {HOW}"
        )
    beside = [phrase for phrase in phrases if phrase and phrase != WORD]
    if beside:
        said = ", ".join(f"“{p.replace(WORD, str(point))}”" for p in beside)
        raise InvalidInput(
            f"understood the point {point} in {short(text)}, but not {said}; write {HOW}"
        )
    return Instruction(Kind.GO_TO_POINT, point=point, unused=tuple(clauses[0].asides))


def _move_or_find(clauses: list[Clause], text: str) -> Instruction:
    roles = Roles.of(clauses, text)
    moved = any(c.verb in (Verb.PUT, Verb.TAKE) for c in clauses)
    if not moved and not roles.goals:
        return _found(roles)
    if not roles.things and len(clauses) == 1 and len(roles.goals) == 1 and not roles.starts and (
        clauses[0].verb_words in ("move", "return")
        and not any(word in lexicon.PRONOUNS for word in clauses[0].thing)  # "move it to the sofa"
    ):  # fmt: skip
        return Instruction(Kind.GO_TO, goal=roles.goals[0], unused=tuple(roles.unused))
    return _moved(roles)


def _found(roles: Roles) -> Instruction:
    if not roles.things:
        raise InvalidInput(roles.understood(["the object to find"]))
    thing, start = roles.things[0], roles.starts[0] if roles.starts else None
    _check_thing(thing, start, None)
    return Instruction(Kind.FIND, thing, start, unused=tuple(roles.unused))


def _moved(roles: Roles) -> Instruction:
    missing = [] if roles.things else ["the object to move"]
    if not roles.goals:
        why = f" ({roles.no_goal})" if roles.no_goal else ""
        missing.append(f"the place to bring it to{why}")
    if missing:
        raise InvalidInput(roles.understood(missing))
    thing, goal = roles.things[0], roles.goals[0]
    start = roles.starts[0] if roles.starts else None
    _check_thing(thing, start, goal)
    return Instruction(Kind.MOVE, thing, start, goal, tuple(roles.unused))


def _check_thing(thing: str, start: str | None, goal: str | None) -> None:
    if thing in (start, goal):
        raise InvalidInput(
            f"understood object “{thing}”, and the same name as a place; missing: a piece of "
            f"furniture other than the {thing} itself, for example {EXAMPLE}"
        )


def _go_to(clauses: list[Clause], text: str) -> Instruction:
    places, unused = [], [aside for c in clauses for aside in c.asides]
    for clause in clauses:
        named = [p for p in clause.places if p.kind not in (Place.FOR, Place.FROM)]
        unused += [str(p) for p in clause.places if p.kind is Place.FROM]
        if noun(clause.thing) and not named:
            named = [PlacePhrase(Place.TO, "to", tuple(clause.thing))]
        rooms = [p for p in named if tuple(p.name.split()) in lexicon.ROOMS]
        if rooms and len(rooms) < len(named):  # "go to the bed in the bedroom"
            named = [p for p in named if p not in rooms]
            unused += map(str, rooms)
        places += named
    if len(places) > 1:
        raise InvalidInput(f"{short(text)} names more than one place to go to; name one")
    name = places[0].name if places else ""
    if name[:1].isdigit():
        raise InvalidInput(f"understood “go to” in {short(text)}, but no point; write {HOW}")
    if not name or name in lexicon.PEOPLE or tuple(name.split()) in lexicon.ROOMS:
        said = f" (“{name}” is none)" if name else ""
        raise InvalidInput(
            f"understood “go to” in {short(text)}; missing: a piece of furniture to go to{said}; "
            f"{WHAT_MOVES}"
        )
    return Instruction(Kind.GO_TO, goal=one_name(name.split(), text), unused=tuple(unused))


@dataclass
class Roles:
    """Names in an instruction by role; at most one each after all clauses were read."""

    text: str
    things: list[str] = field(default_factory=list)
    starts: list[str] = field(default_factory=list)
    goals: list[str] = field(default_factory=list)
    unused: list[str] = field(default_factory=list)
    no_goal: str = ""  # why a named place cannot be a goal

    @classmethod
    def of(cls, clauses: list[Clause], text: str) -> Roles:
        """Roles of the clauses. Raises InvalidInput for an impossible request or
        several at once."""
        roles = cls(text)
        for number, clause in enumerate(clauses):
            if clause.verb is Verb.FIND:
                roles._find(clause)
            elif clause.verb is Verb.GO:
                roles._go(clause, number, any(c.verb is Verb.PUT for c in clauses[number + 1 :]))
            else:
                roles._move(clause)
            roles.unused += clause.asides
        roles._check_counts()
        return roles

    def understood(self, missing: list[str]) -> str:
        """Message about a sentence that lacks these parts."""
        parts = [f"object “{t}”" for t in self.things]
        parts += [f"from “{s}”" for s in self.starts]
        parts += [f"to “{g}”" for g in self.goals]
        understood = ", ".join(parts) or "only the verb"
        return f"understood {understood}; missing: {' and '.join(missing)}; for example {EXAMPLE}"

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
                if tuple(phrase.name.split()) in lexicon.ROOMS:
                    self.unused.append(str(phrase))
                else:
                    self._add(self.starts, phrase)
        else:
            self._add_thing([t for t in clause.thing if t not in ("is", "are")])
        for place in places:
            if place.kind in (Place.ON, Place.FROM):
                self._add(self.starts, place)
            elif place.kind is Place.TO:
                self._add_goal(place)

    def _go(self, clause: Clause, number: int, then_put: bool) -> None:
        """Read a GO clause. "Go to the desk and take the mug" names the start, "take the mug, go to
        the desk and put it down" the goal."""
        if number and then_put and self.things:
            for place in self._usable(clause, beside=True):
                self._add_goal(place)
            return
        if number:
            raise InvalidInput(
                f"{short(self.text)} asks for several things at once; submit a task for each"
            )
        for place in self._usable(clause, beside=True):
            self._add(self.starts, place)

    def _usable(self, clause: Clause, beside: bool = False) -> list[PlacePhrase]:
        """The places of a clause without rooms; a room only narrows another place."""
        usable = []
        for at, place in enumerate(clause.places):
            if self._says_which(clause, at):
                self.unused.append(str(place))
                continue
            if place.kind is Place.BESIDE and not beside:
                raise InvalidInput(
                    f"“{place}” cannot be done: a thing is taken from and put on or in a piece of "
                    f"furniture, not {place.preposition} something; for example {EXAMPLE}"
                )
            if tuple(place.name.split()) in lexicon.ROOMS:
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
        """True if the place specifies the place before it: "from the table next to the sofa", "on
        the chair at the desk"."""
        place, before = clause.places[at], clause.places[at - 1] if at else None
        if before is None or not before.name:
            return False
        if place.preposition == "at":
            return before.kind in (Place.ON, Place.TO, Place.FROM)
        if place.kind is not Place.BESIDE:
            return False
        on = before.kind is Place.ON and (
            clause.verb is not Verb.PUT or any(p.kind is Place.TO for p in clause.places[at:])
        )
        return on or before.kind is Place.FROM

    # --- phrases ---
    def _add_thing(self, words: list[str]) -> None:
        words = noun(words)
        while len(words) > 1 and words[0] in lexicon.PEOPLE:
            words = noun(words[1:])
        name = " ".join(words)
        if not name or name in lexicon.PRONOUNS or name in lexicon.PEOPLE:
            return
        name = one_name(words, self.text)
        if name not in self.things:
            self.things.append(name)

    def _add(self, to: list[str], place: PlacePhrase) -> None:
        words = place.name.split()
        if words and place.name not in lexicon.PRONOUNS and place.name not in lexicon.PEOPLE:
            name = one_name(words, self.text)
            if name not in to:
                to.append(name)

    def _add_goal(self, place: PlacePhrase) -> None:
        if place.name in lexicon.PEOPLE:
            self.no_goal = f"“{place.name}” is no piece of furniture"
        self._add(self.goals, place)

    def _check_counts(self) -> None:
        for role, named in (
            ("objects", self.things),
            ("goals", self.goals),
            ("places to take it from", self.starts),
        ):
            if len(named) > 1:
                raise InvalidInput(
                    f"{short(self.text)} names {len(named)} {role} ({', '.join(named)}): several "
                    f"things at once; name one, and submit a task for each, for example {EXAMPLE}"
                )


def one_name(words: list[str], text: str) -> str:
    """Name of one object or place. Raises InvalidInput for several."""
    parts: list[list[str]] = [[]]
    at = 0
    while at < len(words):
        n = 1 if words[at] == lexicon.PAUSE else length_at(words, at, lexicon.LISTS)
        if _between_adjectives(words, at):
            parts[-1] += [] if words[at] == lexicon.PAUSE else [words[at]]
            at += 1
        elif n:
            parts.append([])
            at += n
        else:
            parts[-1].append(words[at])
            at += 1
    names = [" ".join(noun(p)) for p in parts if noun(p)]
    count = words[0] if words[0].isdigit() and words[0] != "1" else ""
    if n := length_at(words, 0, lexicon.MANY):
        count = " ".join(words[:n])
    if len(names) != 1 or count:
        raise InvalidInput(
            f"{short(text)} names several things at once ({', '.join(names)}); give one object "
            "and one place, and submit a task for each"
        )
    return names[0]


def _between_adjectives(words: list[str], at: int) -> bool:
    """True if a pause or "and" joins adjectives of one noun: "the black and white ball"."""
    if at == 0 or words[at - 1] not in lexicon.ADJECTIVES:
        return False
    more = words[at] == "and" and at + 1 < len(words) and words[at + 1] in lexicon.ADJECTIVES
    return words[at] == lexicon.PAUSE or more
