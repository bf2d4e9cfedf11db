"""Options before the command. Imports the standard library alone."""

from __future__ import annotations

from collections.abc import Sequence

EVERYWHERE = ("--port", "--url", "--key", "--robot")  # each is followed by its value


def leading(args: Sequence[str]) -> tuple[list[str], list[str]]:
    """The options that stand before the command, of those in EVERYWHERE, and the rest."""
    at = 0
    while at < len(args):
        if args[at] in EVERYWHERE and at + 1 < len(args):
            at += 2
        elif args[at].startswith(tuple(f"{name}=" for name in EVERYWHERE)):
            at += 1
        else:
            break
    return list(args[:at]), list(args[at:])
