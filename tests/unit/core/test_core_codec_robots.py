"""Robot descriptions and states are accepted only with values that a robot can have."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
from helios_core import proto as pb
from helios_core.codec import (
    description_from_proto,
    description_to_proto,
    state_from_proto,
    state_to_proto,
)
from helios_core.errors import InvalidInput
from helios_core.geometry import Pinhole, se2_to_se3
from helios_core.types import RobotDescription, RobotState
from hypothesis import given, settings
from hypothesis import strategies as st

NUMBERS = [f.name for f in pb.RobotDescription.DESCRIPTOR.fields if f.type == f.TYPE_DOUBLE]


def valid_description() -> pb.RobotDescription:
    """The description of a valid robot."""
    camera = Pinhole(30.0, 31.0, 16.0, 12.0, 32, 24)
    return description_to_proto(RobotDescription("ada", 0.3, 1.4, camera, 1.31, 0.8, 10.0))


def _with(**values: float) -> Callable[[pb.RobotDescription], None]:
    def spoil(robot: pb.RobotDescription) -> None:
        for name, value in values.items():
            setattr(robot, name, value)

    return spoil


@pytest.mark.parametrize("name", NUMBERS)
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e300])
def test_a_description_with_a_non_finite_or_huge_number_is_refused(name: str, value: float) -> None:
    message = valid_description()
    setattr(message, name, value)
    with pytest.raises(InvalidInput, match=f"'ada' .* {name} .*; wanted a number from .*describe"):
        description_from_proto(message)


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (_with(max_depth_m=0.0), "max_depth_m 0; wanted a number from 0.001 to 20000"),
        (_with(footprint_radius_m=-0.3), "footprint_radius_m -0.3; wanted a number from 0 to 10"),
        (_with(footprint_radius_m=0.0), "can_move and footprint_radius_m 0"),
        (_with(reach_m=-1.0), "reach_m -1"),
        (_with(min_forward_m=2.0), "min_forward_m 2 above max_forward_m 1"),
        (_with(max_turn_rad=0.0), "above max_turn_rad 0"),
        (_with(min_tilt_rad=0.5), "min_tilt_rad 0.5 above max_tilt_rad 0"),
        (_with(footprint_length_m=1.1), "a footprint of 1.1 x 0 m"),
        (lambda robot: robot.ClearField("camera"), "focal lengths"),
    ],
)
def test_an_impossible_description_is_refused(
    spoil: Callable[[pb.RobotDescription], None], said: str
) -> None:
    message = valid_description()
    spoil(message)
    with pytest.raises(InvalidInput, match=said):
        description_from_proto(message)


@pytest.mark.parametrize(
    "fit",
    [
        _with(can_move=False, footprint_radius_m=0.0, max_forward_m=0.0, max_turn_rad=0.0),
        _with(can_move=False, height_m=-2.0, camera_height_m=-2.1),  # carried below the floor
        _with(min_tilt_rad=0.4, max_tilt_rad=0.4),  # a camera that cannot tilt
        _with(footprint_length_m=1.1, footprint_width_m=0.5),
        _with(max_turn_rad=math.radians(360)),
    ],
)
def test_an_unusual_robot_is_accepted(fit: Callable[[pb.RobotDescription], None]) -> None:
    message = valid_description()
    fit(message)
    assert description_to_proto(description_from_proto(message)) == message


@settings(max_examples=200, deadline=None)
@given(st.dictionaries(st.sampled_from(NUMBERS), st.floats(), max_size=4), st.booleans())
def test_any_description_is_either_accepted_or_refused_with_invalid_input(
    values: dict[str, float], can_move: bool
) -> None:
    message = valid_description()
    message.can_move = can_move
    _with(**values)(message)
    try:
        robot = description_from_proto(message)
    except InvalidInput:
        return
    assert all(math.isfinite(getattr(message, name)) for name in NUMBERS)
    assert 0 <= robot.inner_radius_m <= 10
    assert robot.max_depth_m > 0


def test_a_tilt_that_is_nan_is_refused() -> None:
    message = state_to_proto(RobotState(se2_to_se3(0.0, 0.0, 0.0), tilt_rad=math.nan))
    with pytest.raises(InvalidInput, match="tilt_rad is nan"):
        state_from_proto(message)


@pytest.mark.parametrize("battery", [None, 0.0, 0.42, 1.0])
def test_a_battery_keeps_its_charge_and_one_out_of_range_is_unknown(battery: float | None) -> None:
    message = state_to_proto(RobotState(se2_to_se3(0.0, 0.0, 0.0), battery=battery))
    assert state_from_proto(message).battery == battery
    for wrong in (-0.1, 1.1, math.nan, math.inf):
        message.battery = wrong
        assert state_from_proto(message).battery is None
