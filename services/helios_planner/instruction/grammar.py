"""Grammar of instructions: cuts words into clauses.

    instruction = [politeness] clause { joiner clause } [politeness]
    clause      = verb thing { preposition place }
    thing       = { determiner } words [ relative ]         "the red mug that is on the desk"

A clause knows its verb and its phrases; `parser` interprets them together. Some sentences are
refused before their phrases are read. A refusal quotes the sentence and shows a valid one.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from helios_core.errors import InvalidInput

from helios_planner.instruction import lexicon as w
from helios_planner.instruction.lexicon import Place, Verb, length_at, trimmed

EXAMPLE = '"Move the mug from the coffee table to the kitchen counter"'
_EMPTY = frozenset(["the", "a", "an", "my", "your", "our"])  # not an object by themselves


@dataclass(frozen=True)
class PlacePhrase:
    """A phrase such as "from the coffee table": the kind of its preposition, the preposition, and
    the words of the place."""

    kind: Place
    preposition: str
    words: tuple[str, ...]

    @property
    def name(self) -> str:
        """The place without determiners; empty without a name."""
        return " ".join(noun(list(self.words)))

    def __str__(self) -> str:
        return " ".join((self.preposition, *self.words))


@dataclass
class Clause:
    """A verb and its phrases. `asides`: words that do not change the task. `condition`: words that
    open a condition ("in case"); nothing after it is read."""

    verb: Verb
    verb_words: str
    thing: list[str] = field(default_factory=list)
    places: list[PlacePhrase] = field(default_factory=list)
    asides: list[str] = field(default_factory=list)
    condition: str | None = None


def clauses_of(words: list[str]) -> list[Clause]:
    """Clauses of a sentence; empty without a known verb."""
    words = _spelled(without_politeness(words))
    words = _active(_verb_first(words))
    remark, words = _remark(words)
    out = [_clause(part) for part in _split(words)] if _verb_at(words, 0)[0] else []
    if out and remark:
        out[0].asides.insert(0, remark)
    return out


def noun(words: list[str]) -> list[str]:
    """A phrase without pauses and particles at its ends and determiners at its start."""
    words = trimmed(words)
    while words and words[-1] in w.PARTICLES:
        words = trimmed(words[:-1])
    while words and (words[0] in w.PARTICLES or words[0] == w.PAUSE) and len(words) > 1:
        words = words[1:]
    while (n := length_at(words, 0, w.DETERMINERS)) and (n < len(words) or words[0] in _EMPTY):
        words = words[n:]
    return words


# --- the order of words ------------------------------------------------------------------------
def without_politeness(words: list[str]) -> list[str]:
    """The words without phrases of politeness around the request."""
    changed = True
    while changed:
        words, changed = _without_additions(words), False
        n = length_at(words, 0, w.POLITE)
        if n and not _is_place(words, 0):
            words, changed = trimmed(_after_pause(words[n:])), True
        for n in range(min(4, len(words) - 1), 0, -1):
            if tuple(words[-n:]) in w.POLITE_END:
                words, changed = trimmed(words[:-n]), True
                break
    return words


def _without_additions(words: list[str]) -> list[str]:
    """The words without additions: "as soon as you can" in "bring the mug as soon as you can
    to the sofa"."""
    out, at = [], 0
    while at < len(words):
        n = length_at(words, at, w.ADDED)
        if n and (_phrase_ends(words, at + n) or (not out and _begins(words, at + n))):
            at += n
        else:
            out.append(words[at])
            at += 1
    return _after_pause(trimmed(out))


def _phrase_ends(words: list[str], at: int) -> bool:
    ends = (w.PLACES, w.JOINERS, w.POLITE_END, w.ADDED)
    return at == len(words) or words[at] == w.PAUSE or any(length_at(words, at, e) for e in ends)


def _begins(words: list[str], at: int) -> bool:
    """True if a request may begin here: "when you can just bring the mug"."""
    return bool(_verb_at(words, at)[0] or length_at(words, at, w.POLITE))


def _after_pause(words: list[str]) -> list[str]:
    return words[1:] if words and words[0] == w.PAUSE else words


def _is_place(words: list[str], at: int) -> bool:
    return bool(length_at(words, at, w.PLACES))


def _verb_first(words: list[str]) -> list[str]:
    """The words with the verb in front: for "From the desk, bring the mug to the sofa" and "The mug
    on the desk: bring it to the sofa"."""
    if not words or _verb_at(words, 0)[0]:
        return words
    for at, word in enumerate(words[:-1]):
        if word != w.PAUSE:
            continue
        after = without_politeness(words[at + 1 :])
        verb, n = _verb_at(after, 0)
        if not verb:
            continue
        before, verb_words, rest = words[:at], after[:n], after[n:]
        before = before[length_at(before, 0, w.STATED) :]
        if _is_place(before, 0):
            return [*verb_words, *rest, *before]
        if rest and rest[0] in w.PRONOUNS:
            return [*verb_words, *before, *rest[1:]]
    return words


