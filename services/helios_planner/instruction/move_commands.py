"""Sentences that move only the robot: to a point, "explore the home", "come back".

Points are accepted as people write them: "3.2, 4.1", "(3.2 m, -4.1 m) facing 90 degrees". Lengths
are metres in the world frame. A heading without a unit is in degrees, counter-clockwise from the x
axis of the world. `parser` reads the verb of a sentence with a point by the grammar of all
sentences.
"""

from __future__ import annotations

import math
import re
import unicodedata
from dataclasses import dataclass
from enum import Enum, auto

from helios_core.errors import InvalidInput
from helios_core.geometry import wrap_angle

from helios_planner.instruction import lexicon as w
from helios_planner.instruction.grammar import noun, short, without_politeness
from helios_planner.instruction.lexicon import length_at

MOST_M = 10_000.0  # largest coordinate; no home is that large
WORD = "xypoint"  # stands for the point in the text that is parsed next
HOW = "“go to 3.2, 4.1” or “go to 3.2, 4.1 facing 90 degrees” (metres in the world frame)"

_NUMBER = r"[-+]?(?:\d+(?:\.\d+)?|\.\d+|(?:nan|inf(?:inity)?)(?!\w))"
_METRES = r"(?:\s*(?:metres?|meters?|m)\b)?"
_POINT = re.compile(
    r"(?<![\w.+-])"
    r"(?:(?:the\s+)?(?:point|position|coordinates?|pose|location|place|spot)\s+(?:at\s+|of\s+)?)?"
    rf"[(\[]?\s*(?:x\s*[=:]?\s*)?(?P<x>{_NUMBER}){_METRES}"
    rf"(?:\s*[,;]\s*|\s+and\s+|\s+)(?:y\s*[=:]?\s*)?(?P<y>{_NUMBER}){_METRES}(?![\w.])"
    rf"(?P<more>\s*[,;]?\s*(?:z\s*[=:]?\s*)?{_NUMBER}{_METRES}(?![\w.]))?\s*[)\]]?"
)
_FACING = re.compile(
    r"\s*,?\s*(?:and\s+)?(?:(?:then\s+)?(?:facing|face|heading|looking|look|turned|turn|yaw)"
    r"|(?:with|at)\s+(?:an?\s+|the\s+)?(?:yaw|heading|orientation|angle))"
    rf"(?:\s+(?:to|of|at|towards?))?\s*[=:]?\s*(?P<angle>{_NUMBER})"
    r"\s*(?P<unit>degrees?|deg|°|radians?|rad)?(?![\w.])"
)
_SIGNS = str.maketrans({"\u2212": "-", "\u2013": "-", "\u2012": "-", "\u221e": "inf"})


@dataclass(frozen=True)
class Point:
    """Point on the floor of the world, and the heading there; None: any."""

    x_m: float
    y_m: float
    yaw_rad: float | None = None

    def __str__(self) -> str:
        return f"({self.x_m:.2f}, {self.y_m:.2f}) m"


@dataclass(frozen=True)
class Written:
    """A point and the text around it, in which `WORD` stands for the point. more: True if a
    third number follows."""

    point: Point
    text: str
    more: bool = False


def find_point(text: str) -> Written | None:
    """First point of a text. Call `confirm` once it is known that a point is meant."""
    plain = unicodedata.normalize("NFKC", text).translate(_SIGNS).lower()
    found = _POINT.search(plain)
    if found is None:
        return None
    end, yaw_rad = found.end(), None
    if turned := _FACING.match(plain, end):
        end = turned.end()
        angle = _number(turned["angle"])
        in_radians = (turned["unit"] or "").startswith("rad")
        yaw_rad = angle if in_radians else math.radians(angle)
    x_m, y_m = _number(found["x"]), _number(found["y"])
    text = f"{plain[: found.start()]} {WORD} {plain[end:]}"
    return Written(Point(x_m, y_m, yaw_rad), text, bool(found["more"]))


