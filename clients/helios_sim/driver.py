"""The simulated robot for the bridge: asks the world process over the bus.

Any other process that answers `world/…` is a robot, too (`--robot bus`,
docs/reference/wire-contract.md).
It knows what a real robot would know. It imports nothing of the world itself, so that the bridge
needs no MuJoCo, and it may come and go: the world stays as it is.
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
from helios_core.robot import Action, ActionResult, Capture, RobotDriver
from helios_core.topics import (
    WORLD_ACT,
    WORLD_CAPTURE,
    WORLD_CLEAR_STOP,
    WORLD_DESCRIBE,
    WORLD_STATE,
    WORLD_STOP,
)
from helios_core.types import RobotDescription, RobotState

from helios_sim.capture_messages import capture_from_proto

CALL_TIMEOUT_S = 10.0
ACT_TIMEOUT_S = 60.0


class SimDriver(RobotDriver):
    """Every call raises Unavailable while no world is there."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus

    def describe(self) -> RobotDescription:
        return description_from_proto(self._bus.call(WORLD_DESCRIBE, pb.Empty(), CALL_TIMEOUT_S))

    def state(self) -> RobotState:
        return state_from_proto(self._bus.call(WORLD_STATE, pb.Empty(), CALL_TIMEOUT_S))

    def capture(self) -> Capture:
        return capture_from_proto(self._bus.call(WORLD_CAPTURE, pb.Empty(), CALL_TIMEOUT_S))

    def act(self, action: Action, action_id: str) -> ActionResult:
        request = pb.WorldActRequest(action_id=action_id, action=action_to_proto(action))
        return result_from_proto(self._bus.call(WORLD_ACT, request, ACT_TIMEOUT_S))

    def stop(self, reason: str) -> None:
        self._bus.call(WORLD_STOP, pb.StopRequest(reason=reason), CALL_TIMEOUT_S)

    def clear_stop(self) -> None:
        self._bus.call(WORLD_CLEAR_STOP, pb.Empty(), CALL_TIMEOUT_S)
