"""What stands out from a surface is found by the height map alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from helios_core.types import AlignedBox, ObjectInstance
from helios_planner.motion_planning.costmap import GroundMap
from helios_planner.motion_planning.things_on_top import MOST_M, raised_spots
from helios_planner.search.unnamed_things import is_unnamed, unnamed_things
from hypothesis import given
from hypothesis import strategies as st

CELL_M = 0.025
TABLE = (1.0, 1.0, 2.0, 1.6)  # x0, y0, x1, y1
SURFACE_M = 0.45


def even(_: str, boxes: Sequence[AlignedBox]) -> list[float]:
    return [0.5 for _ in boxes]


def instance(class_name: str = "coffee table", score: float = 0.9) -> ObjectInstance:
    x0, y0, x1, y1 = TABLE
    corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
    center_m, size_m = np.array([1.5, 1.3, 0.4]), np.array([1.0, 0.6, 0.1])
    return ObjectInstance(
        1, class_name, center_m, size_m, score, score, 0.0, 9, 500, {}, SURFACE_M, corners
    )


def ground(*boxes: tuple[float, float, float, float, float]) -> GroundMap:
    """A table with boxes on it: x0, y0, x1, y1, height above the surface."""
    top = np.zeros((120, 120), np.float32)
    for x0, y0, x1, y1, high_m in ((*TABLE, 0.0), *boxes):
        rows = slice(round(y0 / CELL_M), round(y1 / CELL_M))
        columns = slice(round(x0 / CELL_M), round(x1 / CELL_M))
        top[rows, columns] = SURFACE_M + high_m
    return GroundMap(np.zeros(top.shape, np.int8), top, CELL_M, (0.0, 0.0))


@given(
    x=st.integers(44, 70),
    y=st.integers(44, 55),
    wide=st.integers(2, 6),
    deep=st.integers(2, 6),
    high_m=st.floats(0.02, 0.4),
)
def test_a_thing_is_found_with_its_box(x: int, y: int, wide: int, deep: int, high_m: float) -> None:
    box = (x * CELL_M, y * CELL_M, (x + wide) * CELL_M, (y + deep) * CELL_M, high_m)
    (spot,) = raised_spots(instance(), ground(box))
    middle = [(box[0] + box[2]) / 2, (box[1] + box[3]) / 2, SURFACE_M + high_m / 2]
    assert spot.center_m == pytest.approx(middle, abs=1e-3)
    assert spot.size_m == pytest.approx([wide * CELL_M, deep * CELL_M, high_m], abs=1e-3)


def test_things_of_different_heights_that_touch_are_two() -> None:
    lamp, shaker = (1.2, 1.2, 1.3, 1.3, 0.21), (1.3, 1.2, 1.375, 1.275, 0.11)
    assert sorted(
        round(float(s.size_m[2]), 2) for s in raised_spots(instance(), ground(lamp, shaker))
    ) == [
        0.11,
        0.21,
    ]


@pytest.mark.parametrize(
    "box",
    [
        (1.1, 1.1, 1.1 + MOST_M + 0.1, 1.2, 0.3),  # as long as a back rest
        (1.2, 1.2, 1.3, 1.3, 0.6),  # as high as a wall
        (1.2, 1.2, 1.3, 1.3, 0.01),  # the noise of a surface
        (1.2, 1.2, 1.225, 1.225, 0.1),  # a single cell
        (2.1, 1.2, 2.2, 1.3, 0.1),  # beside the table
    ],
)
def test_what_is_no_thing_on_the_table_is_left_out(
    box: tuple[float, float, float, float, float],
) -> None:
    assert raised_spots(instance(), ground(box)) == []


def test_without_a_seen_surface_there_is_nothing() -> None:
    empty = np.zeros((120, 120), np.float32)
    unseen = GroundMap(np.full(empty.shape, -1, np.int8), empty, CELL_M, (0.0, 0.0))
    assert raised_spots(instance(), unseen) == []
    far = GroundMap(unseen.occupancy, empty, CELL_M, (50.0, 50.0))
    assert raised_spots(instance(), far) == []


def test_only_things_of_the_right_size_on_a_believed_receptacle_are_tried() -> None:
    laptop, mug = (1.1, 1.1, 1.45, 1.35, 0.03), (1.7, 1.3, 1.8, 1.4, 0.1)
    seen = ground(laptop, mug)
    (only,) = unnamed_things("mug", [instance()], seen, even)
    assert only.center_m[:2] == pytest.approx([1.75, 1.35], abs=0.01)
    assert only.score == pytest.approx(0.45, abs=0.02)
    assert is_unnamed(only)
    assert not is_unnamed(instance())
    assert unnamed_things("mug", [instance(score=0.4)], seen, even) == []


def test_what_was_called_otherwise_comes_last_or_is_left_out() -> None:
    seen = ground((1.2, 1.2, 1.3, 1.3, 0.1), (1.5, 1.2, 1.6, 1.3, 0.1), (1.8, 1.2, 1.9, 1.3, 0.1))

    def by_place(_: str, boxes: Sequence[AlignedBox]) -> list[float]:
        return [{1.2: 0.2, 1.5: 0.9, 1.8: 0.001}[round(float(c[0]) - 0.05, 1)] for c, _ in boxes]

    found = unnamed_things("mug", [instance()], seen, by_place)
    assert [round(float(t.center_m[0]), 2) for t in found] == [1.55, 1.25]
