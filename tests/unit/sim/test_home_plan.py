"""Tests floor plans and free space."""

import math

import numpy as np
from helios_sim.home import PRESETS, floor_plans, freespace
from helios_sim.home.freespace import Obstacle
from helios_sim.home.home_types import Doorway, Room
from hypothesis import given, settings
from hypothesis import strategies as st

DEMO = PRESETS["demo-v1"]


@given(st.integers(0, 2000))
@settings(max_examples=60, deadline=None)
def test_rooms_tile_the_home_and_doorways_connect_them(seed: int) -> None:
    drawn = floor_plans.draw_plan(np.random.default_rng(seed), DEMO)
    if drawn is None:
        return
    rooms, doorways = drawn
    x0, y0, x1, y1 = floor_plans.bounds_of(rooms)
    wall = 2 * floor_plans.WALL_HALF_M
    area = (x1 - x0 - wall) * (y1 - y0 - wall)
    assert math.isclose(sum(room.area_m2 for room in rooms), area, rel_tol=1e-9)
    joined = {0}
    for _ in rooms:
        joined |= {b for door in doorways for b in door.rooms if joined & set(door.rooms)}
    assert joined == set(range(len(rooms)))
    for room in rooms:
        assert min(room.x1 - room.x0, room.y1 - room.y0) >= DEMO.min_room_side_m - 0.01
    for door in doorways:
        for side in (-0.2, 0.2):
            x, y = (door.x + side, door.y) if door.axis == 0 else (door.x, door.y + side)
            assert any(rooms[index].contains(x, y) for index in door.rooms)


def test_a_doorway_leaves_its_width_open_and_a_header_above() -> None:
    rooms = (Room(0, "kitchen", 0, 0, 4, 3), Room(1, "office", 4, 0, 7, 3))
    door = Doorway(4.0, 1.5, 1.2, 0, (0, 1))
    middle = [piece for piece in floor_plans.wall_pieces(rooms, (door,)) if piece.at_m == 4.0]
    standing = sorted((p.lo_m, p.hi_m) for p in middle if p.z0_m == 0.0)
    assert [round(v, 6) for pair in standing for v in pair] == [-0.06, 0.9, 2.1, 3.06]
    (header,) = (p for p in middle if p.z0_m > 0)
    assert (header.lo_m, header.hi_m, header.z0_m) == (0.9, 2.1, floor_plans.DOOR_HEIGHT_M)


def distance_by_hand(x: float, y: float, rect: Obstacle) -> float:
    """Readable reference of `freespace.distance_m` for one point."""
    dx, dy = x - rect.x, y - rect.y
    along = math.cos(rect.yaw_rad) * dx + math.sin(rect.yaw_rad) * dy
    across = -math.sin(rect.yaw_rad) * dx + math.cos(rect.yaw_rad) * dy
    return math.hypot(max(abs(along) - rect.half_x, 0), max(abs(across) - rect.half_y, 0))


@given(
    st.floats(0, 3), st.floats(0, 2), st.floats(0.05, 1), st.floats(0.05, 1), st.floats(-3.2, 3.2)
)
@settings(max_examples=40, deadline=None)
def test_clearance_is_the_distance_to_the_nearest_rectangle(
    x: float, y: float, half_x: float, half_y: float, yaw: float
) -> None:
    bounds = (0.0, 0.0, 3.0, 2.0)
    blocked = [Obstacle(x, y, half_x, half_y, yaw), Obstacle(2.5, 1.0, 0.1, 0.5, 0.0)]
    clearance = freespace.clearance_m(bounds, blocked, 0.25)
    xs, ys = freespace.cell_centers(bounds, 0.25)
    assert clearance.shape == (8, 12)
    for row, cy in enumerate(ys):
        for column, cx in enumerate(xs):
            wanted = min(distance_by_hand(cx, cy, rect) for rect in blocked)
            assert math.isclose(clearance[row, column], wanted, abs_tol=1e-9)


def test_the_largest_region_does_not_connect_through_corners() -> None:
    free = np.array([[1, 1, 0], [1, 1, 0], [0, 0, 1]], dtype=bool)
    assert freespace.largest_region(free).sum() == 4
