"""Injection of the faults of a schedule into a running stack."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import psutil

from helios_chaos.isolation import limit_rate
from helios_chaos.messages import MessageTap
from helios_chaos.relay import LinkQuality
from helios_chaos.schedule import MESSAGES, Fault, Kind
from helios_chaos.stack import Stack

Undo = Callable[[], None]
ENDS_WITHIN_S = 10.0
LOSS, REORDER = 0.01, 0.02  # shares on a slow link
DRIVES = ("planner", "bridge", "world", "router")  # without one of them the robot must stand


class Injector:
    """Injects faults. `inject` returns what ends the fault."""

    def __init__(self, stack: Stack, tap: MessageTap) -> None:
        self._stack, self._tap = stack, tap
        self._kinds: dict[Kind, Callable[[Fault], Undo]] = {
            "kill": self._kill, "restart_router": self._restart_router, "freeze": self._freeze,
            "cut": self._cut, "hold": self._hold, "slow": self._slow, "rate": self._rate,
            "disk": self._disk, "clock": self._clock,
            "damaged": self._message, "old": self._message, "double": self._message,
        }  # fmt: skip

    def can_hit(self, fault: Fault, within_s: float) -> bool:
        """Wait until the target of a fault is there: its process, or a message to send again."""
        until_s = time.monotonic() + within_s
        while not self._has_target(fault):
            if time.monotonic() > until_s:
                return False
            time.sleep(0.05)
        return True

    def inject(self, fault: Fault) -> Undo:
        return self._kinds[fault.kind](fault)

    def _has_target(self, fault: Fault) -> bool:
        if fault.kind in ("kill", "freeze", "restart_router"):
            return bool(self._stack.pid(fault.target))
        return fault.target not in MESSAGES or self._tap.has_heard(fault.target)

    def _kill(self, fault: Fault) -> Undo:
        _end(self._stack.pid(fault.target), signal.SIGKILL)
        return _nothing

    def _restart_router(self, fault: Fault) -> Undo:
        _end(self._stack.pid("router"), signal.SIGTERM)
        return _nothing

    def _freeze(self, fault: Fault) -> Undo:
        pid = self._stack.pid(fault.target)
        _signal(pid, signal.SIGSTOP)
        return lambda: _signal(pid, signal.SIGCONT)

    def _cut(self, fault: Fault) -> Undo:
        relay = self._stack.links[fault.target]
        relay.cut()
        return relay.restore

    def _hold(self, fault: Fault) -> Undo:
        relay = self._stack.links[fault.target]
        relay.hold()
        return relay.restore

    def _slow(self, fault: Fault) -> Undo:
        relay = self._stack.links[fault.target]
        relay.slow(LinkQuality(fault.size, fault.size / 2, LOSS, REORDER))
        return relay.restore

    def _rate(self, fault: Fault) -> Undo:
        limit_rate(fault.size)
        return lambda: limit_rate(0)

    def _disk(self, fault: Fault) -> Undo:
        filler = fill(self._stack.state_dir)
        return filler.unlink

    def _clock(self, fault: Fault) -> Undo:
        assert self._stack.clock is not None
        self._stack.clock.jump_to(fault.size)
        return _nothing

    def _message(self, fault: Fault) -> Undo:
        send = {"damaged": self._tap.damaged, "old": self._tap.old, "double": self._tap.double}
        send[fault.kind](fault.target)
        return _nothing


def must_stand(fault: Fault) -> bool:
    """True for a fault without whose target the robot must not drive on."""
    return fault.target in DRIVES and fault.kind in (
        "kill",
        "freeze",
        "cut",
        "hold",
        "restart_router",
    )


def fill(folder: Path) -> Path:
    """Fill the disk of a folder; the file that fills it."""
    filler = folder / "filler"
    with filler.open("wb", buffering=0) as file:
        for size in (1 << 20, 4096, 1):
            with suppress(OSError):
                while file.write(bytes(size)) == size:
                    pass
    return filler


def _nothing() -> None:
    pass


def _end(pid: int, number: int) -> None:
    """Signal a process that may have ended, and wait until it has ended."""
    if pid:
        with suppress(psutil.Error):
            process = psutil.Process(pid)
            process.send_signal(number)
            process.wait(ENDS_WITHIN_S)


def _signal(pid: int, number: int) -> None:
    if pid:  # 0: it does not run at this moment
        with suppress(ProcessLookupError):
            os.kill(pid, number)
