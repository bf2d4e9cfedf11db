"""Conversion of RobotDescription, RobotState and actions to protobuf messages and back."""

from __future__ import annotations

import math

from helios_core import proto as pb
from helios_core.codec.frames import (
    FARTHEST_M,
    pinhole_from_proto,
    pinhole_to_proto,
    transform_from_proto,
    transform_to_proto,
)
from helios_core.errors import InvalidInput
from helios_core.robot import (
    Action,
    ActionResult,
    Forward,
    Observe,
    Pick,
    Place,
    Show,
    Tilt,
    Turn,
)
from helios_core.types import RobotDescription, RobotState

LARGEST_M = 10.0  # limit of the size and the reach of a robot

# Range of each number in a RobotDescription. A hand-held camera may be anywhere in its world, also
# below the floor.
_RANGES = {
    "footprint_radius_m": (0.0, LARGEST_M),
    "footprint_length_m": (0.0, LARGEST_M),
    "footprint_width_m": (0.0, LARGEST_M),
    "height_m": (-FARTHEST_M, FARTHEST_M),
    "camera_height_m": (-FARTHEST_M, FARTHEST_M),
    "camera_forward_m": (-LARGEST_M, LARGEST_M),
    "reach_m": (0.0, LARGEST_M),
    "max_depth_m": (1e-3, FARTHEST_M),
    "min_forward_m": (0.0, FARTHEST_M),
    "max_forward_m": (0.0, FARTHEST_M),
    "max_back_m": (0.0, FARTHEST_M),
    "min_turn_rad": (0.0, 2 * math.pi),
    "max_turn_rad": (0.0, 2 * math.pi),
    "min_tilt_rad": (-math.pi, math.pi),
    "max_tilt_rad": (-math.pi, math.pi),
}


def description_to_proto(robot: RobotDescription) -> pb.RobotDescription:
    """Message of a description; a disc footprint becomes a box of 0 x 0 m."""
    length_m, width_m = robot.footprint_box_m or (0.0, 0.0)
    show = robot.show_base_m
    return pb.RobotDescription(
        name=robot.name,
        footprint_radius_m=robot.footprint_radius_m,
        height_m=robot.height_m,
        camera=pinhole_to_proto(robot.camera),
        camera_height_m=robot.camera_height_m,
        camera_forward_m=robot.camera_forward_m,
        min_forward_m=robot.min_forward_m,
        max_forward_m=robot.max_forward_m,
        max_back_m=robot.max_back_m,
        min_turn_rad=robot.min_turn_rad,
        max_turn_rad=robot.max_turn_rad,
        min_tilt_rad=robot.tilt_range_rad[0],
        max_tilt_rad=robot.tilt_range_rad[1],
        reach_m=robot.reach_m,
        can_move=robot.can_move,
        can_pick=robot.can_pick,
        can_place=robot.can_place,
        max_depth_m=robot.max_depth_m,
        simulated=robot.simulated,
        recorded=robot.recorded,
        footprint_length_m=length_m,
        footprint_width_m=width_m,
        show_base_m=None if show is None else pb.Vector3(x=show[0], y=show[1], z=show[2]),
        world_frame=robot.world_frame,
    )


def description_from_proto(robot: pb.RobotDescription) -> RobotDescription:
    """RobotDescription.

    Raises InvalidInput on a number out of its range, a minimum above its maximum, a footprint box
    with one side 0, a moving robot without size, or an implausible camera.
    """
    for name, (least, most) in _RANGES.items():
        if not least <= (value := getattr(robot, name)) <= most:  # also for NaN
            raise _misdescribed(robot, f"{name} {value:g}", f"a number from {least:g} to {most:g}")
    for what in ("forward_m", "turn_rad", "tilt_rad"):
        least, most = getattr(robot, f"min_{what}"), getattr(robot, f"max_{what}")
        can_do = robot.can_move or what == "tilt_rad"
        if can_do and least > most:
            came = f"min_{what} {least:g} above max_{what} {most:g}"
            raise _misdescribed(robot, came, "the smaller one first")
    box = (robot.footprint_length_m, robot.footprint_width_m)
    if (box[0] > 0) != (box[1] > 0):
        came = f"a footprint of {box[0]:g} x {box[1]:g} m"
        raise _misdescribed(robot, came, "length and width, or neither for a disc")
    if robot.can_move and robot.footprint_radius_m == 0:
        raise _misdescribed(robot, "can_move and footprint_radius_m 0", "a body above 0 m")
    show = robot.show_base_m if robot.HasField("show_base_m") else None
    if show is not None and not all(abs(v) <= LARGEST_M for v in (show.x, show.y, show.z)):
        came = f"show_base_m ({show.x:g}, {show.y:g}, {show.z:g})"
        raise _misdescribed(robot, came, f"three numbers up to {LARGEST_M:g} m")
    return RobotDescription(
        name=robot.name,
        footprint_radius_m=robot.footprint_radius_m,
        height_m=robot.height_m,
        camera=pinhole_from_proto(robot.camera),
        camera_height_m=robot.camera_height_m,
        camera_forward_m=robot.camera_forward_m,
        reach_m=robot.reach_m,
        max_depth_m=robot.max_depth_m,
        min_forward_m=robot.min_forward_m,
        max_forward_m=robot.max_forward_m,
        max_back_m=robot.max_back_m,
        min_turn_rad=robot.min_turn_rad,
        max_turn_rad=robot.max_turn_rad,
        tilt_range_rad=(robot.min_tilt_rad, robot.max_tilt_rad),
        can_move=robot.can_move,
        can_pick=robot.can_pick,
        can_place=robot.can_place,
        simulated=robot.simulated,
        recorded=robot.recorded,
        footprint_box_m=box if min(box) > 0 else None,
        show_base_m=None if show is None else (show.x, show.y, show.z),
        world_frame=robot.world_frame,
    )


