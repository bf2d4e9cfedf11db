"""Contract tests of the driver behind its bridge: lease, keyframes, emergency stop."""

from __future__ import annotations

import uuid

import numpy as np
import pytest
from helios_bridge.service import BridgeService
from helios_bridge.settings import Settings
from helios_core import proto as pb
from helios_core.codec import action_to_proto, frame_from_proto, state_from_proto
from helios_core.errors import Conflict, DeadlineExceeded
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.robot import Action, Observe, Turn
from helios_core.topics import ACT, CLEAR_STOP, GET_STATE, KEYFRAME, LEASE, STOP

from helios_contract.rig import Rig

CALL_S = 60.0


class Host:
    """Bridge around the rig's driver, with a client on the other end of the bus."""

    def __init__(self, rig: Rig) -> None:
        hub = MemoryHub()
        self._bus = MemoryBus(hub)
        self.keyframes: list[pb.Frame] = []
        self._bus.subscribe(KEYFRAME, self.keyframes.append)
        # Neither started nor closed: it runs no threads, and the rig owns the driver.
        settings = Settings(stream_hz=0, autoplay=False)
        BridgeService(MemoryBus(hub), rig.driver, settings, Health(), first_number=0)
        self.motion: Action = Turn(rig.turn_rad) if rig.robot.can_move else Observe()

    def lease(self, holder: str = "one", take: bool = False) -> int:
        request = pb.LeaseRequest(holder=holder, take=take)
        return self._bus.call(LEASE, request, CALL_S).token

    def act(
        self, token: int, action: Action, id: str = "", left_s: float = CALL_S
    ) -> pb.ActionResult:
        request = pb.ActionRequest(
            action_id=id or uuid.uuid4().hex,
            lease_token=token,
            time_remaining_s=left_s,
            action=action_to_proto(action),
        )
        return self._bus.call(ACT, request, CALL_S)

    def stop(self, reason: str) -> None:
        self._bus.call(STOP, pb.StopRequest(reason=reason), CALL_S)

    def clear_stop(self) -> None:
        self._bus.call(CLEAR_STOP, pb.Empty(), CALL_S)

    def state(self) -> pb.RobotState:
        return self._bus.call(GET_STATE, pb.Empty(), CALL_S)


class BridgeClaims:
    """Contract tests of driver and bridge together."""

    @pytest.fixture
    def host(self, rig: Rig) -> Host:
        return Host(rig)

    def test_an_action_ends_in_a_keyframe_that_anybody_can_read(self, rig: Rig, host: Host) -> None:
        result = host.act(host.lease(), Observe())
        (keyframe,) = host.keyframes
        assert result.keyframe == keyframe.id
        frame = frame_from_proto(keyframe)  # raises if inconsistent
        assert frame.keyframe
        np.testing.assert_allclose(frame.T_world_base, rig.pose(), atol=rig.tolerance_m)

    def test_keyframes_rise_within_one_world(self, host: Host) -> None:
        token = host.lease()
        for _ in range(3):
            host.act(token, Observe())
        a, b, c = (frame.id for frame in host.keyframes)
        assert a.seq < b.seq < c.seq
        assert a.robot_boot_id == b.robot_boot_id == c.robot_boot_id != ""
        assert a.world_epoch == b.world_epoch == c.world_epoch

    def test_the_bus_tells_the_drivers_state(self, rig: Rig, host: Host) -> None:
        published, own = state_from_proto(host.state()), rig.driver.state()
        np.testing.assert_allclose(
            published.T_world_base, own.T_world_base, atol=rig.tolerance_m / 5
        )
        assert (published.held, published.stopped, published.moving) == (
            own.held,
            own.stopped,
            False,
        )

    def test_state_and_keyframes_name_the_drivers_origin(self, rig: Rig, host: Host) -> None:
        own = rig.driver.state().origin_id
        host.act(host.lease(), Observe())
        (keyframe,) = host.keyframes
        assert (host.state().origin_id, keyframe.origin_id) == (own, own)

    def test_without_the_lease_nobody_drives(self, rig: Rig, host: Host) -> None:
        before, token = rig.pose(), host.lease()
        with pytest.raises(Conflict):
            host.act(token + 1, host.motion)
        with pytest.raises(Conflict):
            host.act(0, host.motion)
        np.testing.assert_allclose(rig.pose(), before, atol=rig.tolerance_m / 5)

    def test_who_takes_the_lease_ends_the_one_before(self, rig: Rig, host: Host) -> None:
        before, old = rig.pose(), host.lease("one")
        with pytest.raises(Conflict):
            host.lease("another")
        new = host.lease("another", take=True)
        assert new > old
        with pytest.raises(Conflict):
            host.act(old, host.motion)
        np.testing.assert_allclose(rig.pose(), before, atol=rig.tolerance_m / 5)
        assert host.act(new, Observe()).succeeded

    def test_an_action_asked_for_twice_is_done_once(self, rig: Rig, host: Host) -> None:
        token, id = host.lease(), uuid.uuid4().hex
        first = host.act(token, host.motion, id)
        there = rig.pose()
        assert host.act(token, host.motion, id) == first
        np.testing.assert_allclose(rig.pose(), there, atol=rig.tolerance_m / 5)
        if rig.robot.can_move:
            host.act(token, Turn(-rig.turn_rad))

    def test_an_action_whose_time_is_over_is_not_begun(self, rig: Rig, host: Host) -> None:
        before, token = rig.pose(), host.lease()
        with pytest.raises(DeadlineExceeded):
            host.act(token, host.motion, left_s=0.0)
        np.testing.assert_allclose(rig.pose(), before, atol=rig.tolerance_m / 5)

    def test_stop_now_latches_says_why_and_is_lifted_by_clear_stop_alone(
        self, rig: Rig, host: Host
    ) -> None:
        token = host.lease()
        host.stop("a child in the way")
        assert rig.driver.state().stopped
        assert host.state().stopped
        assert "a child in the way" in host.state().message
        with pytest.raises(Conflict, match="a child in the way"):
            host.act(token, host.motion)
        with pytest.raises(Conflict):
            host.act(host.lease(take=True), host.motion)
        host.clear_stop()
        assert not host.state().stopped
        assert host.act(host.lease(take=True), Observe()).succeeded
