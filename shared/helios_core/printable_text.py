"""Text for display: removal of control characters and of jargon, numbers with their nouns."""

from __future__ import annotations

_CONTROL = dict.fromkeys((*range(32), *range(127, 160)), "�")
_SPACES = dict.fromkeys(map(ord, "\t\n\r"), " ")
_SHOWN = _CONTROL | _SPACES


def counted(number: int, noun: str, plural: str = "") -> str:
    """Number with its noun: "1 step", "2 steps". plural: given if it is not noun + s."""
    return f"{number} {noun if number == 1 else plural or noun + 's'}"


def plain_error(text: str) -> str:
    """Message of pydantic, or of the command-line parser, without the words `Value error, `."""
    return text.replace("Value error, ", "")


def printable(text: str) -> str:
    """Text on one line, without control characters (C0, DEL, C1).

    Tabs, line feeds and carriage returns become spaces; the others become U+FFFD.
    """
    return text.translate(_SHOWN)
