"""Life cycle of faults: raised, confirmed, cleared. Pure: times come as arguments, in seconds.

A *condition* is present or not. It raises its fault at once, confirms it when it lasts or comes
again, and clears it after it has been away for a while. An *event*, such as a failed task, confirms
its fault at once; the fault is cleared by another event, by a person or after a time.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import StrEnum

CONFIRM_S = 2.0  # a condition that lasts this long is confirmed
OFTEN = 3  # as is one that came so often before it was cleared
CLEAR_S = 5.0  # time without the condition that clears a fault
MOST_FAULTS = 200


class FaultState(StrEnum):
    """State of a fault."""

    RAISED = "raised"
    CONFIRMED = "confirmed"
    CLEARED = "cleared"


def plain_id(text: str) -> str:
    """The text as part of addresses and file names: only a-z, 0-9 and single hyphens."""
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")


@dataclass(frozen=True)
class Finding:
    """A condition that is present, or an event that has happened."""

    source: str  # service or process as named on the bus, `robot` or `task`
    kind: str  # such as degraded
    message: str
    severity: str = "error"  # warning or error
    confirm_s: float = CONFIRM_S  # a condition that lasts this long is confirmed
    keep_s: float | None = None  # for an event: it is cleared after this time; None: not by itself

    @property
    def id(self) -> str:
        return plain_id(f"{self.source}-{self.kind}")


@dataclass(frozen=True)
class Fault:
    """A fault; times in seconds since 1970, 0 while unknown."""

    id: str
    source: str
    kind: str
    severity: str
    message: str  # of the newest occurrence
    state: FaultState
    count: int = 1  # occurrences since it is known
    episode: int = 1  # occurrences since it was last cleared
    first_s: float = 0.0
    last_s: float = 0.0  # newest time at which it was present
    raised_s: float = 0.0  # in this episode, like the next two
    confirmed_s: float = 0.0
    cleared_s: float = 0.0
    present: bool = False
    since_s: float = 0.0  # start of the newest occurrence
    keep_s: float | None = None


class FaultRegistry:
    """Known faults. Not thread-safe.

    Every method returns the faults whose state or count it has changed.
    """

    def __init__(self, faults: Iterable[Fault] = ()) -> None:
        self._faults = {fault.id: fault for fault in faults}

    def faults(self) -> tuple[Fault, ...]:
        """All faults: confirmed, then raised, then cleared ones, each newest first."""
        order = [FaultState.CONFIRMED, FaultState.RAISED, FaultState.CLEARED]
        return tuple(
            sorted(self._faults.values(), key=lambda f: (order.index(f.state), -f.last_s, f.id))
        )

    def get(self, id: str) -> Fault | None:
        return self._faults.get(id)

    def observe(self, now_s: float, present: Iterable[Finding]) -> list[Fault]:
        """Take the conditions that are present now; all others are absent."""
        findings = {finding.id: finding for finding in present}
        changed = [self._seen(now_s, finding) for finding in findings.values()]
        absent = [f for f in self._faults.values() if f.id not in findings]
        changed += [self._not_seen(now_s, fault) for fault in absent]
        return [fault for fault in changed if fault is not None]

    def occur(self, now_s: float, event: Finding) -> list[Fault]:
        """Take an event."""
        fault = replace(
            self._occurred(now_s, event),
            state=FaultState.CONFIRMED,
            confirmed_s=now_s,
            present=False,
            keep_s=event.keep_s,
        )
        return [self._put(fault)]

    def clear(self, now_s: float, ids: Iterable[str]) -> list[Fault]:
        """Clear faults; those that are not known or cleared already are ignored."""
        known = (self._faults.get(id) for id in ids)
        return [
            self._put(replace(fault, state=FaultState.CLEARED, cleared_s=now_s, present=False))
            for fault in known
            if fault is not None and fault.state is not FaultState.CLEARED
        ]

    def _seen(self, now_s: float, finding: Finding) -> Fault | None:
        before = self._faults.get(finding.id)
        fault = before
        if fault is None or not fault.present:
            fault = self._occurred(now_s, finding)
        fault = replace(fault, message=finding.message, severity=finding.severity, last_s=now_s)
        lasted = now_s - fault.since_s >= finding.confirm_s
        if fault.state is FaultState.RAISED and (lasted or fault.episode >= OFTEN):
            fault = replace(fault, state=FaultState.CONFIRMED, confirmed_s=now_s)
        self._put(fault)
        return None if before is not None and _same(before, fault) else fault

    def _occurred(self, now_s: float, finding: Finding) -> Fault:
        """The fault of a finding with one more occurrence."""
        before = self._faults.get(finding.id)
        if before is None:
            return Fault(
                finding.id, finding.source, finding.kind, finding.severity, finding.message,
                FaultState.RAISED, first_s=now_s, last_s=now_s, raised_s=now_s, present=True,
                since_s=now_s,
            )  # fmt: skip
        again = replace(
            before,
            message=finding.message,
            severity=finding.severity,
            count=before.count + 1,
            last_s=now_s,
            present=True,
            since_s=now_s,
            keep_s=None,
        )
        if before.state is not FaultState.CLEARED:
            return replace(again, episode=before.episode + 1)
        return replace(
            again,
            state=FaultState.RAISED,
            episode=1,
            raised_s=now_s,
            confirmed_s=0.0,
            cleared_s=0.0,
        )

    def _not_seen(self, now_s: float, fault: Fault) -> Fault | None:
        if fault.state is FaultState.CLEARED:
            return None
        if fault.present:  # it ends now
            self._put(replace(fault, present=False, keep_s=CLEAR_S))
            return None
        if fault.keep_s is None or now_s - fault.last_s < fault.keep_s:
            return None
        return self._put(replace(fault, state=FaultState.CLEARED, cleared_s=now_s))

    def _put(self, fault: Fault) -> Fault:
        self._faults[fault.id] = fault
        if len(self._faults) > MOST_FAULTS:
            least = min(
                self._faults.values(), key=lambda f: (f.state is not FaultState.CLEARED, f.last_s)
            )
            del self._faults[least.id]
        return fault


def _same(a: Fault, b: Fault) -> bool:
    return (a.state, a.count) == (b.state, b.count)
