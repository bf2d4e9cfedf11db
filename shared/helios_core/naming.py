"""Names: whether words name a class, and what a robot can be called."""

from __future__ import annotations

import re

from helios_core.errors import InvalidInput

NO_PART_OF_A_NAME = "/*$#?, \t\n"  # of a robot: they have a meaning in keys, or between names


def names(words: str, class_name: str) -> bool:
    """Whether the words name this class: "the red mugs" does name mug."""
    wanted = re.escape(_plain(class_name))
    return bool(wanted) and re.search(rf"\b{wanted}(?:e?s)?\b", _plain(words)) is not None


def _plain(text: str) -> str:
    return " ".join(re.sub(r"[_-]", " ", text).casefold().split())


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