def confirm(written: Written, said: str) -> Point:
    """The point, with its heading wrapped to (-pi, pi]. Raises InvalidInput for an invalid one.

    said: the instruction in quotation marks, for the message.
    """
    point = written.point
    if written.more:
        raise InvalidInput(f"{said} gives three numbers; write two, {HOW}")
    for axis, value in (("x", point.x_m), ("y", point.y_m)):
        if math.isnan(value):
            raise InvalidInput(f"{said} gives {value} as {axis}; wanted a number of metres: {HOW}")
        if not abs(value) <= MOST_M:
            raise InvalidInput(f"{said} names a point beyond {MOST_M:.0f} m; write {HOW}")
    yaw_rad = point.yaw_rad
    if yaw_rad is not None and not math.isfinite(yaw_rad):
        raise InvalidInput(f"{said} names no angle; write {HOW}")
    turned = None if yaw_rad is None else wrap_angle(yaw_rad)
    return Point(point.x_m, point.y_m, turned)


def _number(text: str) -> float:
    return float(text)


# --- explore and come back ---------------------------------------------------------------------
WHAT_MOVES = (
    "what moves the robot: “go to 3.2, 4.1” (metres in the world frame), “go to the sofa”, "
    "“explore the home”, “come back”"
)
LONGEST_S = 86_400.0
_SECONDS = {
    "s": 1.0,
    "sec": 1.0,
    "second": 1.0,
    "min": 60.0,
    "minute": 60.0,
    "h": 3600.0,
    "hour": 3600.0,
}
_COUNTS = {
    "a": 1.0, "an": 1.0, "one": 1.0, "two": 2.0, "three": 3.0, "four": 4.0, "five": 5.0,
    "six": 6.0, "seven": 7.0, "eight": 8.0, "nine": 9.0, "ten": 10.0, "fifteen": 15.0,
    "twenty": 20.0, "thirty": 30.0, "half an": 0.5, "half a": 0.5,
}  # fmt: skip
_FOR = (
    r"\b(?:for|within|at most|up to|no longer than)"
    r"(?:\s+(?:at most|about|around|up to|the next|the))?\s+"
    rf"(?P<count>\d+(?:\.\d+)?|{'|'.join(sorted(_COUNTS, key=len, reverse=True))})\s*"
)
_DURATION = re.compile(rf"{_FOR}(?P<unit>seconds?|secs?|s|minutes?|mins?|hours?|h)\b")
# A singular unit may be part of a name: "look for a second mug".
_TIME_LIMIT = re.compile(
    rf"{_FOR}(?:(?:seconds|secs?|s|minutes|mins?|hours|h)\b"
    r"|(?:second|minute|hour)\b(?=\s*(?:[.,;:!?]|$|(?:and|then|please)\b)))"
)


class Move(Enum):
    """Motions that name no object and no place."""

    EXPLORE = auto()
    HOME = auto()


@dataclass(frozen=True)
class ReadMove:
    """A parsed motion. limit_s: time limit, if one was named."""

    move: Move
    limit_s: float | None = None


def _phrases(text: str) -> frozenset[w.Phrase]:
    return frozenset(tuple(phrase.split()) for phrase in text.split(","))


_EXPLORE = _phrases("explore, exploring, map, scan, survey, discover")
_LEADING = _phrases("go, go and, go out and, start, begin, keep, continue, drive around and")
_EVERYTHING = _phrases(
    "home, house, flat, apartment, place, area, surroundings, environment, floor, building, "
    "everything, everywhere, around, rooms, all rooms, all the rooms, all, unknown, the unknown"
)
_WHOLE = _phrases("whole, entire, complete, full, rest of the, rest of, all of the, all of, all")

_TRAVEL = _phrases("go, come, drive, head, return, get, move, navigate, walk, travel, run, roll")
_STRAIGHT = _phrases("straight, right, directly, all the way")
_START = _phrases(
    "start, starting point, starting position, starting place, starting pose, start point, "
    "start position, start pose, home, home position, home base, base, beginning, "
    "where you started, where you began, where you came from, where you were at the start, "
    "place where you started, point where you started, place you started from, where it started"
)
# Common requests to robots for which there is no task.
_NONE = _phrases(
    "turn, rotate, spin, dock, undock, charge, recharge, follow, wait, stay, sit, back up, "
    "step back, reverse, forward, backward, backwards, drive forward, drive backward, "
    "drive backwards, go forward, go backward, go backwards, move forward, move backward, "
    "move backwards, move back, go left, go right, move left, move right, come here, come to me, "
    "come over, come over here, go away, come"
)
_ARGUMENTS = _phrases(
    "turn, rotate, spin, dock, undock, charge, recharge, follow, wait, stay, "
    "back up, step back, reverse, forward, drive forward, drive backward, "
    "drive backwards, go forward, go backward, go backwards, move forward, "
    "move backward, move backwards, move back"
)


