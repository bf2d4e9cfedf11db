"""Names: whether words name a class, and what a robot can be called."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Sequence

from helios_core.errors import InvalidInput

NEAR = 0.68  # share of letters, in order, that names have in common which are taken for each other
NO_PART_OF_A_NAME = "/*$#?, \t\n"  # of a robot: they have a meaning in keys, or between names


def plain(text: str) -> str:
    """A name as it is compared: in small letters, with single spaces, also for _ and -."""
    return " ".join(re.sub(r"[_-]", " ", text).casefold().split())


def names(words: str, class_name: str) -> bool:
    """Whether the words name this class: "the red mugs" does name mug."""
    wanted = re.escape(plain(class_name))
    return bool(wanted) and re.search(rf"\b{wanted}(?:e?s)?\b", plain(words)) is not None


def is_named(words: str, class_name: str) -> bool:
    """Whether the words are this class's name, in any case, with spaces or underscores, one or
    many: "Coffee_Tables" is coffee table, "red mug" is no mug."""
    wanted, said = plain(class_name), plain(words)
    return bool(wanted) and said in (wanted, f"{wanted}s", f"{wanted}es")


def same_name(said: str, known: Iterable[str]) -> str | None:
    """The known name that was said, in any case, with spaces, underscores or hyphens."""
    names = list(known)
    if said in names:
        return said
    return next((name for name in names if plain(name) == plain(said)), None)


def closest(name: str, known: Sequence[str], count: int = 3) -> list[str]:
    """Known names most like `name`: by letters, then by shared words."""
    words = set(name.split())
    sharing = [k for k in known if words & set(k.replace("_", " ").split())]
    like = difflib.get_close_matches(name, known, n=count, cutoff=NEAR)
    return list(dict.fromkeys([*like, *sharing]))[:count]


def robot_name(name: str) -> str:
    """The name itself. Raises InvalidInput where no robot can be called so."""
    if not name or name.startswith("_") or any(c in NO_PART_OF_A_NAME for c in name):
        raise InvalidInput(
            f"no robot can be called {name[:80]!r}: wanted a word without any of / * $ # ? that "
            "does not begin with _, such as spot-2"
        )
    return name


def robot_names(text: str) -> tuple[str, ...]:
    """Names by comma, each once. Raises InvalidInput like `robot_name`."""
    names = (part.strip() for part in text.split(","))
    return tuple(dict.fromkeys(robot_name(name) for name in names if name))
