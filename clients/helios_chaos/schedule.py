"""Seeded schedule of faults."""

from __future__ import annotations

import itertools
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

Kind = Literal[
    "kill", "freeze", "cut", "hold", "slow", "rate", "disk", "clock", "damaged", "old", "double",
    "restart_router",
]  # fmt: skip
KINDS: tuple[Kind, ...] = get_args(Kind)
WEIGHTS: dict[Kind, int] = {"kill": 4, "freeze": 3, "cut": 2, "slow": 2}  # per round; else 1

SERVICES = ("bridge", "detector", "objectmap", "map2d", "planner", "gateway")
LINKS = (*SERVICES, "world")  # the robot's own link, too
MESSAGES = ("bridge/keyframe", "detector/observation", "planner/context", "bridge/state")

FREEZE_S = (0.5, 15.0)  # range of the duration
CUT_S, HOLD_S, SLOW_S, RATE_S, DISK_S = (0.2, 4.0), (0.5, 4.0), (3.0, 8.0), (3.0, 8.0), (2.0, 6.0)
REST_S = (1.0, 4.0)  # between two faults
JUMPS_S = (-3600.0, -30.0, -2.0, 2.0, 30.0, 3600.0)
RATES_MBIT = (50, 200)  # shared by all links, for images that are not compressed


@dataclass(frozen=True)
class Fault:
    """Fault of the schedule."""

    kind: Kind
    target: str  # service, link or topic; "all" for a fault of the whole machine
    lasts_s: float = 0.0  # 0: it is over at once
    size: float = 0.0  # delay in s, rate in Mbit/s, jump in s; 0 for the others
    rest_s: float = 0.0  # wait before it


def schedule(seed: int, kinds: Sequence[Kind] = KINDS, most_s: float = 15.0) -> Iterator[Fault]:
    """Endless schedule. Each round has every kind in random order, some of them several times;
    each kind takes its targets in random rounds. most_s: longest duration of a fault."""
    random_ = random.Random(seed)
    targets = {kind: _rounds(random_, _targets(kind)) for kind in KINDS}
    jumps = _rounds(random_, JUMPS_S)
    while True:
        round_: list[Kind] = [kind for kind in kinds for _ in range(WEIGHTS.get(kind, 1))]
        random_.shuffle(round_)
        for kind in round_:
            low_s, high_s = _range_s(kind)
            lasts_s = min(random_.uniform(low_s, high_s), most_s)
            yield Fault(
                kind,
                next(targets[kind]),
                round(lasts_s, 2),
                _size(kind, random_, jumps),
                round(random_.uniform(*REST_S), 2),
            )


def _targets(kind: Kind) -> Sequence[str]:
    match kind:
        case "kill":
            return SERVICES
        case "freeze":
            return (*SERVICES, "router")
        case "cut" | "hold" | "slow":
            return LINKS
        case "damaged" | "old" | "double":
            return MESSAGES
        case "restart_router":
            return ("router",)
    return ("all",)


def _range_s(kind: Kind) -> tuple[float, float]:
    ranges: dict[Kind, tuple[float, float]] = {
        "freeze": FREEZE_S,
        "cut": CUT_S,
        "hold": HOLD_S,
        "slow": SLOW_S,
        "rate": RATE_S,
        "disk": DISK_S,
    }
    return ranges.get(kind, (0.0, 0.0))


def _size(kind: Kind, random_: random.Random, jumps: Iterator[float]) -> float:
    match kind:
        case "slow":
            return round(random_.uniform(0.02, 0.15), 3)
        case "rate":
            return random_.choice(RATES_MBIT)
        case "clock":
            return next(jumps)
    return 0.0


def _rounds(random_: random.Random, items: Sequence) -> Iterator:
    for _ in itertools.count():
        yield from random_.sample(items, len(items))