def read_move(text: str) -> ReadMove | None:
    """The motion that the sentence orders; None for another sentence.

    Raises InvalidInput for a motion without a task, and for a part of a home, since rooms are not
    distinguished.
    """
    plain = text.lower()
    found = _DURATION.search(plain)
    rest = plain if found is None else plain[: found.start()] + plain[found.end() :]
    if _explore(_plain(rest), text):
        return ReadMove(Move.EXPLORE, None if found is None else _seconds(found, text))
    words = _plain(text)
    if _is_home(words):
        return ReadMove(Move.HOME)
    if _is_home(_plain(rest)):
        refuse_time_limit(text)
    _refuse_unknown(words, text)
    return None


def refuse_time_limit(text: str) -> None:
    """Raises InvalidInput if a sentence that is not about exploring names a time limit."""
    if found := _TIME_LIMIT.search(text.lower()):
        raise InvalidInput(
            f"{short(text)} names the time limit “{found[0]}”, and only “explore” takes one in "
            "words; leave it out, and set time_limit_s of the task (helios task --time-limit-s "
            "SECONDS)"
        )


def _plain(text: str) -> list[str]:
    return without_politeness(w.tokens(text))


def _explore(words: list[str], text: str) -> bool:
    if (n := length_at(words, 0, _LEADING)) and length_at(words, n, _EXPLORE):
        words = words[n:]
    n = length_at(words, 0, _EXPLORE)
    if not n:
        return False
    surely, rest = words[0].startswith("explor"), noun(words[n:])
    while (k := length_at(rest, 0, _WHOLE)) and k < len(rest):
        rest = noun(rest[k:])
    if not words[n:] and not surely:  # "map" alone
        return False
    if not rest or tuple(rest) in _EVERYTHING:
        return True
    if not surely:
        return False
    said = " ".join(rest)
    if tuple(rest) in w.ROOMS:
        why = f"“{said}” is a room, and rooms are not told apart"
    else:
        why = f"“{said}” is not what can be explored"
    raise InvalidInput(
        f"understood “explore” in {short(text)}; {why}; say “explore the home”, or “explore for "
        "2 minutes”, and submit a task for anything else"
    )


def _is_home(words: list[str]) -> bool:
    n = length_at(words, 0, _TRAVEL)
    verb, rest = words[:n], words[n:]
    rest = rest[length_at(rest, 0, _STRAIGHT) :]
    back = rest[:1] == ["back"]
    rest = rest[1:] if back else rest
    if not rest:  # "move back" is a motion, not a place
        return verb == ["return"] or (back and verb not in ([], ["move"]))
    if rest == ["home"]:
        return True
    if rest[0] not in ("to", "at") or not (verb or back):
        return False
    place = rest[1:]
    while (k := length_at(place, 0, w.DETERMINERS)) and k < len(place):
        place = place[k:]
    return tuple(place) in _START


def _refuse_unknown(words: list[str], text: str) -> None:
    n = length_at(words, 0, _NONE)
    if n and (n == len(words) or length_at(words, 0, _ARGUMENTS)):
        raise InvalidInput(
            f"there is no task for “{' '.join(words[:n])}” ({short(text)}); {WHAT_MOVES}"
        )


def _seconds(duration: re.Match[str], text: str) -> float:
    """Length of a duration. Raises InvalidInput."""
    count = _COUNTS.get(duration["count"])
    number = float(duration["count"]) if count is None else count
    unit = duration["unit"]
    seconds = number * _SECONDS[unit if unit in _SECONDS else unit.removesuffix("s")]
    if not 0 < seconds <= LONGEST_S:
        raise InvalidInput(
            f"{short(text)} names {seconds:g} s; wanted more than 0 s and at most {LONGEST_S:g} s"
        )
    return seconds
