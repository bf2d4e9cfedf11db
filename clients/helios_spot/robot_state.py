"""Immutable reading of the robot's state from its RobotState message."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from helios_core.geometry import Matrix

from helios_spot import bosdyn_api
from helios_spot.frame_transforms import (
    BODY,
    HAND,
    VISION,
    WRIST,
    base_below_body,
    ground_height_m,
    knows,
    pose,
    world_from_vision,
)


@dataclass(frozen=True)
class Reading:
    """The robot's state. Frame names as in `helios_spot.frame_transforms`."""

    T_vision_body: Matrix
    T_body_wrist: Matrix | None  # None: no arm
    T_body_hand: Matrix | None
    ground_m: float  # height of the ground in the vision frame
    joints_rad: dict[str, float]
    holding: bool
    motors_on: bool
    estops: tuple[str, ...]  # names of the pressed e-stops
    battery: float | None  # charge, 0 to 1; None: not told

    @property
    def T_world_vision(self) -> Matrix:
        return world_from_vision(self.ground_m)

    @property
    def T_world_base(self) -> Matrix:
        return base_below_body(self.T_world_vision @ self.T_vision_body)


def reading_of(state: Any) -> Reading:
    """Reading of a RobotState message. Raises Internal without a pose, Unavailable if broken."""
    tree = state.kinematic_state.transforms_snapshot
    arm = knows(tree, HAND) and knows(tree, WRIST)
    power_state = state.power_state
    power, manipulator = bosdyn_api.robot_state_pb2.PowerState, state.manipulator_state
    pressed = bosdyn_api.robot_state_pb2.EStopState.STATE_ESTOPPED
    return Reading(
        T_vision_body=pose(tree, VISION, BODY),
        T_body_wrist=pose(tree, BODY, WRIST) if arm else None,
        T_body_hand=pose(tree, BODY, HAND) if arm else None,
        ground_m=ground_height_m(tree),
        joints_rad={j.name: j.position.value for j in state.kinematic_state.joint_states},
        holding=manipulator.is_gripper_holding_item,
        motors_on=power_state.motor_power_state == power.STATE_ON,
        battery=power_state.locomotion_charge_percentage.value / 100
        if power_state.HasField("locomotion_charge_percentage")
        else None,
        estops=tuple(e.name or "e-stop" for e in state.estop_states if e.state == pressed),
    )
