"""Assignment of robots to detectors, so that every keyframe is answered once. Pure.

Every detector receives all keyframes. The sorted order of the detectors assigns each robot to one
of them; only this owner takes the robot's keyframes. It publishes a `Claim` before it works and
after it answers. When a detector joins or leaves, the assignment changes, and no detector takes a
new keyframe for `SETTLE_S`, until all know the change. The robot's new owner then takes the
keyframes that nobody took or whose detector is gone.

A keyframe is answered twice only if its detector dies between the answer and its claim, or if a
detector learns of another one later than `SETTLE_S`.
"""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from collections.abc import Iterable
from dataclasses import dataclass

from helios_core import proto as pb
from helios_core import tracing
from helios_core.image_messages import FrameMessage

SETTLE_S = 1.0
MOST_HELD = 8  # keyframes of one robot; robots wait for answers, so one is usual
MOST_REMEMBERED = 256

Key = tuple[str, int, int]


class Members:
    """The live detectors and the owner of each robot. Instance names begin with `team`."""

    def __init__(self, me: str, robots: Iterable[str]) -> None:
        self.robots = tuple(sorted(set(robots)))
        self.team = team_of(self.robots)
        self.me = f"{self.team}-{me}"
        self._there: set[str] = set()
        self._strangers: set[str] = set()
        self._settled_s = 0.0

    @property
    def live(self) -> frozenset[str]:
        return frozenset(self._there)

    @property
    def has_other_lists(self) -> bool:
        """True if a live detector has a different list of robots."""
        return bool(self._strangers)

    def change(self, instance: str, alive: bool, now_s: float) -> None:
        ours = instance.partition("-")[0] == self.team
        group = self._there if ours else self._strangers
        (group.add if alive else group.discard)(instance)
        if ours:
            self._settled_s = now_s + SETTLE_S

    def owner(self, robot: str) -> str | None:
        """Instance name of the robot's owner; None without live detectors."""
        dealt = sorted(self._there)
        return dealt[self.robots.index(robot) % len(dealt)] if dealt else None

    def takes(self, robot: str, now_s: float) -> bool:
        """True if this detector may take a new keyframe of the robot now."""
        return self.owner(robot) == self.me and now_s >= self._settled_s


@dataclass
class _Entry:
    """State of one keyframe; `message` is None before it arrives and after it is answered."""

    message: FrameMessage | None = None
    traceparent: str = ""  # span that sent the message
    taken_by: str = ""
    answered: bool = False


class AssignmentTable:
    """The keyframes of one robot with their claims and answers."""

    def __init__(self) -> None:
        self._entries: OrderedDict[Key, _Entry] = OrderedDict()

    def add(self, message: FrameMessage) -> list[FrameMessage]:
        """Add a received keyframe; return the older ones dropped because more than `MOST_HELD` are
        held. No effect for a keyframe that is already answered."""
        entry = self._entry(key_of(message.id))
        if not entry.answered:
            entry.message, entry.traceparent = message, tracing.current_traceparent()
        held = [e for e in self._entries.values() if e.message is not None]
        given_up = []
        for old in held[: max(0, len(held) - MOST_HELD)]:
            if old.message is not None:
                given_up.append(old.message)
            old.message = None
        return given_up

    def note(self, claim: pb.Claim) -> None:
        """Record a detector's claim on a keyframe."""
        entry = self._entry(key_of(claim.id))
        entry.taken_by = claim.instance
        if claim.answered:
            entry.answered, entry.message = True, None

    def traceparent(self, id: pb.FrameId) -> str:
        """Traceparent of the span that sent a keyframe; empty without one."""
        return self._entry(key_of(id)).traceparent

    def next(self, there: frozenset[str]) -> FrameMessage | None:
        """The oldest unanswered keyframe that no detector of `there` has claimed."""
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
    """Hash of a list of robots; detectors with the same list share it."""
    return hashlib.blake2b("\0".join(robots).encode(), digest_size=4).hexdigest()
