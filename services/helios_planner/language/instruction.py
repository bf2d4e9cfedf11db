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
    clauses = clauses_of(words)
    if not clauses or w.language_of(words, surely=True):
        raise NotRead(no_verb(words, text))
    refuse_conditions(clauses, text)
    if all(c.verb is Verb.GO for c in clauses):
        return _go_to(clauses, text)
    return _move_or_find(clauses, text)


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
    if not name or name in w.PEOPLE or tuple(name.split()) in w.ROOMS:
        said = f" (“{name}” is none)" if name else ""
        raise InvalidInput(
            f"understood “go to” in {short(text)}; missing: a piece of furniture to go to{said}, "
            'for example "go to the sofa"'
        )
    return Instruction(Kind.GO_TO, goal=one_name(name.split(), text), unused=tuple(unused))
