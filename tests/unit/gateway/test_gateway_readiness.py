"""Which states of its services keep a robot from getting tasks."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping

import pytest
from fastapi.testclient import TestClient
from helios_core import proto as pb
from helios_core.errors import DeadlineExceeded, HeliosError, Unavailable
from helios_core.robot import Action, ActionResult
from helios_core.topics import STOP
from helios_gateway.service_registry import REQUIRED_SERVICES, ServiceRegistry

from tests.gateway_backend import Backend
from tests.support import wait_until
from tests.unit.bridge.bridge_stage import LineRobot, Stage
from tests.unit.gateway.gateway_clock import Clock

FAULT = "keyframe 7 was not answered by objects within 5 s; look at these services"


@pytest.fixture
def roster(clock: Clock) -> ServiceRegistry:
    """A registry that knows all required services, which have just started."""
    roster = ServiceRegistry(silent_after_s=5, clock=clock)
    for name in REQUIRED_SERVICES:
        roster.on_alive(name, "1", True)
    return roster


def report(
    roster: ServiceRegistry,
    name: str,
    state: str,
    reason: str = "",
    instance: str = "1",
    metrics: Mapping[str, float] | None = None,
) -> None:
    roster.on_status(
        pb.ServiceStatus(
            service=name, instance=instance, state=state, reason=reason, metrics=metrics
        )
    )


def all_ready(roster: ServiceRegistry) -> None:
    for name in REQUIRED_SERVICES:
        report(roster, name, "ready")
    assert roster.not_ready_reasons() == []


@pytest.mark.parametrize("name", ["bridge", "detector"])
def test_a_bridge_or_detector_with_a_fault_after_its_start_does_not_keep_tasks_off(
    roster: ServiceRegistry, name: str
) -> None:
    all_ready(roster)
    report(roster, name, "degraded", FAULT)
    assert roster.not_ready_reasons() == []
    assert roster.troubles() == [(name, "degraded", FAULT)]  # it is still a fault


@pytest.mark.parametrize("name", ["planner", "map2d", "objectmap"])
def test_a_degraded_planner_or_map_keeps_tasks_off(roster: ServiceRegistry, name: str) -> None:
    all_ready(roster)
    report(roster, name, "degraded", "the disk is full")
    assert roster.not_ready_reasons() == [f"{name} is degraded: the disk is full"]


@pytest.mark.parametrize("name", ["bridge", "detector"])
def test_a_bridge_or_detector_that_cannot_start_keeps_tasks_off(
    roster: ServiceRegistry, name: str
) -> None:
    all_ready(roster)
    roster.on_alive(name, "1", False)
    roster.on_alive(name, "2", True)  # it was restarted, with a wrong setting
    report(roster, name, "waiting", "loading", instance="2")
    report(roster, name, "degraded", "the model is damaged", instance="2")
    assert roster.not_ready_reasons() == [f"{name} is degraded: the model is damaged"]


@pytest.mark.parametrize(
    ("name", "metric"),
    [("bridge", "keyframes"), ("detector", "contexts_sought"), ("detector", "contexts_unknown")],
)
def test_a_gateway_that_starts_later_sees_by_a_metric_that_a_degraded_service_works(
    roster: ServiceRegistry, name: str, metric: str
) -> None:
    for other in set(REQUIRED_SERVICES) - {name}:
        report(roster, other, "ready")
    report(roster, name, "degraded", FAULT)
    assert roster.not_ready_reasons() == [f"{name} is degraded: {FAULT}"]
    report(roster, name, "degraded", FAULT, metrics={metric: 3.0})
    assert roster.not_ready_reasons() == []


@pytest.mark.parametrize("name", ["bridge", "detector"])
def test_a_silent_service_keeps_tasks_off_whatever_it_said_last(
    roster: ServiceRegistry, clock: Clock, name: str
) -> None:
    all_ready(roster)
    report(roster, name, "degraded", FAULT)
    clock.now += 6
    for other in set(REQUIRED_SERVICES) - {name}:
        report(roster, other, "ready")
    assert roster.not_ready_reasons() == [f"{name} is degraded: it has not reported for 6 s"]


@pytest.mark.parametrize("state", ["starting", "waiting", "stopping", "dancing"])
def test_a_service_in_another_state_keeps_tasks_off(roster: ServiceRegistry, state: str) -> None:
    all_ready(roster)
    report(roster, "detector", state)
    (reason,) = roster.not_ready_reasons()
    assert reason.startswith("detector is ")


def test_a_degraded_detector_leaves_the_robot_ready_over_http(
    backend: Backend, client: TestClient
) -> None:
    backend.report("detector", 4102, "degraded", "the last keyframe could not be answered")
    answer = client.get("/readyz")
    assert (answer.status_code, answer.json()["reasons"]) == (200, [])
    status = client.get("/v1/status").json()
    assert status["ready"] is True
    (row,) = (s for s in status["services"] if s["name"] == "detector")
    assert row["state"] == "degraded"
    backend.report("planner", 4105, "degraded", "the disk is full")
    assert client.get("/readyz").json()["reasons"] == ["planner is degraded: the disk is full"]


# --- faults of a real bridge -------------------------------------------------------------------
class Faulty(LineRobot):
    """Its stop fails with `error` after `go_on`. An action fails while `tired` is set."""

    def __init__(self, error: Exception) -> None:
        super().__init__()
        self.error, self.go_on, self.tired = error, threading.Event(), False

    def stop(self, reason: str) -> None:
        self.go_on.wait(30)
        raise self.error

    def act(self, action: Action, action_id: str) -> ActionResult:
        if self.tired:
            raise RuntimeError("a leg does not move")
        return super().act(action, action_id)


@pytest.fixture
def robot(request: pytest.FixtureRequest) -> Faulty:
    return Faulty(getattr(request, "param", Unavailable("no answer from the robot")))


@pytest.fixture
def stage(robot: Faulty, roster: ServiceRegistry) -> Iterator[Stage]:
    """A bridge, whose first action the robot has done."""
    all_ready(roster)
    stage = Stage(robot, stop_timeout_s=0.1)
    stage.bridge.start()
    assert stage.drive("a").succeeded
    yield stage
    robot.go_on.set()
    stage.bridge.close()


def tell(roster: ServiceRegistry, stage: Stage) -> list[str]:
    """The reasons after the bridge has reported its health."""
    state, reason = stage.health.state
    report(roster, "bridge", state, reason, metrics=stage.health.metrics())
    return roster.not_ready_reasons()


def test_a_failed_action_does_not_keep_tasks_off(
    roster: ServiceRegistry, stage: Stage, robot: Faulty
) -> None:
    robot.tired = True
    with pytest.raises(HeliosError, match="a leg does not move"):
        stage.drive("b")
    assert stage.health.state[0] == "degraded"
    assert tell(roster, stage) == []


def test_a_stop_that_hangs_or_then_fails_keeps_tasks_off(
    roster: ServiceRegistry, stage: Stage, robot: Faulty
) -> None:
    with pytest.raises(DeadlineExceeded):
        stage.other.call(STOP, pb.StopRequest(reason="a child"), 10)
    (reason,) = tell(roster, stage)
    assert "the driver's stop has not come back" in reason
    robot.go_on.set()
    wait_until(lambda: "the stop failed" in stage.health.state[1], 60, "the bridge says so")
    (reason,) = tell(roster, stage)
    assert "no answer from the robot" in reason


@pytest.mark.parametrize("robot", [RuntimeError("no brake")], indirect=True)
def test_a_fault_of_the_driver_in_its_stop_keeps_tasks_off(
    roster: ServiceRegistry, stage: Stage, robot: Faulty
) -> None:
    robot.go_on.set()
    with pytest.raises(HeliosError, match="no brake"):
        stage.other.call(STOP, pb.StopRequest(reason="a child"), 10)
    (reason,) = tell(roster, stage)
    assert "failed in stop(): RuntimeError: no brake" in reason
