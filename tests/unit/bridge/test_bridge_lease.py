"""The lease: one client drives at a time, for as long as it keeps sending actions."""

from __future__ import annotations

import pytest
from helios_bridge.lease import Lease
from helios_core import proto as pb
from helios_core.errors import Conflict
from helios_core.robot import Action, ActionResult
from helios_core.topics import LEASE

from tests.unit.bridge.bridge_stage import LineRobot, Stage


def test_an_action_without_the_current_lease_is_refused() -> None:
    stage = Stage()
    stage.drive("a")
    with pytest.raises(Conflict, match="planner drives the robot"):
        stage.other.call(LEASE, pb.LeaseRequest(holder="other"), 1)
    stage.other.call(LEASE, pb.LeaseRequest(holder="other", take=True), 1)
    with pytest.raises(Conflict, match="ask for a new one"):
        stage.drive("b")
    assert len(stage.robot.done) == 1


def test_a_refused_action_may_be_repeated_with_the_same_id() -> None:
    stage = Stage()
    stage.drive("a")
    stage.other.call(LEASE, pb.LeaseRequest(holder="other", take=True), 1)
    with pytest.raises(Conflict):
        stage.drive("b")
    stage.token = stage.other.call(LEASE, pb.LeaseRequest(holder="planner", take=True), 1).token
    assert stage.drive("b").succeeded


def test_an_unused_lease_expires() -> None:
    now = [0.0]
    lease = Lease(10.0, 0, clock=lambda: now[0])
    token = lease.grant("planner")
    now[0] = 9.0
    lease.check(token)
    now[0] = 18.0
    lease.check(token)
    now[0] = 29.0
    with pytest.raises(Conflict, match="ran out"):
        lease.check(token)
    lease.renew(token)  # its last action took that long
    lease.check(token)
    lease.renew(token - 1)
    now[0] = 50.0
    assert lease.grant("other") > token


def test_a_client_keeps_its_lease_during_an_action_longer_than_the_lease() -> None:
    now = [0.0]

    class Slow(LineRobot):
        def act(self, action: Action, action_id: str) -> ActionResult:
            now[0] += 60.0
            return super().act(action, action_id)

    stage = Stage(Slow())
    stage.bridge._lease = Lease(10.0, 0, clock=lambda: now[0])
    stage.drive("a")
    assert stage.drive("b").succeeded


def test_a_released_lease_is_free_at_once() -> None:
    stage = Stage()
    stage.drive("a")
    release = pb.LeaseRequest(release_token=stage.token)
    assert stage.other.call(LEASE, release, 1).token == 0
    with pytest.raises(Conflict, match="ran out"):
        stage.drive("b")
    assert stage.other.call(LEASE, pb.LeaseRequest(holder="other"), 1).token > stage.token


def test_releasing_an_older_lease_has_no_effect() -> None:
    stage = Stage()
    before = stage.other.call(LEASE, pb.LeaseRequest(holder="planner"), 1).token
    stage.drive("a")
    stage.other.call(LEASE, pb.LeaseRequest(release_token=before), 1)
    assert stage.drive("b").succeeded
