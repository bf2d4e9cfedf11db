"""Options before the command. Imports only the standard library."""

from __future__ import annotations

from collections.abc import Sequence

EVERYWHERE = ("--port", "--url", "--key", "--robot")  # each takes a value


def leading(args: Sequence[str]) -> tuple[list[str], list[str]]:
    """Leading options of EVERYWHERE with their values, and the remaining arguments."""
    at = 0
    while at < len(args):
        if args[at] in EVERYWHERE and at + 1 < len(args):
            at += 2
        elif args[at].startswith(tuple(f"{name}=" for name in EVERYWHERE)):
            at += 1
        else:
            break
    return list(args[:at]), list(args[at:])