def _active(words: list[str]) -> list[str]:
    """The words with a verb in front: for "The mug should be brought to the sofa", "could the mug
    be brought to the sofa", "I'd like the mug brought to the sofa", "the mug belongs on the sofa"
    and "mug from the desk to the sofa"."""
    if n := length_at(words, 0, w.WANTS):
        for at in range(n + 1, len(words)):
            if words[at] in w.PARTICIPLES and _is_place(words, at + 1):
                return [w.PARTICIPLES[words[at]], *words[n:at], *words[at + 1 :]]
    if not words or _verb_at(words, 0)[0]:
        return words
    if words[0] in w.MODALS and "be" in words:
        words = words[1:]
    for at in range(1, len(words)):
        n = length_at(words, at, w.PASSIVES)
        if n and at + n < len(words) and words[at + n] in w.PARTICIPLES:
            return [w.PARTICIPLES[words[at + n]], *words[:at], *words[at + n + 1 :]]
        if (n := length_at(words, at, w.BELONGS)) and _is_place(words, at + n):
            return ["put", *words[:at], *words[at + n :]]
    places = {
        w.PLACES[tuple(words[at : at + n])]
        for at in range(1, len(words))
        if (n := length_at(words, at, w.PLACES))
    }
    verbless = not any(_verb_at(words, at)[0] for at in range(len(words)))
    return ["move", *words] if verbless and {Place.FROM, Place.TO} <= places else words


def _remark(words: list[str]) -> tuple[str, list[str]]:
    """(remark, request): splits "I am thirsty. Bring the cup to the desk" if the request is
    complete without the remark. A condition is no remark: "if I am thirsty, bring the cup
    to the desk"."""
    if not words or _verb_at(words, 0)[0] or length_at(words, 0, w.CONDITIONS):
        return "", words
    for at, word in enumerate(words):
        wish = _spelled(without_politeness(words[at + 1 :])) if word == w.PAUSE else []
        verb, n = _verb_at(wish, 0)
        if verb and n < len(wish) and not _is_place(wish, n) and wish[n] not in w.PRONOUNS:
            return " ".join(words[:at]), wish
    return "", words


def _spelled(words: list[str]) -> list[str]:
    """The words with a typing error in the verb corrected, if only one verb can be meant, and
    without the ending of "moving the mug"."""
    if not words or _verb_at(words, 0)[0]:
        return words
    if words[0].endswith("ing") and length_at(words, 1, w.DETERMINERS):  # no "carrying case"
        stem = words[0][:-3]
        for verb in (stem, stem + "e", stem[:-1]):
            if (verb,) in w.VERBS:
                return [verb, *words[1:]]
    if tuple(apart := words[0].split("-")) in w.VERBS:  # "pick-up"
        return [*apart, *words[1:]]
    meant = {verb for (verb, *more) in w.VERBS if not more and _slip(words[0], verb)}
    return [meant.pop(), *words[1:]] if len(meant) == 1 else words


def _slip(typed: str, meant: str) -> bool:
    """True if two neighbouring letters are swapped, or a letter is missing or doubled. The first
    letter is right, and no letter is replaced: "make" is not "take"."""
    if typed[0] != meant[0] or len(meant) < 4 or meant.startswith(typed + "s"):
        return False
    if len(typed) == len(meant):
        k = next((k for k in range(len(meant) - 1) if typed[k] != meant[k]), 0)
        return typed == meant[:k] + meant[k + 1 : k + 2] + meant[k : k + 1] + meant[k + 2 :]
    if len(typed) + 1 == len(meant):
        return any(typed == meant[:k] + meant[k + 1 :] for k in range(1, len(meant)))
    return any(typed == meant[:k] + meant[k - 1] + meant[k:] for k in range(1, len(meant) + 1))


# --- verbs -------------------------------------------------------------------------------------
def _verb_at(words: list[str], at: int) -> tuple[Verb | None, int]:
    """Verb at a position, and the number of its words. "Go" before another verb only introduces it:
    "go find the mug", "go and get the mug"."""
    n = length_at(words, at, w.VERBS)
    if not n:
        return None, 0
    verb = w.VERBS[tuple(words[at : at + n])]
    if verb is Verb.GO:
        skip = n + length_at(words, at + n, w.JOINERS)
        inner, m = _verb_at(words, at + skip)
        if inner:
            return inner, skip + m
    return verb, n


