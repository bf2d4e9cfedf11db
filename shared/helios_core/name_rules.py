"""Matching of class names in text, and the rules for robot names."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Sequence
from functools import lru_cache

from helios_core.errors import InvalidInput

NEAR = 0.68  # least similarity ratio (difflib) of a suggested name
ANY_ROBOT = "any"  # a task for it goes to a robot that the fleet chooses
NO_PART_OF_A_NAME = "/*$#?, \t\n"  # characters with a meaning in keys or in lists of robots


@lru_cache(maxsize=4096)
def plain(text: str) -> str:
    """Name in the form used for comparison: lower case, single spaces in place of _ and -."""
    return " ".join(re.sub(r"[_-]", " ", text).casefold().split())


def mentions_class(words: str, class_name: str) -> bool:
    """True if the words contain the class name, in singular or plural: "the red mugs" name mug."""
    wanted = re.escape(plain(class_name))
    return bool(wanted) and re.search(rf"\b{wanted}(?:e?s)?\b", plain(words)) is not None


def is_named(words: str, class_name: str) -> bool:
    """True if the words are the class name itself, in any case, with spaces or underscores, in
    singular or plural: "Coffee_Tables" is coffee table, "red mug" is not mug."""
    wanted, said = plain(class_name), plain(words)
    return bool(wanted) and said in (wanted, f"{wanted}s", f"{wanted}es")


def same_name(said: str, known: Iterable[str]) -> str | None:
    """Known name equal to `said` up to case, spaces, underscores and hyphens; None if none is."""
    names = list(known)
    if said in names:
        return said
    return next((name for name in names if plain(name) == plain(said)), None)


def closest(name: str, known: Sequence[str], count: int = 3) -> list[str]:
    """Known names most similar to `name`: first by letters, then by shared words."""
    words = set(name.split())
    sharing = [k for k in known if words & set(k.replace("_", " ").split())]
    like = difflib.get_close_matches(name, known, n=count, cutoff=NEAR)
    return list(dict.fromkeys([*like, *sharing]))[:count]


def robot_name(name: str) -> str:
    """The name itself. Raises InvalidInput if it is not allowed for a robot."""
    if name == ANY_ROBOT:
        raise InvalidInput(f"no robot can be called {name!r}: that means any robot of a fleet")
    if not name or name.startswith("_") or any(c in NO_PART_OF_A_NAME for c in name):
        raise InvalidInput(
            f"no robot can be called {name[:80]!r}: wanted a word without any of / * $ # ? that "
            "does not begin with _, such as spot-2"
        )
    return name


def robot_names(text: str) -> tuple[str, ...]:
    """Robot names of a comma-separated list, each once. Raises InvalidInput like `robot_name`."""
    names = (part.strip() for part in text.split(","))
    return tuple(dict.fromkeys(robot_name(name) for name in names if name))
