"""From what people type to what the planner does, without a language model.

"Move (object) from the (start receptacle) to the (goal receptacle)" and its relatives: `clauses`
reads the sentence, `roles` tells what its phrases name, here it is decided what is asked for. What
cannot be read is refused with what was understood and what is missing.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from helios_core.errors import InvalidInput

from helios_planner.language import words as w
from helios_planner.language.clauses import Clause, PlacePhrase, clauses_of, noun
from helios_planner.language.moves import WHAT_MOVES, Move, read_move
from helios_planner.language.points import HOW, WORD, Point, Written, confirm, find_point
from helios_planner.language.refusals import (
    EXAMPLE,
    no_verb,
    refuse_conditions,
    refuse_negation,
    refuse_return,
    short,
)
from helios_planner.language.roles import Roles, one_name
from helios_planner.language.words import Place, Verb

LONGEST = 400


class Kind(StrEnum):
    MOVE = "move"
    FIND = "find"
    GO_TO = "go_to"
    GO_TO_POINT = "go_to_point"
    EXPLORE = "explore"
    GO_HOME = "go_home"

    @property
    def only_moves(self) -> bool:
        """Whether nothing is looked for: the robot moves, and its map grows."""
        return self in (Kind.GO_TO_POINT, Kind.EXPLORE, Kind.GO_HOME)


@dataclass(frozen=True)
class Instruction:
    """kind MOVE has object and goal, start if it was said; FIND an object; GO_TO a goal;
    GO_TO_POINT a point; EXPLORE and GO_HOME nothing. unused: what was said and does not change the
    task, such as "in the kitchen". limit_s: how long at most, where it was said."""

    kind: Kind
    object: str | None = None
    start: str | None = None
    goal: str | None = None
    unused: tuple[str, ...] = ()
    point: Point | None = None
    limit_s: float | None = None


class NotRead(InvalidInput):
    """No sentence was recognised; somebody with more language might."""


def parse(text: str) -> Instruction:
    """Read an instruction. Raises InvalidInput: what was understood and what is missing."""
    if len(text) > LONGEST:
        raise InvalidInput(
            f"the instruction has {len(text)} characters; send one sentence of at most {LONGEST}, "
            f"for example {EXAMPLE}"
        )
    if unseen := w.control_character(text):
        raise InvalidInput(
            f"the instruction {short(text)} holds the control character {unseen}; send one line of "
            f"plain text, for example {EXAMPLE}"
        )
    words = w.tokens(text)
    if not words:
        raise InvalidInput(f"the instruction is empty; send a sentence, for example {EXAMPLE}")
    if strange := w.strange_letter(text):
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
    if not clauses or w.language_of(words, surely=True):
        raise NotRead(no_verb(words, text))
    refuse_conditions(clauses, text)
    if all(c.verb is Verb.GO for c in clauses):
        return _go_to(clauses, text)
    return _move_or_find(clauses, text)


def _sent_to(written: Written, text: str) -> Instruction | None:
    """The robot is sent to a point; None where its numbers mean something else ("2 mugs").

    Raises InvalidInput where a point is named, and something else with it.
    """
    clauses = clauses_of(w.tokens(written.text))
    phrases = [" ".join(noun(c.thing)) for c in clauses if c.verb is Verb.GO]
    phrases += [p.name for c in clauses for p in c.places if p.kind is not Place.FOR]
    if not any(WORD in phrase.split() for phrase in phrases):
        return None
    point = confirm(written, short(text))
    refuse_conditions(clauses, text)
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
        and not any(word in w.PRONOUNS for word in clauses[0].thing)  # "move it to the sofa"
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
        rooms = [p for p in named if tuple(p.name.split()) in w.ROOMS]
        if rooms and len(rooms) < len(named):  # "go to the bed in the bedroom"
            named = [p for p in named if p not in rooms]
            unused += map(str, rooms)
        places += named
    if len(places) > 1:
        raise InvalidInput(f"{short(text)} names more than one place to go to; name one")
    name = places[0].name if places else ""
    if name[:1].isdigit():
        raise InvalidInput(f"understood “go to” in {short(text)}, but no point; write {HOW}")
    if not name or name in w.PEOPLE or tuple(name.split()) in w.ROOMS:
        said = f" (“{name}” is none)" if name else ""
        raise InvalidInput(
            f"understood “go to” in {short(text)}; missing: a piece of furniture to go to{said}; "
            f"{WHAT_MOVES}"
        )
    return Instruction(Kind.GO_TO, goal=one_name(name.split(), text), unused=tuple(unused))