def _split(words: list[str]) -> list[list[str]]:
    """Cut before each verb that follows a joiner or a pause; "to" before a verb is a joiner too."""
    cuts, at = [0], 1
    while at < len(words):
        n = 1 if words[at] == w.PAUSE else 0
        n += length_at(words, at + n, w.JOINERS)
        if not n and words[at] == "to" and at + 1 < len(words):
            n = 1
        while n and (more := length_at(words, at + n, w.POLITE)):
            n += more
        if n and _verb_at(words, at + n)[0] and not _is_place(words, at + n):
            cuts.append(at + n)
            words = [*words[:at], *[w.PAUSE] * n, *words[at + n :]]
        at += max(n, 1)
    return [trimmed(words[a:b]) for a, b in zip(cuts, [*cuts[1:], len(words)], strict=True)]


# --- one clause --------------------------------------------------------------------------------
def _clause(words: list[str]) -> Clause:
    verb, n = _verb_at(words, 0)
    assert verb is not None
    out = Clause(verb, " ".join(words[:n]))
    at, relative = n, False
    here: list[str] = out.thing  # list that receives the next words
    opened: tuple[Place, str] | None = None  # place phrase that is not complete yet

    def close() -> None:
        nonlocal opened, here
        if opened is not None:
            out.places.append(PlacePhrase(*opened, tuple(here)))
        opened = None

    while at < len(words):
        nothing_yet = not noun(here)
        if n := length_at(words, at, w.CONDITIONS):
            out.condition = " ".join(words[at : at + n])
            break
        if not nothing_yet and (
            (n := length_at(words, at, w.RELATIVES)) and _leads_to_place(words, at + n)
        ):
            relative, at = True, at + n
        elif words[at] == w.PAUSE and _locates(words, at + 1):
            relative, at = True, at + 1 + length_at(words, at + 1, w.LOCATED)
        elif words[at] == w.PAUSE and length_at(words, at + 1, w.REMARKS):
            close()
            end = next((k for k in range(at + 1, len(words)) if words[k] == w.PAUSE), len(words))
            out.asides.append(" ".join(words[at + 1 : end]))
            here, at = [], end
        elif not nothing_yet and (n := length_at(words, at, w.ASIDES)):
            close()
            end = next((k for k in range(at + n, len(words)) if _is_place(words, k)), len(words))
            out.asides.append(" ".join(trimmed(words[at:end])))
            here, at = [], end
        elif n := _place_at(words, at, nothing_yet):
            close()
            kind = w.PLACES.get(tuple(words[at : at + n]), Place.ON)
            if relative and kind is Place.ON:
                kind = Place.FROM
            opened, relative = (kind, " ".join(words[at : at + n])), False
            here, at = [], at + n
        else:
            here.append(words[at])
            at += 1
    close()
    return out


def _place_at(words: list[str], at: int, nothing_yet: bool) -> int:
    """Number of words of the preposition here. "Over" is a preposition in "the towel over the
    chair", but not in "bring over the mug" and "take the mug over to the sink"."""
    if n := length_at(words, at, w.PLACES):
        return n
    over = words[at] == "over" and not nothing_yet and length_at(words, at + 1, w.DETERMINERS)
    return 1 if over else 0


def _locates(words: list[str], at: int) -> bool:
    n = length_at(words, at, w.LOCATED)
    return bool(n) and _leads_to_place(words, at + n)


def _leads_to_place(words: list[str], at: int) -> bool:
    n = 1
    while n:  # "that is currently standing on"
        if _is_place(words, at):
            return True
        n = length_at(words, at, w.RELATIVES)
        at += n
    return False


# --- refusals ---------------------------------------------------------------------------------
def short(text: str) -> str:
    """The text in quotation marks, on one line, at most 80 characters of it."""
    shown = " ".join("".join(c if c.isprintable() else " " for c in text).split())
    return f"“{shown[:80]}…”" if len(shown) > 80 else f"“{shown}”"


def refuse_negation(words: list[str], text: str) -> None:
    """Raises InvalidInput for a sentence that forbids something."""
    polite = length_at(words, 0, w.POLITE)  # "why don't you bring the mug"
    for at in range(polite, len(words)):
        if n := length_at(words, at, w.NEGATIONS):
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
    """Message about a sentence without a known verb."""
    if (bare := without_politeness(words)) and bare[0] in w.HALTS:
        return (
            f"{short(text)} is no task: a robot is stopped at once by `helios stop` (HTTP: "
            "POST /v1/robot/stop), and a task is ended by `helios cancel`"
        )
    if n := length_at(words, 0, w.CONDITIONS):  # "if it rains bring the mug"
        return _a_condition(" ".join(words[:n]), text)
    language = w.language_of(words)
    hint = f": it looks like {language}; write in English," if language else ";"
    return (
        f"no verb was understood in {short(text)}{hint} start with move, bring, take, put, fetch, "
        f"grab, find, go to or explore, for example {EXAMPLE}"
    )