def _misdescribed(robot: pb.RobotDescription, came: str, wanted: str) -> InvalidInput:
    return InvalidInput(
        f"the robot {robot.name[:100]!r} describes itself with {came}; wanted {wanted}; mend what "
        "its driver's describe() gives"
    )


def state_to_proto(state: RobotState) -> pb.RobotState:
    """Message of a robot state; the inverse of `state_from_proto`."""
    return pb.RobotState(
        T_world_base=transform_to_proto(state.T_world_base),
        tilt_rad=state.tilt_rad,
        held=state.held,
        moving=state.moving,
        stopped=state.stopped,
        world_epoch=state.world_epoch,
        robot_boot_id=state.robot_boot_id,
        message=state.message,
        finished=state.finished,
        last_seq=state.last_seq,
        last_action_id=state.last_action_id,
        origin_id=state.origin_id,
        battery=state.battery,
    )


def state_from_proto(state: pb.RobotState) -> RobotState:
    """RobotState. Raises InvalidInput on a pose that is not rigid or a tilt that is not finite."""
    return RobotState(
        T_world_base=transform_from_proto(state.T_world_base, "T_world_base"),
        tilt_rad=_finite(state.tilt_rad, "tilt_rad"),
        held=state.held,
        moving=state.moving,
        stopped=state.stopped,
        world_epoch=state.world_epoch,
        robot_boot_id=state.robot_boot_id,
        message=state.message,
        finished=state.finished,
        last_seq=state.last_seq,
        last_action_id=state.last_action_id,
        origin_id=state.origin_id,
        battery=battery_from_proto(state),
    )


def battery_from_proto(state: pb.RobotState) -> float | None:
    """Charge of the battery, 0 to 1; None if it is not known or out of range."""
    given = state.HasField("battery") and 0.0 <= state.battery <= 1.0  # also for NaN
    return state.battery if given else None


def action_to_proto(action: Action) -> pb.Action:
    """Message of an action, with the field of `kind` that has the name of its class."""
    match action:
        case Forward(distance_m):
            return pb.Action(forward=pb.Action.Forward(distance_m=distance_m))
        case Turn(angle_rad):
            return pb.Action(turn=pb.Action.Turn(angle_rad=angle_rad))
        case Tilt(angle_rad):
            return pb.Action(tilt=pb.Action.Tilt(angle_rad=angle_rad))
        case Pick((x, y, z), class_name):
            point = pb.Vector3(x=x, y=y, z=z)
            return pb.Action(pick=pb.Action.Pick(point_world_m=point, class_name=class_name))
        case Place((x, y, z)):
            return pb.Action(place=pb.Action.Place(point_world_m=pb.Vector3(x=x, y=y, z=z)))
        case Observe():
            return pb.Action(observe=pb.Action.Observe())
        case Show(angle_rad):
            return pb.Action(show=pb.Action.Show(angle_rad=angle_rad))


def action_from_proto(action: pb.Action) -> Action:
    """Action. Raises InvalidInput on an empty action or on numbers that are not finite."""
    kind = action.WhichOneof("kind")
    if kind is None:
        raise InvalidInput(
            "the action is empty; send forward, turn, tilt, pick, place, observe or show"
        )
    if kind == "forward":
        return Forward(_finite(action.forward.distance_m, "forward.distance_m"))
    if kind == "turn":
        return Turn(_finite(action.turn.angle_rad, "turn.angle_rad"))
    if kind == "tilt":
        return Tilt(_finite(action.tilt.angle_rad, "tilt.angle_rad"))
    if kind == "pick":
        return Pick(_point(action.pick.point_world_m, "pick"), action.pick.class_name)
    if kind == "place":
        return Place(_point(action.place.point_world_m, "place"))
    if kind == "show":
        return Show(_finite(action.show.angle_rad, "show.angle_rad"))
    return Observe()


def result_from_proto(result: pb.ActionResult) -> ActionResult:
    """ActionResult without the keyframe and the final pose, which only the message has."""
    return ActionResult(
        succeeded=result.succeeded,
        reason=result.reason,
        moved_m=result.moved_m,
        turned_rad=result.turned_rad,
        collided=result.collided,
        steps=result.steps,
    )


def result_to_proto(result: ActionResult, action_id: str) -> pb.ActionResult:
    """Message of a result; the bridge adds the keyframe and the final pose."""
    return pb.ActionResult(
        action_id=action_id,
        succeeded=result.succeeded,
        reason=result.reason,
        moved_m=result.moved_m,
        turned_rad=result.turned_rad,
        collided=result.collided,
        steps=result.steps,
    )


def _finite(value: float, what: str) -> float:
    if not math.isfinite(value):
        raise InvalidInput(f"{what} is {value}; send a finite number")
    return value


def _point(p: pb.Vector3, what: str) -> tuple[float, float, float]:
    return (
        _finite(p.x, f"{what}.x"),
        _finite(p.y, f"{what}.y"),
        _finite(p.z, f"{what}.z"),
    )
