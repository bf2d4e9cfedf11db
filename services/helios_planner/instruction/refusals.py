"""Why an instruction is refused before its phrases are read.

A refusal quotes what came and shows a sentence that would have been read.
"""

from __future__ import annotations

from helios_core.errors import InvalidInput

from helios_planner.instruction import lexicon
from helios_planner.instruction.grammar import Clause, without_politeness
from helios_planner.instruction.lexicon import length_at

EXAMPLE = '"Move the mug from the coffee table to the kitchen counter"'


def short(text: str) -> str:
    """The text in quotation marks, on one line, at most 80 characters of it."""
    shown = " ".join("".join(c if c.isprintable() else " " for c in text).split())
    return f"“{shown[:80]}…”" if len(shown) > 80 else f"“{shown}”"


def refuse_negation(words: list[str], text: str) -> None:
    """Raises InvalidInput for what is not to be done."""
    polite = length_at(words, 0, lexicon.POLITE)  # "why don't you bring the mug"
    for at in range(polite, len(words)):
        if n := length_at(words, at, lexicon.NEGATIONS):
            said = " ".join(words[at : at + n])
            raise InvalidInput(
                f"{short(text)} says what is not to be done (“{said}”); say what to do, for "
                f"example {EXAMPLE}"
            )


def refuse_return(words: list[str], text: str) -> None:
    """Raises InvalidInput for "bring the mug to the sofa and back"."""
    if words[-2:] == ["and", "back"]:
        raise InvalidInput(
            f"{short(text)} asks for several things at once (“and back”); submit a task for each"
        )


def refuse_conditions(clauses: list[Clause], text: str) -> None:
    """Raises InvalidInput for a phrase such as "the mug if it is dirty"."""
    for clause in clauses:
        if clause.condition:
            raise InvalidInput(_a_condition(clause.condition, text))


def _a_condition(said: str, text: str) -> str:
    return (
        f"{short(text)} holds a condition (“{said}”), which is not understood; say what to do now, "
        f"for example {EXAMPLE}"
    )


def no_verb(words: list[str], text: str) -> str:
    """What to say of a sentence without a verb that is known."""
    if (bare := without_politeness(words)) and bare[0] in lexicon.HALTS:
        return (
            f"{short(text)} is no task: a robot is stopped at once by `helios stop` (HTTP: "
            "POST /v1/robot/stop), and a task is ended by `helios cancel`"
        )
    if n := length_at(words, 0, lexicon.CONDITIONS):  # "if it rains bring the mug"
        return _a_condition(" ".join(words[:n]), text)
    language = lexicon.language_of(words)
    hint = f": it looks like {language}; write in English," if language else ";"
    return (
        f"no verb was understood in {short(text)}{hint} start with move, bring, take, put, fetch, "
        f"grab, find, go to or explore, for example {EXAMPLE}"
    )
