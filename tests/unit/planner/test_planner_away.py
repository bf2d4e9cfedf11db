"""Calls to a service that is away: the task waits, and fails if the service stays away."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import pytest
from helios_core import proto as pb
from helios_core.errors import Unavailable
from helios_core.topics import OBJECTS, Method, Rep, Req
from helios_planner.robot import rpc
from helios_planner.robot.rpc import RobotConnection
from helios_planner.settings import Settings
from helios_planner.task import Cause, TaskFailed


class Clock:
    """A clock that advances only in `rest`."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_s = 100.0
        monkeypatch.setattr(rpc.time, "monotonic", lambda: self.now_s)

    def rest(self, seconds: float) -> None:
        self.now_s += seconds


class AnsweringBus:
    """A bus that answers every call with the result of one function."""

    def __init__(self, answer: Callable[[], Any]) -> None:
        self._answer = answer

    def call(self, method: Method[Req, Rep], request: Req, timeout_s: float) -> Rep:
        return self._answer()


def final_answer(answer: Callable[[], pb.Empty], clock: Clock) -> object:
    """Return the answer that a task gets in the end."""
    line = RobotConnection(AnsweringBus(answer), Settings(), threading.Event(), lambda _: None)
    line.rest = clock.rest
    return line.call(OBJECTS, pb.ObjectsRequest())


def test_a_service_may_be_away_for_ten_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock(monkeypatch)

    def ask() -> pb.Empty:
        if clock.now_s < 110.0:
            raise Unavailable("objectmap does not answer")
        return pb.Empty()

    assert final_answer(ask, clock) == pb.Empty()
    assert clock.now_s >= 110.0


def test_a_service_that_stays_away_is_a_system_error(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock(monkeypatch)

    def ask() -> pb.Empty:
        raise Unavailable("objectmap does not answer")

    with pytest.raises(TaskFailed, match="objectmap does not answer") as failure:
        final_answer(ask, clock)
    assert failure.value.cause is Cause.SYSTEM_ERROR
    assert clock.now_s - 100.0 < Settings().away_s + 1.0
