"""Actions that need several requests: the task retries within limits, and fails beyond them."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from unittest.mock import create_autospec

import pytest
from helios_core import proto as pb
from helios_core.errors import Conflict, DeadlineExceeded, HeliosError
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.robot import Tilt
from helios_core.topics import ACT, GET_STATE, LEASE
from helios_planner.robot import rpc
from helios_planner.robot.rpc import MOST_IN_VAIN, RECENT, ActionSender, RobotConnection
from helios_planner.settings import Settings
from helios_planner.task import Cause, TaskFailed, TimeIsUp
from helios_planner.tasks.registry import TaskReporter
from helios_planner.tasks.run_control import Journal, PauseControl, TaskCalls
from helios_planner.tasks.store import Entry, Store

Trouble = Callable[[int], HeliosError | None]  # by the action's number, at its first request


class Robot:
    """Answers a repeated request as Spot's driver does: from memory, as failed."""

    def __init__(self, trouble: Trouble) -> None:
        self.hub = hub = MemoryHub()
        self.bus, self._trouble = MemoryBus(hub), trouble
        self.ids: list[str] = []
        self.stops = 0  # not cleared yet
        served = MemoryBus(hub)
        served.serve(LEASE, lambda _: pb.LeaseReply(token=1, duration_s=10))
        served.serve(GET_STATE, self._state)
        served.serve(ACT, self._act)

    def _act(self, request: pb.ActionRequest) -> pb.ActionResult:
        if request.action_id in self.ids:
            return pb.ActionResult(action_id=request.action_id, reason="no answer from the robot")
        self.ids.append(request.action_id)
        error = self._trouble(len(self.ids))
        if error is not None:
            self.stops += isinstance(error, Conflict)
            raise error
        return pb.ActionResult(action_id=request.action_id, succeeded=True)

    def _state(self, _: pb.Empty) -> pb.RobotState:
        stopped, self.stops = self.stops > 0, 0
        state = pb.RobotState(stopped=stopped)
        state.T_world_base.rows.extend([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1])
        return state


@pytest.fixture(autouse=True)
def short_retry_period(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rpc, "RETRY_S", 0.001)


WAITED: list[str | None] = []  # what the task waited for, newest last; None: it is back


def drive(robot: Robot, actions: int) -> None:
    line = RobotConnection(robot.bus, Settings(), threading.Event(), WAITED.append)
    driver = ActionSender(line, Settings(), "task", lambda _: None)
    for _ in range(actions):
        driver.do(Tilt(0.3))


def no_answer(_: int) -> HeliosError:
    return DeadlineExceeded("cannot walk: no answer from the robot")


def test_a_robot_that_never_answers_the_first_request_fails_the_task() -> None:
    robot = Robot(no_answer)
    with pytest.raises(TaskFailed, match="no answer from the robot; see what makes") as failure:
        drive(robot, 1000)
    assert failure.value.cause is Cause.SYSTEM_ERROR
    assert f"{MOST_IN_VAIN + 1} of the last {MOST_IN_VAIN + 1} actions" in failure.value.message
    assert len(robot.ids) == MOST_IN_VAIN + 1


def test_a_task_fails_if_every_other_action_gets_no_answer() -> None:
    robot = Robot(lambda n: no_answer(n) if n % 2 else None)
    with pytest.raises(TaskFailed, match=f"{MOST_IN_VAIN + 1} of the last"):
        drive(robot, 1000)
    assert len(robot.ids) <= RECENT


def test_a_task_tolerates_occasional_requests_without_an_answer() -> None:
    robot = Robot(lambda n: no_answer(n) if n % 4 == 0 else None)
    WAITED.clear()
    drive(robot, 200)
    assert len(robot.ids) == 200
    assert WAITED == ["the bridge: cannot walk: no answer from the robot", None] * 50


def test_stops_do_not_count_as_requests_without_an_answer() -> None:
    robot = Robot(lambda n: Conflict("the robot is stopped (a person)") if n % 2 else None)
    drive(robot, 50)
    assert len(robot.ids) == 100


def test_a_lease_that_ran_out_in_a_pause_is_renewed_without_a_message(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = [0.0]
    monkeypatch.setattr(rpc.time, "monotonic", lambda: clock[0])
    robot = Robot(lambda _: None)
    act, paused = robot._act, [3]

    def lease_ran_out(request: pb.ActionRequest) -> pb.ActionResult:
        if len(robot.ids) == paused[0]:
            paused[0] = 0
            clock[0] += 60.0
            raise Conflict("lease 1 ran out after 10 s; ask for a new one")
        return act(request)

    MemoryBus(robot.hub).serve(ACT, lease_ran_out)
    WAITED.clear()
    drive(robot, 6)
    assert (paused, len(robot.ids), WAITED) == ([0], 6, [])


def test_a_lease_that_is_lost_while_the_robot_is_driven_is_reported() -> None:
    robot = Robot(lambda _: None)
    act, lost = robot._act, [True]

    def taken(request: pb.ActionRequest) -> pb.ActionResult:
        if lost.pop() if lost else False:
            raise Conflict("lease 1 is not the present one (a person has it); ask for a new one")
        return act(request)

    MemoryBus(robot.hub).serve(ACT, taken)
    WAITED.clear()
    drive(robot, 2)
    assert WAITED == [
        "the bridge: lease 1 is not the present one (a person has it); ask for a new one",
        None,
    ]


def test_a_task_waits_as_long_as_another_client_drives_the_robot() -> None:
    robot, asked = Robot(lambda _: None), 0

    def lease(_: pb.LeaseRequest) -> pb.LeaseReply:
        nonlocal asked
        asked += 1
        if asked < 50:
            raise Conflict("teleop drives the robot for 10 s more")
        return pb.LeaseReply(token=1, duration_s=10)

    MemoryBus(robot.hub).serve(LEASE, lease)
    line = RobotConnection(robot.bus, Settings(away_s=0.001), threading.Event(), WAITED.append)
    WAITED.clear()
    assert (
        ActionSender(line, Settings(away_s=0.001), "task", lambda _: None).do(Tilt(0.3)).succeeded
    )
    assert WAITED == ["the bridge: teleop drives the robot for 10 s more", None]


def test_a_task_that_runs_out_of_time_releases_its_lease(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [100.0]
    for name in ("time", "monotonic"):
        monkeypatch.setattr(time, name, lambda: clock[0])
    robot, given_back = Robot(lambda _: None), list[int]()

    def lease(request: pb.LeaseRequest) -> pb.LeaseReply:
        given_back.extend([request.release_token] if request.release_token else [])
        return pb.LeaseReply(token=7, duration_s=10)

    MemoryBus(robot.hub).serve(LEASE, lease)
    cancelled = threading.Event()
    hold = PauseControl(limit_s=5.0, ends_s=105.0, cancelled=cancelled)
    store, reporter = (create_autospec(c, instance=True) for c in (Store, TaskReporter))
    bus = TaskCalls(robot.bus, Journal(store, "task", Entry()), hold, reporter, 1.0)
    driver = ActionSender(
        RobotConnection(bus, Settings(), cancelled, WAITED.append),
        Settings(),
        "task",
        lambda _: None,
    )
    driver.do(Tilt(0.3))
    clock[0] = 106.0
    with pytest.raises(TimeIsUp):
        driver.do(Tilt(0.2))
    driver.release()
    assert given_back == [7]
