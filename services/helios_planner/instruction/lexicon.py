"""Tokenizer, and the tables of words that instructions consist of.

The module `grammar` reads sentences. Tables hold phrases separated by commas.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Collection
from enum import Enum, auto

Phrase = tuple[str, ...]
PAUSE = ","  # any punctuation between words
PARTICIPLES: dict[str, str] = {
    "moved": "move", "brought": "bring", "put": "put", "placed": "place", "taken": "take",
    "carried": "carry", "delivered": "deliver", "transported": "transport", "returned": "return",
    "fetched": "fetch", "set": "set", "laid": "lay", "transferred": "transfer", "found": "find",
    "relocated": "relocate", "stored": "store",
}  # fmt: skip
_MARKS = dict.fromkeys(map(ord, ".,;:!?…—–|"), f" {PAUSE} ")
_SPELLED = str.maketrans(
    {
        "’": "'",
        "ʼ": "'",
        "`": "'",
        "_": " ",
        "&": " and ",
        "/": " or ",
        "→": " to ",
        "⇒": " to ",
        "@": " at ",
    }
)
_TURNS = ("LRE", "RLE", "PDF", "LRO", "RLO", "LRI", "RLI", "FSI", "PDI")  # bidirectional controls


class Verb(Enum):
    """Kind of a verb; it decides the meaning of "on the table" in its clause."""

    PUT = auto()  # "put the mug on the table": "on" names the goal
    TAKE = auto()  # "take the mug on the table": "on" names the start
    FIND = auto()
    GO = auto()


class Place(Enum):
    """Meaning of a preposition for the place after it."""

    FROM = auto()
    TO = auto()
    ON = auto()  # start or goal: the verb decides
    BESIDE = auto()  # a relation that the robot cannot bring about
    FOR = auto()  # "search the desk for the mug"; with other verbs for a person


def _phrases(text: str) -> tuple[Phrase, ...]:
    return tuple(tuple(phrase.split()) for phrase in text.split(","))


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


def _table(**rows: str) -> dict[Phrase, str]:
    return {phrase: name for name, text in rows.items() for phrase in _phrases(text)}


VERBS: dict[Phrase, Verb] = {
    phrase: Verb[name]
    for phrase, name in _table(
        PUT="move, bring, put, place, set, lay, carry, transport, relocate, transfer, deliver, "
        "drop, shift, return, leave, store, stow, pass, give, hand, hand over, put down, set down, "
        "lay down, put away, drop off, send, insert, stick, rest, stash, load, throw, throw away, "
        "toss, dispose of, slide, stack, dump, haul, position, hang, drape, spread, "
        "i want, i need, i'd like, i would like, need, want",
        TAKE="take, fetch, grab, get, pick, pick up, collect, retrieve, remove, lift, lift up, "
        "grasp, get hold of, clear",
        FIND="find, find out where, locate, look for, search for, search, seek, spot, look, "
        "hunt for, where is, where are, where's, wheres, where did i leave, "
        "where did i put, show me, show, see, "
        "do you see, is there, are there, have you seen, check for, tell me where, "
        "show me where, see where, watch out for, keep an eye out for, look around for, "
        "look whether, see if, see whether, check if, check whether, check if there is, "
        "check whether there is, see if there is, look if there is, do you know where, "
        "any idea where, i lost, i've lost, i have lost, i can't find, i cannot find, "
        "i am looking for, i'm looking for",
        GO="go, drive, navigate, walk, head, come, travel, run, roll, go over, come over, "
        "approach, visit, get to, get back to",
    ).items()
}  # fmt: skip

PLACES: dict[Phrase, Place] = {
    phrase: Place[name]
    for phrase, name in _table(
        FROM="from on top of, from the top of, from inside of, from inside, from within, from in, "
        "from on, from off, from under, from underneath, from beneath, from, frm, fom, out of, "
        "off of, off",
        TO="over to, on to, in to, back to, up to, down to, across to, over onto, back onto, "
        "back into, towards, toward, to, too, into, onto",
        ON="on top of, on the top of, back on, back in, down on, down in, over on, up on, "
        "over in, upon, atop, on, inside of, inside, within, in, at",
        BESIDE="next to, close to, closer to, nearer to, in front of, to the left of, "
        "to the right of, left of, right of, near, beside, by, behind, under, underneath, "
        "below, beneath, between, above, against, around, opposite, via, avoiding",
        FOR="for",
    ).items()
}  # fmt: skip

# Words that open a phrase which does not change the task; it is reported as unused.
ASIDES = frozenset(_phrases(
    "with, without, that, which, that has, which has, that have, because, since, so that, so, where"
))  # fmt: skip
# Words that open a condition, which is refused: the robot would have to judge it.
CONDITIONS = frozenset(_phrases(
    "if, only if, even if, when, only when, whenever, unless, until, after, before, while, once, "
    "in case, as soon as, as long as, so long as, provided, provided that, providing, assuming, "
    "supposing, given that, on condition, on the condition, in the event, the moment, "
    "the next time"
))  # fmt: skip
HALTS = _words("stop halt cancel abort pause quit")  # not tasks: there are commands for them
NEGATIONS = frozenset(_phrases(
    "not, don't, dont, never, do not, doesn't, nothing, nowhere, no, none, neither, nor, except, "
    "except for, but, instead of, other than, rather than, apart from"
))  # fmt: skip
# Words that bind those before and after them: neither can be left out.
BINDING = _words("of for and or but nor no not any anything anywhere every via without avoiding")

# "the mug that is standing on the desk": the place after these words is the start.
RELATIVES = frozenset(_phrases(
    "that is, that's, thats, that are, that was, that lies, that stands, that sits, which is, "
    "is, are, was, i left, i put, i see, you see, you find, you can see, you will find, "
    "that i left, that i put, that you see, that you find, which you see, which you find, "
    "which are, which was, which lies, which stands, which sits, currently, now, lying, standing, "
    "sitting, located, placed, resting, hanging, kept, stored, left, lie, lies, stands, sits, "
    "should be, must be, might be, may be, could be, probably, usually, often, always, still, maybe"
))  # fmt: skip

# Continuations of a request: where the object is ("…, it is on the table"), or a remark.
LOCATED = frozenset(_phrases(
    "it is, it's, its, they are, i left it, i left them, i put it, i put them, it should be, "
    "you find it, you will find it"
))  # fmt: skip
REMARKS = frozenset(_phrases("i, i'm, it, it's, he, she, we, they, there is"))

JOINERS = frozenset(_phrases("and then, and afterwards, and, then, afterwards, after that"))
LISTS = frozenset(_phrases("and, or, as well as, plus, then"))

POLITE = frozenset(_phrases(
    "hey, hi, hello, ok, okay, alright, yes, robot, helios, please, pls, plz, pleas, plese, "
    "pleese, pelase, kindly, now, then, just, why don't you, why not, are you able to, "
    "would you be able to, is it possible to, i need to, i would like to, i'd like to, "
    "can you, could you, would you, will you, may you, can't you, couldn't you, "
    "won't you, wouldn't you, can u, could u, would u, "
    "will u, i want you to, i would like you to, i'd like you to, i need you to, i want to, "
    "you should, you must, your task is to, your job is to, task, try to, let's, lets, "
    "go ahead and, go and, come and, help me to, help me, would you mind, do you mind, "
    "how about, what about, do me a favour and, do me a favor and, be so kind as to, first, next, "
    "quickly, carefully, good morning, dear"
))  # fmt: skip
# Additions anywhere in a request. They are no conditions, unless something follows that could be
# one ("if you can see it").
ADDED = frozenset(_phrases(
    "as soon as you can, as soon as possible, as soon as you have time, as fast as you can, "
    "as fast as possible, as quickly as you can, as quickly as possible, if you can, if possible, "
    "if you like, if you please, if you have time, when you can, when possible, when you like, "
    "when you have time, whenever you can, whenever you like, whenever you have time, "
    "once you can, once you have time, right now, right away, at once, immediately, asap, "
    "just in case"
))  # fmt: skip
POLITE_END = frozenset(_phrases(
    "please, pls, plz, now, for me, for us, quickly, carefully, gently, slowly, thanks, thx, "
    "thank you, many thanks, robot, helios, ok, okay, would you, will you, can you, could you, "
    "today, there, again"
))  # fmt: skip

DETERMINERS = frozenset(_phrases(
    "one of the, one of my, any of the, a piece of, a pair of, the, teh, a, an, my, your, our, "
    "his, her, their, its, this, that, these, those, some, any, one, 1, another"
))  # fmt: skip
MANY = frozenset(_phrases(
    "all of the, all the, all of my, all my, all, every, both, both of the, many, several, two, "
    "three, four, five, six, seven, eight, nine, ten, a few, few, a couple of, couple of, lot of, "
    "lots of, dozen, a dozen, each, each of the, everything, things"
))  # fmt: skip
PARTICLES = _words(
    "up over back away down again there here out together off along very carefully gently slowly "
    "quickly directly straight anywhere somewhere"
)
PRONOUNS = _words("it them that this one something anything stuff thing those these what")
PEOPLE = _words(
    "me us him her them you myself here there somewhere anywhere everywhere home everyone someone"
)
ROOMS = frozenset(_phrases(
    "kitchen, bedroom, living room, livingroom, bathroom, hall, hallway, corridor, office, study, "
    "garage, garden, dining room, guest room, kids room, kid's room, children's room, basement, "
    "attic, laundry room, room, house, home, apartment, flat, other room, next room, balcony, "
    "pantry, entrance, guest bedroom, master bedroom"
))  # fmt: skip
ADJECTIVES = _words(
    "red blue green yellow white black brown grey gray orange pink purple golden silver beige "
    "dark light bright big large small little tiny huge tall short long round square flat old new "
    "full dirty clean wooden metal plastic glass ceramic soft heavy broken nice favourite favorite "
    "left right first second other"
)
PASSIVES = frozenset(_phrases(
    "should be, needs to be, need to be, must be, has to be, have to be, is to be, shall be, "
    "to be, be"
))  # fmt: skip
MODALS = _words("can could may should would must will")  # "could the mug be brought to the sofa"
WANTS = frozenset(_phrases("i want, i need, i'd like, i would like, want, need"))
# "There is a mug on the table. Bring it to the sofa": openings of the first sentence.
STATED = frozenset(
    _phrases(
        "there is, there are, i think, i believe, i see, i have, i left, i put, i forgot, i saw"
    )
)
BELONGS = frozenset(_phrases(
    "belongs, should go, goes, has to go, needs to go, must go, needs to be, has to be, must be"
))  # fmt: skip

# Words of other languages, enough to name the language in a refusal: first words of an instruction,
# and small words, of which two different ones suffice anywhere.
FOREIGN: dict[str, str] = {
    word: language
    for language, words in {
        "German": "bewege bringe bring stelle stell lege leg hole hol nimm finde suche fahre gehe "
        "geh trage wo",
        "French": "déplace déplacer deplace apporte amène mets met prends prend trouve cherche va",
        "Spanish": "mueve lleva trae pon coge toma busca encuentra ve",
        "Italian": "sposta porta metti prendi trova cerca vai",
        "Portuguese": "mova leve traga coloque pegue encontre procure vá",
        "Dutch": "verplaats breng zet leg pak vind zoek ga",
        "Polish": "przenieś przynieś połóż weź znajdź idź",
        "Turkish": "götür getir koy bul git taşı",
    }.items()
    for word in words.split()
}
SMALL_FOREIGN: dict[str, frozenset[str]] = {
    "German": _words("die der das dem vom zum zur auf ist bitte kannst du und meine mein wo"),
    "French": _words("le les des du vers sur où est dans la une mon ma s'il"),
    "Spanish": _words("el los las del al en dónde donde está la una mi sobre desde hasta"),
    "Italian": _words("il lo gli al alla dal dalla nel sul sulla dov'è è la una tuo"),
    "Portuguese": _words("os na onde está uma para meu minha"),
    "Dutch": _words("het een van naar op waar mijn de"),
}


def language_of(words: list[str], surely: bool = False) -> str | None:
    """Language other than English that a sentence seems to be in. surely: by small words only,
    since a verb may also be English ("bring die Tasse zum Sofa")."""
    small = {language: len(its & set(words)) for language, its in SMALL_FOREIGN.items()}
    begins = [FOREIGN[word] for word in words[:4] if word in FOREIGN and (word,) not in VERBS]
    likely = max(small, key=lambda language: small[language] + begins.count(language))
    if small[likely] > 1:
        return likely
    return begins[0] if begins and not surely else None


def tokens(text: str) -> list[str]:
    """Lower-case words and pauses. Unicode variants are normalised (full width, ligatures),
    invisible characters are dropped, symbols count as spaces."""
    plain = unicodedata.normalize("NFKC", unicodedata.normalize("NFKC", text).lower())
    plain = plain.replace("->", "→").replace("=>", "→").translate(_SPELLED).translate(_MARKS)
    plain = re.sub(r"\bthere'?s\b", "there is", plain)
    kept = []
    for c in plain:
        kind = unicodedata.category(c)
        if kind in ("Cf", "Mn", "Me"):
            continue  # zero width, and combining marks without a composed form
        kept.append(c if c in "'-," or c.isalnum() else " ")
    words = [w if w == PAUSE else w.strip("'-") for w in "".join(kept).split()]
    return trimmed([w for w in words if w])


def control_character(text: str) -> str:
    """Name of the first unreadable character, such as "U+001B"; empty for none. Tabs and line ends
    are allowed; characters that reverse text on a terminal are not."""
    for c in text:
        if unicodedata.category(c) in ("Cc", "Co", "Cs", "Zl", "Zp") and c not in "\t\n\r":
            return f"U+{ord(c):04X}"
        if unicodedata.bidirectional(c) in _TURNS:
            return f"U+{ord(c):04X}"
    return ""


def strange_letter(text: str) -> tuple[str, str] | None:
    """(letter, script) of the first letter that is not Latin, such as a Cyrillic о;
    None without one."""
    for c in unicodedata.normalize("NFKC", text):
        if c.isalpha() and c.isprintable():
            script = unicodedata.name(c, "UNKNOWN").split()[0]
            if script != "LATIN" and c not in "ªº":
                return c, {"CJK": "Chinese"}.get(script, script.capitalize())
    return None


def length_at(words: list[str], at: int, phrases: Collection[Phrase]) -> int:
    """Number of words of the longest phrase that starts at a position; 0 for none."""
    for n in range(min(6, len(words) - at), 0, -1):
        if tuple(words[at : at + n]) in phrases:
            return n
    return 0


def trimmed(words: list[str]) -> list[str]:
    """The words without pauses at the ends, and with one pause where several meet."""
    out: list[str] = []
    for word in words:
        if word != PAUSE or (out and out[-1] != PAUSE):
            out.append(word)
    return out[:-1] if out and out[-1] == PAUSE else out
