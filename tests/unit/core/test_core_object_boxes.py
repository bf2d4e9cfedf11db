"""Upright boxes of objects for viewers."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helios_core import proto as pb
from helios_core.object_boxes import upright_box
from hypothesis import given
from hypothesis import strategies as st


def thing(outline: np.ndarray, height_m: float = 0.7) -> pb.ObjectInstance:
    low, high = outline.min(axis=0), outline.max(axis=0)
    x, y = (low + high) / 2
    width, depth = high - low
    return pb.ObjectInstance(
        center_m=pb.Vector3(x=x, y=y, z=height_m / 2),
        size_m=pb.Vector3(x=width, y=depth, z=height_m),
        outline_m=outline.ravel(),
    )


@given(
    st.floats(-math.pi, math.pi),
    st.floats(0.2, 3),
    st.floats(0.2, 3),
    st.floats(-50, 50),
    st.floats(-50, 50),
)
def test_the_box_of_a_turned_table_has_its_size_place_and_yaw(
    yaw_rad: float, width_m: float, depth_m: float, x_m: float, y_m: float
) -> None:
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * (width_m / 2, depth_m / 2)
    box = upright_box(thing(corners @ np.array([(c, s), (-s, c)]) + (x_m, y_m)))
    assert box is not None
    assert box.center_m == pytest.approx((x_m, y_m, 0.35), abs=1e-4)
    assert -math.pi / 4 - 1e-6 < box.yaw_rad <= math.pi / 4 + 1e-6
    assert sorted(box.size_m[:2]) == pytest.approx(sorted((width_m, depth_m)), abs=1e-3)
    x_axis = np.array([math.cos(box.yaw_rad), math.sin(box.yaw_rad)])
    along = abs(x_axis @ (c, s)) if abs(box.size_m[0] - width_m) < 1e-3 else abs(x_axis @ (-s, c))
    if abs(width_m - depth_m) > 0.01:
        assert along == pytest.approx(1, abs=1e-3)


def test_a_thing_without_an_outline_has_its_box_along_the_axes() -> None:
    cup = pb.ObjectInstance(
        center_m=pb.Vector3(x=1, y=2, z=0.5), size_m=pb.Vector3(x=0.1, y=0.2, z=0)
    )
    box = upright_box(cup, least_m=0.02)
    assert box is not None
    assert (box.yaw_rad, box.center_m) == (0, (1, 2, 0.5))
    assert box.size_m == pytest.approx((0.1, 0.2, 0.02))


@pytest.mark.parametrize("field", ["center_m", "size_m"])
def test_a_thing_at_no_finite_place_has_no_box(field: str) -> None:
    cup = pb.ObjectInstance(center_m=pb.Vector3(x=1), size_m=pb.Vector3(x=1))
    getattr(cup, field).z = math.nan
    assert upright_box(cup) is None


def test_an_outline_that_is_not_finite_or_is_cut_short_is_left_out() -> None:
    for outline in ([math.nan, 0, 1, 0, 1, 1], [0, 0, 1, 0, 1], [0, 0, 1, 0]):
        cup = pb.ObjectInstance(size_m=pb.Vector3(x=1, y=2, z=3), outline_m=outline)
        box = upright_box(cup)
        assert box is not None
        assert (box.size_m, box.yaw_rad) == ((1, 2, 3), 0)
