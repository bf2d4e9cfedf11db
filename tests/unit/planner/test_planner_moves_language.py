"""Parsing of instructions that only move the robot, and of points in many notations."""

from __future__ import annotations

import math

import pytest
from helios_core import proto as pb
from helios_core.errors import InvalidInput
from helios_planner.instruction.parser import Kind, parse
from helios_planner.tasks.search_context import in_vocabulary
from hypothesis import given
from hypothesis import strategies as st
from planner_phrasings import ONLY_MOVES, POINTS, rows

metres = st.floats(-9_999, 9_999).map(lambda v: round(v, 3))
degrees = st.floats(-180, 180).map(lambda v: round(v, 2))


@pytest.mark.parametrize(("text", "x", "y", "facing"), rows(POINTS))
def test_a_point_is_understood(text: str, x: str, y: str, facing: str) -> None:
    got = parse(text)
    assert got.kind is Kind.GO_TO_POINT
    assert got.point is not None
    assert (got.point.x_m, got.point.y_m) == (float(x), float(y))
    yaw_rad = got.point.yaw_rad
    assert (yaw_rad is None) == (facing == "")
    if yaw_rad is not None:
        assert math.degrees(yaw_rad) == pytest.approx(float(facing), abs=0.01)


@pytest.mark.parametrize(("text", "kind", "seconds"), rows(ONLY_MOVES))
def test_an_instruction_that_only_moves_the_robot_is_understood(
    text: str, kind: str, seconds: str
) -> None:
    got = parse(text)
    assert (got.kind, got.object, got.goal, got.point) == (kind, None, None, None)
    assert got.limit_s == (float(seconds) if seconds else None)


@given(
    metres, metres, degrees,
    st.sampled_from(["go to", "please drive to", "navigate to the point", "move to", "go"]),
    st.sampled_from(["{x:.3f}, {y:.3f}", "({x:.3f} m, {y:.3f} m)", "x={x:.3f} y={y:.3f}",
                     "[{x:.3f}; {y:.3f}]", "{x:.3f} {y:.3f}"]),
    st.sampled_from(["facing {d:.2f} degrees", "with a yaw of {d:.2f}°", ", heading {d:.2f}"]),
)  # fmt: skip
def test_a_written_point_is_parsed_exactly(
    x: float, y: float, d: float, verb: str, point: str, facing: str
) -> None:
    got = parse(f"{verb} {point.format(x=x, y=y)} {facing.format(d=d)}").point
    assert got is not None
    assert (got.x_m, got.y_m) == (x, y)
    assert got.yaw_rad is not None
    assert math.cos(got.yaw_rad - math.radians(d)) == pytest.approx(1)
    assert -math.pi < got.yaw_rad <= math.pi


NUMBERS = (
    "go to the point 3 -4 2.5 , ( ) . - 1e9 x y = facing 90 degrees m and sofa explore for s back"
)


@given(st.lists(st.sampled_from(NUMBERS.split()), max_size=12).map(" ".join))
def test_any_sequence_of_numbers_and_words_is_read_or_refused(text: str) -> None:
    try:
        got = parse(text)
    except InvalidInput:
        return
    if got.kind is Kind.GO_TO_POINT:
        assert got.point is not None
        assert math.isfinite(got.point.x_m + got.point.y_m)


@given(st.text("0123456789.,-+() m", max_size=60))
def test_digits_of_any_length_are_read_or_refused(digits: str) -> None:
    try:
        got = parse(f"go to {digits}")
    except InvalidInput:
        return
    assert got.point is None or math.isfinite(got.point.x_m + got.point.y_m)


def test_a_number_too_long_for_a_float_is_refused() -> None:
    with pytest.raises(InvalidInput, match="beyond 10000 m"):
        parse(f"go to {'9' * 330}, 1")


@pytest.mark.parametrize("x", ["NaN", "-nan", "inf", "Infinity", "-inf", "∞"])
@pytest.mark.parametrize(
    "text", ["go to {}, 3", "drive to (3, {})", "go to x={} y=2", "go to {} {}"]
)
def test_nan_and_infinity_are_refused_as_coordinates(text: str, x: str) -> None:
    with pytest.raises(InvalidInput, match=r"gives nan as [xy]|beyond 10000 m") as refused:
        parse(text.format(x, x))
    assert "3.2, 4.1" in refused.value.message


def test_numbers_that_count_objects_are_not_read_as_a_point() -> None:
    with pytest.raises(InvalidInput, match="several things at once"):
        parse("move 2, 3 mugs to the sofa")


@pytest.mark.parametrize("text", ["go to the kitchen table", "go to the table in the kitchen"])
def test_a_room_before_furniture_is_reported_as_unused(text: str) -> None:
    names = pb.VocabularyReply(names=["table", "sofa"], detector="fake")
    got = in_vocabulary(parse(text), names)
    assert (got.kind, got.goal) == ("go_to", "table")
    assert any("kitchen" in words for words in got.unused)


def test_a_room_that_is_part_of_a_known_name_is_kept() -> None:
    names = pb.VocabularyReply(names=["table", "kitchen table"], detector="fake")
    got = in_vocabulary(parse("go to the kitchen table"), names)
    assert (got.goal, got.unused) == ("kitchen table", ())
