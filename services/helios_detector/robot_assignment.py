"""How several detectors share several robots, so that every keyframe is answered once. Pure.

All hear every keyframe. Each robot belongs to one of them, by their order, and only that one takes
its keyframes; it says so (`Claim`) before it works and when it has answered. When somebody comes or
goes the robots are dealt anew, and for a moment (`SETTLE_S`) nobody takes a new keyframe, until all
have noticed. What nobody took, or somebody who is gone, is then taken by the robot's new owner.

A keyframe is answered twice only if its detector dies between sending the answer and saying so, or
if one learns of another later than `SETTLE_S`.
"""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from collections.abc import Iterable
from dataclasses import dataclass

from helios_core import proto as pb

SETTLE_S = 1.0
MOST_HELD = 8  # keyframes of one robot; robots pace themselves by answers, so one is usual
MOST_REMEMBERED = 256

Key = tuple[str, int, int]


class Members:
    """Which detectors are there and whose robot is whose. Instances begin with `team`."""

    def __init__(self, me: str, robots: Iterable[str]) -> None:
        self.robots = tuple(sorted(set(robots)))
        self.team = team_of(self.robots)
        self.me = f"{self.team}-{me}"
        self._there: set[str] = set()
        self._strangers: set[str] = set()
        self._settled_s = 0.0

    @property
    def there(self) -> frozenset[str]:
        return frozenset(self._there)

    @property
    def strangers(self) -> bool:
        """Whether a detector is there that deals with another list of robots."""
        return bool(self._strangers)

    def change(self, instance: str, alive: bool, now_s: float) -> None:
        ours = instance.partition("-")[0] == self.team
        group = self._there if ours else self._strangers
        (group.add if alive else group.discard)(instance)
        if ours:
            self._settled_s = now_s + SETTLE_S

    def owner(self, robot: str) -> str | None:
        """None where nobody is there."""
        dealt = sorted(self._there)
        return dealt[self.robots.index(robot) % len(dealt)] if dealt else None

    def takes(self, robot: str, now_s: float) -> bool:
        """Whether this detector takes a new keyframe of the robot now."""
        return self.owner(robot) == self.me and now_s >= self._settled_s


@dataclass
class _Entry:
    """A keyframe, or what was said of one that is still to come."""

    message: pb.Frame | None = None
    taken_by: str = ""
    answered: bool = False


class AssignmentTable:
    """The keyframes of one robot: which came, who took them, which are answered."""

    def __init__(self) -> None:
        self._entries: OrderedDict[Key, _Entry] = OrderedDict()

    def add(self, message: pb.Frame) -> list[pb.Frame]:
        """One that came; a second time, or answered already, it changes nothing. The older ones
        that are given up for it, since so many are held."""
        entry = self._entry(key_of(message.id))
        if not entry.answered:
            entry.message = message
        held = [e for e in self._entries.values() if e.message is not None]
        given_up = []
        for old in held[: max(0, len(held) - MOST_HELD)]:
            if old.message is not None:
                given_up.append(old.message)
            old.message = None
        return given_up

    def note(self, claim: pb.Claim) -> None:
        """What a detector said of one."""
        entry = self._entry(key_of(claim.id))
        entry.taken_by = claim.instance
        if claim.answered:
            entry.answered, entry.message = True, None

    def next(self, there: frozenset[str]) -> pb.Frame | None:
        """The oldest that is still to be answered and that nobody who is there has taken."""
        for entry in self._entries.values():
            if entry.message is not None and entry.taken_by not in there:
                return entry.message
        return None

    def _entry(self, key: Key) -> _Entry:
        entry = self._entries.setdefault(key, _Entry())
        while len(self._entries) > MOST_REMEMBERED:
            self._entries.popitem(last=False)
        return entry


def key_of(id: pb.FrameId) -> Key:
    return id.robot_boot_id, id.world_epoch, id.seq


def team_of(robots: Iterable[str]) -> str:
    """A word for a list of robots: only detectors of one list share it."""
    return hashlib.blake2b("\0".join(robots).encode(), digest_size=4).hexdigest()
