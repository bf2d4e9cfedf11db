"""Which part each phrase of a sentence plays: the thing, where it is, where it goes.

"Put the mug on the table" names a goal, "take the mug on the table" a start: the verb decides where
the preposition says little.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from helios_core.errors import InvalidInput

from helios_planner.language import words as w
from helios_planner.language.clauses import Clause, PlacePhrase, noun
from helios_planner.language.refusals import EXAMPLE, short
from helios_planner.language.words import Place, Verb, length_at


@dataclass
class Roles:
    """Names by the part that they play; of each at most one once all clauses are taken in."""

    text: str
    things: list[str] = field(default_factory=list)
    starts: list[str] = field(default_factory=list)
    goals: list[str] = field(default_factory=list)
    unused: list[str] = field(default_factory=list)
    no_goal: str = ""  # why a place that was named is none to put a thing on

    @classmethod
    def of(cls, clauses: list[Clause], text: str) -> Roles:
        """Raises InvalidInput for what cannot be done and for several things at once."""
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
        """What to say of a sentence in which this is missing."""
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
                if tuple(phrase.name.split()) in w.ROOMS:
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
        """ "Go to the desk and take the mug": where to take it from. "Take the mug, go to the
        desk and put it down": where to put it."""
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
        """The places of a clause without rooms; a room narrows a place, and is none itself."""
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
        is taken: "from the table next to the sofa"; "on the chair at the desk" says which chair."""
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
        while len(words) > 1 and words[0] in w.PEOPLE:
            words = noun(words[1:])
        name = " ".join(words)
        if not name or name in w.PRONOUNS or name in w.PEOPLE:
            return
        name = one_name(words, self.text)
        if name not in self.things:
            self.things.append(name)

    def _add(self, to: list[str], place: PlacePhrase) -> None:
        words = place.name.split()
        if words and place.name not in w.PRONOUNS and place.name not in w.PEOPLE:
            name = one_name(words, self.text)
            if name not in to:
                to.append(name)

    def _add_goal(self, place: PlacePhrase) -> None:
        if place.name in w.PEOPLE:
            self.no_goal = f"“{place.name}” is no piece of furniture"
        self._add(self.goals, place)

    def _check_counts(self) -> None:
        for role, named in (
            ("objects", self.things), ("goals", self.goals), ("places to take it from", self.starts)
        ):  # fmt: skip
            if len(named) > 1:
                raise InvalidInput(
                    f"{short(self.text)} names {len(named)} {role} ({', '.join(named)}): several "
                    f"things at once; name one, and submit a task for each, for example {EXAMPLE}"
                )


def one_name(words: list[str], text: str) -> str:
    """The name of one thing. Raises InvalidInput for several of them."""
    parts: list[list[str]] = [[]]
    at = 0
    while at < len(words):
        n = 1 if words[at] == w.PAUSE else length_at(words, at, w.LISTS)
        if _between_adjectives(words, at):
            parts[-1] += [] if words[at] == w.PAUSE else [words[at]]
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
            f"{short(text)} names several things at once ({', '.join(names)}); give one object "
            "and one place, and submit a task for each"
        )
    return names[0]


def _between_adjectives(words: list[str], at: int) -> bool:
    """Whether a pause or "and" joins what is said of one thing: "the black and white ball"."""
    if at == 0 or words[at - 1] not in w.ADJECTIVES:
        return False
    more = words[at] == "and" and at + 1 < len(words) and words[at + 1] in w.ADJECTIVES
    return words[at] == w.PAUSE or more
