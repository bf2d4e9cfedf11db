"""A service that is away: it is waited for, and named when it stays away."""

from __future__ import annotations

import pytest
from helios_core import proto as pb
from helios_core.errors import Unavailable
from helios_planner.robot import rpc
from helios_planner.robot.rpc import patiently
from helios_planner.settings import Settings
from helios_planner.task import Cause, TaskFailed


class Clock:
    """Time that passes only by resting."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_s = 100.0
        monkeypatch.setattr(rpc.time, "monotonic", lambda: self.now_s)

    def rest(self, seconds: float) -> None:
        self.now_s += seconds


def test_a_service_may_be_away_for_ten_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock(monkeypatch)

    def ask() -> pb.Empty:
        if clock.now_s < 110.0:
            raise Unavailable("objectmap does not answer")
        return pb.Empty()

    assert patiently(ask, Settings().away_s, clock.rest) == pb.Empty()
    assert clock.now_s >= 110.0


def test_a_service_that_stays_away_is_a_system_error(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock(monkeypatch)

    def ask() -> pb.Empty:
        raise Unavailable("objectmap does not answer")

    with pytest.raises(TaskFailed, match="objectmap does not answer") as failure:
        patiently(ask, Settings().away_s, clock.rest)
    assert failure.value.cause is Cause.SYSTEM_ERROR
    assert clock.now_s - 100.0 < Settings().away_s + 1.0
