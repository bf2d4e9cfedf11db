"""Whether words that a person says name a class."""

from __future__ import annotations

import re


def names(words: str, class_name: str) -> bool:
    """Whether the words name this class: "the red mugs" does name mug."""
    wanted = re.escape(_plain(class_name))
    return bool(wanted) and re.search(rf"\b{wanted}(?:e?s)?\b", _plain(words)) is not None


def _plain(text: str) -> str:
    return " ".join(re.sub(r"[_-]", " ", text).casefold().split())
