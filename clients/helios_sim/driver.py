"""Driver of the simulated robot: forwards each call to the world process over the bus.

Any other process that serves `world/…` is a robot, too (`--robot bus`,
docs/reference/wire-contract.md).
The driver reports only data that a real robot has. It imports no simulation code, so the bridge
needs no MuJoCo. A restart of the driver leaves the world unchanged.
"""

from __future__ import annotations

from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.codec import (
    action_to_proto,
    description_from_proto,
    result_from_proto,
    state_from_proto,
)
from helios_core.errors import InvalidInput, Unavailable
from helios_core.heartbeat import HeartbeatSender
from helios_core.robot import Action, ActionResult, Capture, RobotDriver
from helios_core.topics import (
    BRIDGE_HEARTBEAT,
    WORLD_ACT,
    WORLD_CAPTURE,
    WORLD_CLEAR_STOP,
    WORLD_DESCRIBE,
    WORLD_STATE,
    WORLD_STOP,
    WORLD_WATCHED,
)
from helios_core.types import RobotDescription, RobotState

from helios_sim.capture_messages import capture_from_proto

CALL_TIMEOUT_S = 10.0
ACT_TIMEOUT_S = 60.0


class SimDriver(RobotDriver):
    """Robot driver over the bus. Every call raises Unavailable while no world process runs."""

    def __init__(self, bus: Bus) -> None:
        self._bus, self._heart = bus, HeartbeatSender(bus, BRIDGE_HEARTBEAT)

    def describe(self) -> RobotDescription:
        return description_from_proto(self._bus.call(WORLD_DESCRIBE, pb.Empty(), CALL_TIMEOUT_S))

    def state(self) -> RobotState:
        return state_from_proto(self._bus.call(WORLD_STATE, pb.Empty(), CALL_TIMEOUT_S))

    def capture(self) -> Capture:
        return capture_from_proto(self._bus.call(WORLD_CAPTURE, pb.Empty(), CALL_TIMEOUT_S))

    def act(self, action: Action, action_id: str) -> ActionResult:
        request = pb.WorldActRequest(
            action_id=action_id, action=action_to_proto(action), beats=True
        )
        with self._heart.beating(action_id):
            return result_from_proto(self._bus.call(WORLD_ACT, request, ACT_TIMEOUT_S))

    def act_and_watch(
        self, action: Action, action_id: str, hz: float
    ) -> tuple[ActionResult, tuple[Capture, ...]]:
        """Execute an action; a robot that does not serve `world/watched` takes no images."""
        request = pb.WorldActRequest(
            action_id=action_id, action=action_to_proto(action), beats=True, watch_hz=hz
        )
        with self._heart.beating(action_id):
            done = result_from_proto(self._bus.call(WORLD_ACT, request, ACT_TIMEOUT_S))
        try:
            seen = self._bus.call(WORLD_WATCHED, pb.Empty(), CALL_TIMEOUT_S).captures
        except (Unavailable, InvalidInput):
            return done, ()
        return done, tuple(map(capture_from_proto, seen))

    def stop(self, reason: str) -> None:
        self._bus.call(WORLD_STOP, pb.StopRequest(reason=reason), CALL_TIMEOUT_S)

    def clear_stop(self) -> None:
        self._bus.call(WORLD_CLEAR_STOP, pb.Empty(), CALL_TIMEOUT_S)
