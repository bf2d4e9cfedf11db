"""Alignment of a partial map with a stored one: what it finds, and what it refuses."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
from helios_core.map_snapshot import FREE, OCCUPIED, UNKNOWN
from helios_map2d.relocalisation.alignment import Alignment, align, prepared
from helios_map2d.relocalisation.grid_fields import OccupancyGrid
from helios_map2d.relocalisation.landmarks import Landmark, landmark_score_m
from helios_map2d.relocalisation.poses import Transform2
from helios_map2d.relocalisation.state import Fix, PlaceState
from hypothesis import given, settings
from hypothesis import strategies as st

CELL_M = 0.05
Boxes = Sequence[tuple[float, float, float, float]]  # x0, y0, x1, y1 (m)
FURNITURE: Boxes = (
    (0.5, 0.5, 2.5, 1.4),
    (4.4, 0.4, 5.6, 0.9),
    (0.3, 3.0, 0.9, 4.6),
    (2.6, 3.9, 3.4, 4.7),
    (5.0, 2.2, 5.7, 3.6),
    (3.3, 0.4, 3.9, 1.2),
    (1.6, 4.4, 2.2, 4.8),
)
WALL: Boxes = ((3.0, 0.0, 3.1, 1.9), (3.0, 2.9, 3.1, 5.0))
poses = st.builds(
    Transform2, st.floats(-8, 8), st.floats(-8, 8), st.floats(-math.pi, math.pi, exclude_min=True)
)


def room(boxes: Boxes, size_m: tuple[float, float] = (6.0, 5.0)) -> OccupancyGrid:
    """A walled room with boxes in it."""
    rows, columns = (round(v / CELL_M) for v in (size_m[1], size_m[0]))
    grid = np.full((rows, columns), FREE, np.int8)
    grid[[0, -1], :], grid[:, [0, -1]] = OCCUPIED, OCCUPIED
    for x0, y0, x1, y1 in boxes:
        grid[round(y0 / CELL_M) : round(y1 / CELL_M), round(x0 / CELL_M) : round(x1 / CELL_M)] = (
            OCCUPIED
        )
    return OccupancyGrid(grid, (0.0, 0.0), CELL_M)


def seen_from(
    whole: OccupancyGrid, T_here_whole: Transform2, centre: tuple[float, float], radius_m: float
) -> OccupancyGrid:
    """What another frame knows of a map: a disc of it, turned and shifted."""
    x, y = T_here_whole.of(np.array([centre]))[0]
    half = math.ceil(radius_m / CELL_M)
    origin = (x - half * CELL_M, y - half * CELL_M)
    grid = OccupancyGrid(np.full((2 * half, 2 * half), UNKNOWN, np.int8), origin, CELL_M)
    centres = grid.centres_of(np.ones_like(grid.occupancy, bool))
    there = T_here_whole.inverse.of(centres)
    column, row = np.floor((there - whole.origin_m) / CELL_M).astype(int).T
    rows, columns = whole.occupancy.shape
    on = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    on &= np.hypot(*(there - centre).T) < radius_m
    values = np.full(len(centres), UNKNOWN, np.int8)
    values[on] = whole.occupancy[row[on], column[on]]
    return OccupancyGrid(values.reshape(grid.occupancy.shape), origin, CELL_M)


def found(whole: OccupancyGrid, present: OccupancyGrid, **more) -> Alignment:
    stored = prepared(whole, more.pop("stored", ()))
    assert stored is not None
    out = align(stored, present, more.pop("landmarks", ()))
    assert out is not None
    return out


@settings(max_examples=8, deadline=None)
@given(T_here_whole=poses)
def test_a_part_of_the_home_is_found_in_any_frame(T_here_whole: Transform2) -> None:
    whole = room((*FURNITURE, *WALL))
    one = found(whole, seen_from(whole, T_here_whole, (3.4, 2.6), 2.4))
    assert one.reason == ""
    away_m, turned_rad = one.T_stored_present.difference(
        T_here_whole.inverse, T_here_whole.of(np.array([[3.4, 2.6]]))[0]
    )
    assert away_m < 0.05
    assert turned_rad < math.radians(1)


@settings(max_examples=4, deadline=None)
@given(T=poses)
def test_a_turned_stored_map_gives_the_turned_place(T: Transform2) -> None:
    """Equivariance: to move the stored map by T moves the result by T."""
    whole = room((*FURNITURE, *WALL))
    present = seen_from(whole, Transform2(1.0, -2.0, 0.7), (3.4, 2.6), 2.4)
    moved = seen_from(whole, T, (3.0, 2.5), 4.0)
    there = found(moved, present).T_stored_present
    expected = T @ found(whole, present).T_stored_present
    away_m, turned_rad = there.difference(
        expected, Transform2(1.0, -2.0, 0.7).of(np.array([[3.4, 2.6]]))[0]
    )
    assert away_m < 0.05
    assert turned_rad < math.radians(1)


@pytest.mark.parametrize("size_m", [(5.0, 5.0), (6.0, 4.0)], ids=["square", "rectangle"])
def test_no_place_in_an_empty_symmetric_room(size_m: tuple[float, float]) -> None:
    whole = room((), size_m)
    middle = (size_m[0] / 2, size_m[1] / 2)
    one = found(whole, seen_from(whole, Transform2(2.0, 1.0, 0.5), middle, 5.0))
    assert "another place fits almost as well" in one.reason


def test_no_place_in_a_featureless_corridor() -> None:
    whole = room((), (16.0, 2.0))
    one = found(whole, seen_from(whole, Transform2(0.0, 0.0, 1.0), (8.0, 1.0), 2.5))
    assert "another place fits almost as well" in one.reason


def test_no_place_in_a_room_with_furniture_on_both_sides_alike() -> None:
    half: Boxes = ((0.5, 0.5, 2.0, 1.4), (4.0, 0.3, 5.0, 0.9), (0.2, 2.0, 0.8, 3.0))
    turned: Boxes = [(6 - x1, 5 - y1, 6 - x0, 5 - y0) for x0, y0, x1, y1 in half]
    whole = room((*half, *turned))
    one = found(whole, seen_from(whole, Transform2(1.0, 1.0, 0.3), (3.0, 2.5), 5.0))
    assert "another place fits almost as well" in one.reason


def test_objects_tell_the_sides_of_a_symmetric_room_apart() -> None:
    whole, T = room(()), Transform2(2.0, 1.0, 0.5)
    places = [(1.0, 1.0, 0.8), (2.0, 4.0, 0.8), (5.2, 1.4, 0.5), (4.0, 0.6, 0.5), (0.5, 2.5, 0.4)]
    names = ["mug", "lamp", "bed", "chair", "sink"]
    stored = [Landmark(p, {name: 0.9}) for p, name in zip(places, names, strict=True)]
    present = [
        Landmark((*T.of(np.array([p[:2]]))[0].tolist(), p[2]), {name: 0.9})
        for p, name in zip(places, names, strict=True)
    ]
    view = seen_from(whole, T, (3.0, 2.5), 5.0)
    one = found(whole, view, stored=stored, landmarks=present)
    away_m, turned_rad = one.T_stored_present.difference(T.inverse, T.of(np.array([[3.0, 2.5]]))[0])
    assert away_m < 0.1
    assert turned_rad < math.radians(2)
    assert one.landmark_m > 3


def test_one_object_alone_does_not_decide() -> None:
    whole, T = room(()), Transform2(2.0, 1.0, 0.5)
    mug = Landmark((1.0, 1.0, 0.8), {"mug": 1.0})
    there = Landmark((*T.of(np.array([[1.0, 1.0]]))[0].tolist(), 0.8), {"mug": 1.0})
    view = seen_from(whole, T, (3.0, 2.5), 5.0)
    assert found(whole, view, stored=[mug], landmarks=[there]).reason


def test_another_home_is_refused() -> None:
    whole = room((*FURNITURE, *WALL))
    other = room(((2.0, 2.0, 3.0, 3.0), (0.2, 0.2, 1.0, 2.0), (4.0, 3.5, 6.8, 4.2)), (7.0, 4.5))
    for centre in ((3.0, 2.0), (5.0, 2.5), (1.5, 3.0)):
        assert found(whole, seen_from(other, Transform2(0.0, 0.0, 0.4), centre, 2.5)).reason


def test_too_small_a_view_is_refused() -> None:
    whole = room((*FURNITURE, *WALL))
    one = found(whole, seen_from(whole, Transform2(0.0, 0.0, 0.0), (0.6, 2.2), 0.8))
    assert one.reason


def test_an_empty_map_has_nothing_to_compare() -> None:
    nothing = OccupancyGrid(np.full((20, 20), UNKNOWN, np.int8), (0.0, 0.0), CELL_M)
    assert prepared(nothing) is None
    stored = prepared(room(FURNITURE))
    assert stored is not None
    assert align(stored, nothing) is None


def test_landmarks_pair_each_object_once() -> None:
    same = Transform2(0.0, 0.0, 0.0)
    mug = Landmark((1.0, 1.0, 0.8), {"mug": 1.0})
    assert landmark_score_m([mug], [mug, mug], same) == pytest.approx(1.0)
    assert landmark_score_m([mug], [Landmark((1.0, 1.0, 0.8), {"bed": 1.0})], same) == 0.0
    assert landmark_score_m([mug], [Landmark((1.0, 1.0, 2.0), {"mug": 1.0})], same) == 0.0


@given(a=poses, b=poses, x=st.floats(-5, 5), y=st.floats(-5, 5))
def test_transforms_form_a_group(a: Transform2, b: Transform2, x: float, y: float) -> None:
    point = np.array([[x, y]])
    assert np.allclose((a @ b).of(point), a.of(b.of(point)))
    assert np.allclose(a.inverse.of(a.of(point)), point)


# --- a fix over time ------------------------------------------------------------------------------
def passing(T: Transform2, reason: str = "") -> Alignment:
    whole = room((*FURNITURE, *WALL))
    one = found(whole, seen_from(whole, T.inverse, (3.4, 2.6), 2.4))
    return Alignment(one.fit, one.landmark_m, one.score_m, one.second_m, reason)


HERE = np.zeros(2)


def test_a_fix_needs_two_alignments_on_new_data() -> None:
    one = passing(Transform2(1.0, 2.0, 0.3))
    first = Fix().after(one, 10.0, HERE)
    assert first.state is PlaceState.TENTATIVE
    assert first.after(one, 10.2, HERE).state is PlaceState.TENTATIVE
    assert first.after(one, 11.0, HERE).state is PlaceState.RELOCALISED


def test_a_failed_alignment_starts_over() -> None:
    one = passing(Transform2(1.0, 2.0, 0.3))
    first = Fix().after(one, 10.0, HERE)
    assert first.after(passing(Transform2(1.0, 2.0, 0.3), "refused"), 11.0, HERE) == Fix()
    assert first.after(None, 11.0, HERE) == Fix()


def test_two_alignments_that_disagree_are_no_fix() -> None:
    first = Fix().after(passing(Transform2(1.0, 2.0, 0.3)), 10.0, HERE)
    assert first.after(passing(Transform2(1.5, 2.0, 0.3)), 12.0, HERE).state is PlaceState.TENTATIVE
