"""Homes on which studies may decide: seeds 0 to 999.

Later homes belong to published results. `helios eval` plays them, and enters them in the ledger.
"""

from __future__ import annotations

import argparse

from helios_core.errors import InvalidInput

from helios_eval.ledger import FIRST_SEED

LAST_SEED = FIRST_SEED - 1
WHY = (
    f"a study plays homes 0 to {LAST_SEED}, since later ones belong to published results; "
    "`helios eval` plays those, and enters them in the ledger"
)


def seeds(text: str) -> tuple[int, ...]:
    """Seeds of a text like "3", "0-9" or "3,5,8-10". For argparse."""
    out: list[int] = []
    for part in text.split(","):
        first, _, last = part.partition("-")
        try:
            some = range(int(first), int(last or first) + 1)
        except ValueError:
            some = range(0)
        if not some:
            raise argparse.ArgumentTypeError(f"{text!r} names no seeds; write 3, 0-9 or 3,5,8-10")
        if some[-1] > LAST_SEED:
            raise argparse.ArgumentTypeError(f"{text!r}: {WHY}")
        out += some
    return tuple(out)


def homes(first: int, count: int) -> range:
    """Seeds of `count` homes from `first` on. Raises InvalidInput for others than development's."""
    if first < 0 or count < 1:
        raise InvalidInput(f"{count} homes from {first} on: wanted at least one, from 0 on")
    if first + count - 1 > LAST_SEED:
        raise InvalidInput(f"homes {first} to {first + count - 1}: {WHY}")
    return range(first, first + count)
