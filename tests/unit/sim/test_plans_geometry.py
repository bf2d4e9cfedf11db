"""Geometry of plans: arcs, corners, cut-outs, floors, and the turn from the page to the home."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helios_sim.home.home_types import CollisionPrimitive, Room, Shape, in_polygon
from helios_sim.plans import floor_area
from helios_sim.plans.piece_shapes import fitted
from helios_sim.plans.plan_types import DrawnRoom, Opening, Wall
from helios_sim.plans.wall_blocks import axis_points, crossing, cut, wall_of, whole_blocks
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from tests.unit.sim.plan_files import door, drawn, piece

METRES = st.floats(-20, 20)
ANGLES = st.floats(-math.pi, math.pi)


def _wall(start: tuple[float, float], end: tuple[float, float], arc: float = 0.0) -> Wall:
    return Wall(start, end, 0.2, 2.5, 2.5, arc)


@given(
    x=METRES,
    y=METRES,
    turn=ANGLES,
    chord=st.floats(0.1, 10),
    arc=st.floats(0.1, 6.0),
    sign=st.sampled_from([-1, 1]),
)
def test_an_arc_runs_from_start_to_end_on_one_circle(
    x: float, y: float, turn: float, chord: float, arc: float, sign: int
) -> None:
    end = (x + chord * math.cos(turn), y + chord * math.sin(turn))
    points = np.array(axis_points(_wall((x, y), end, sign * arc)))
    assert points[0] == pytest.approx((x, y), abs=1e-6)
    assert points[-1] == pytest.approx(end, abs=1e-6)
    radius = chord / 2 / math.sin(arc / 2)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    count = len(steps)
    assert steps == pytest.approx(2 * abs(radius) * math.sin(arc / count / 2), rel=1e-6)


def test_an_arc_bulges_as_sweet_home_3d_draws_it() -> None:
    # Sweet Home 3D draws the wall (800, 100) to (800, 400) with arcExtent π/2 and thickness 20
    # through x = 872 cm on the page, right of its ends.
    points = axis_points(_wall((8.0, -1.0), (8.0, -4.0), -math.pi / 2))
    assert max(x for x, _ in points) == pytest.approx(8.62, abs=0.02)
    assert min(x for x, _ in points) == pytest.approx(8.0, abs=1e-6)


@given(turn=ANGLES, along=st.floats(-1.0, 1.0), width=st.floats(0.6, 1.4), back=st.booleans())
def test_a_door_takes_its_own_width_out_of_its_wall(
    turn: float, along: float, width: float, back: bool
) -> None:
    cos, sin = math.cos(turn), math.sin(turn)
    (block,) = whole_blocks([_wall((-2 * cos, -2 * sin), (2 * cos, 2 * sin))])
    yaw = turn + math.pi * back
    opening = Opening("", "door", along * cos, along * sin, yaw, width, 0.2, 2.0, 0.0)
    pieces = cut([block], [opening])
    low = sum(p.length_m for p in pieces if p.z0_m == 0.0)
    assert low == pytest.approx(4.0 - width, abs=1e-6)
    above = [p for p in pieces if p.z0_m > 0.0]
    assert sum(p.length_m for p in above) == pytest.approx(width, abs=1e-6)
    assert all(p.z0_m == pytest.approx(2.0) and p.z1_m == 2.5 for p in above)
    middle = [p for p in pieces if p.z0_m == 0.0 and _covers(p, along * cos, along * sin)]
    assert not middle


@given(st.floats(0.05, 1.5), st.booleans(), st.floats(-0.08, 0.08))
def test_a_door_lies_in_its_wall_whichever_way_the_wall_was_drawn(
    turn: float, back: bool, off_m: float
) -> None:
    cos, sin = math.cos(turn), math.sin(turn)
    way = -2 if back else 2
    blocks = whole_blocks([_wall((-way * cos, -way * sin), (way * cos, way * sin))])
    yaw = turn - 0.05  # drawn a little oblique to its wall
    opening = Opening("", "door", -off_m * sin, off_m * cos, yaw, 0.9, 0.2, 2.0, 0.0)
    found = wall_of(opening, blocks)
    assert found is not None
    x, y, _ = found
    assert abs(y * cos - x * sin) < 0.01  # on the wall's axis


def _covers(block: object, x: float, y: float) -> bool:
    rect = block.footprint  # type: ignore[attr-defined]
    return bool(in_polygon(tuple(floor_area.corners_of(rect)), x, y))


def test_a_door_across_a_wall_or_beside_it_cuts_nothing() -> None:
    (block,) = whole_blocks([_wall((0, 0), (4, 0))])
    across = Opening("", "door", 2.0, 0.0, math.pi / 2, 0.9, 0.2, 2.0, 0.0)
    assert crossing(block, across) is None
    assert crossing(block, replace(across, yaw_rad=0.0, y=1.0)) is None
    assert crossing(block, replace(across, yaw_rad=0.0)) == pytest.approx((-0.45, 0.45))


def test_walls_that_meet_close_their_corner() -> None:
    blocks = whole_blocks([_wall((0, 0), (4, 0)), _wall((4, 0), (4, 3))])
    corner = (4.05, -0.05)  # outside both axes, inside the square between the faces
    assert any(_covers(block, *corner) for block in blocks)


@given(
    st.lists(st.tuples(st.floats(0.5, 3), st.floats(0, 2 * math.pi)), min_size=3, max_size=9),
    st.floats(-5, 5),
    st.floats(-5, 5),
)
def test_a_point_is_in_a_star_shaped_outline_by_its_angle_and_distance(
    rays: list[tuple[float, float]], x: float, y: float
) -> None:
    rays = sorted(rays, key=lambda ray: ray[1])
    gaps = np.diff([*(a for _, a in rays), rays[0][1] + 2 * math.pi])
    if gaps.max() > math.pi - 0.1 or gaps.min() < 0.05:
        return
    outline = tuple((r * math.cos(a), r * math.sin(a)) for r, a in rays)
    nearest, farthest = min(r for r, _ in rays) * math.cos(gaps.max() / 2), max(r for r, _ in rays)
    away = math.hypot(x, y)
    inside = bool(in_polygon(outline, x, y))
    if away > farthest + 1e-9:
        assert not inside
    if away < nearest - 1e-9:
        assert inside


def test_the_area_of_a_room_is_that_of_its_outline() -> None:
    outline = ((0.0, 0.0), (4.0, 0.0), (4.0, 1.0), (1.0, 1.0), (1.0, 3.0), (0.0, 3.0))
    room = Room(0, "room", 0.0, 0.0, 4.0, 3.0, outline)
    assert room.area_m2 == pytest.approx(6.0)
    assert room.contains(0.5, 2.5)
    assert not room.contains(3.0, 2.0)


def _square(x0: float, y0: float, x1: float, y1: float) -> list[Wall]:
    corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)]
    return [_wall(a, b) for a, b in itertools.pairwise(corners)]


def test_walls_without_a_drawn_room_make_a_room() -> None:
    area = floor_area.floor_area((), whole_blocks(_square(0, 0, 4, 3)))
    (room,) = area.rooms
    x, y = np.array(room.outline).T
    assert (x.min(), x.max(), y.min(), y.max()) == pytest.approx((0.1, 3.9, 0.1, 2.9), abs=0.06)
    assert not area.closing


def test_a_terrace_is_outdoors_and_a_room_with_an_open_side_is_closed() -> None:
    walls = _square(0, 0, 4, 3)
    inside = DrawnRoom("Room", ((0.1, 0.1), (3.9, 0.1), (3.9, 2.9), (0.1, 2.9)))
    terrace = DrawnRoom("Terrace", ((4.1, 0.0), (8.0, 0.0), (8.0, 3.0), (4.1, 3.0)))
    area = floor_area.floor_area((inside, terrace), whole_blocks(walls))
    assert [room.name for room in area.outdoors] == ["Terrace"]
    assert not area.is_floor(6.0, 1.5)
    open_side = floor_area.floor_area((inside,), whole_blocks(walls[:1] + walls[2:]))
    assert sum(block.length_m for block in open_side.closing) == pytest.approx(2.8, abs=0.4)


@given(st.lists(st.lists(st.booleans(), min_size=6, max_size=6), min_size=1, max_size=8))
def test_rectangles_cover_a_mask_once(rows: list[list[bool]]) -> None:
    mask = np.array(rows)
    count = np.zeros(mask.shape, int)
    for r0, c0, r1, c1 in floor_area._rectangles(mask):
        count[r0:r1, c0:c1] += 1
    assert (count == mask).all()


@given(st.floats(0.2, 3), st.floats(0.2, 3), st.floats(0.2, 3), ANGLES)
def test_a_fitted_solid_fills_the_same_share_of_the_shape(
    sx: float, sy: float, sz: float, tilt: float
) -> None:
    quat = (math.cos(tilt / 2), 0.0, 0.0, math.sin(tilt / 2))
    upright = CollisionPrimitive("box", (0.2, 0.3, 0.4), (0.1, 0.0, 0.5))
    tilted = replace(upright, quat=quat)
    shape = Shape((1.0, 1.0, 1.0), (), (upright, tilted), (0.5, 0.5, 0.5))
    same, turned = fitted(shape, (sx, sy, sz)).collision_primitives
    assert same.half_extent == pytest.approx((0.2 * sx, 0.3 * sy, 0.4 * sz))
    assert same.center == pytest.approx((0.1 * sx, 0.0, 0.5 * sz))
    assert turned.half_extent[2] == pytest.approx(0.4 * sz)
    low, high = sorted((sx, sy))
    assert low - 1e-9 <= turned.half_extent[0] / 0.2 <= high + 1e-9


# --- from the page to the home ----------------------------------------------------------------
def test_nothing_is_mirrored(tmp_path: Path) -> None:
    # On the page: the sofa at the left wall with its back to it, the shelf at the upper wall, the
    # door in the lower half of the middle wall.
    home = drawn(
        tmp_path / "a.sh3d",
        piece("Sofa", 60, 150, (150, 87, 87), angle=3 * math.pi / 2),
        piece("Bookcase", 700, 30, (100, 34, 200)),
        door(400, 400),
    )
    by_class = {item.class_name: item for item in (*home.home.receptacles, *home.home.fixtures)}
    sofa, shelf = by_class["sofa"], by_class["bookcase"]
    assert (sofa.x, sofa.y) == pytest.approx((0.6, -1.5))
    assert (shelf.x, shelf.y) == pytest.approx((7.0, -0.3))
    back = (-math.sin(sofa.yaw_rad), math.cos(sofa.yaw_rad))  # +y of the furniture frame
    assert back == pytest.approx((-1.0, 0.0), abs=1e-6)
    assert (-math.sin(shelf.yaw_rad), math.cos(shelf.yaw_rad)) == pytest.approx((0.0, 1.0))
    (opening,) = home.doors.open_doors
    assert (opening.x, opening.y) == pytest.approx((4.0, -4.0))
    free, origin = home.home.free_space(0.3)

    def is_free(x: float, y: float) -> bool:
        return bool(free[int((y - origin[1]) / 0.05), int((x - origin[0]) / 0.05)])

    assert is_free(4.0, -4.0)
    assert not is_free(4.0, -1.0)


@settings(max_examples=8, deadline=None, phases=(Phase.generate,))
@given(angle=st.floats(0, 2 * math.pi), x=st.floats(150, 250), y=st.floats(150, 350))
def test_corners_of_furniture_are_where_the_page_has_them(
    tmp_path_factory: pytest.TempPathFactory, angle: float, x: float, y: float
) -> None:
    folder = tmp_path_factory.mktemp("corners")
    home = drawn(folder / "a.sh3d", piece("Table", x, y, (120, 60, 75), angle=angle))
    placed = home.furnishing.pieces[0]
    # The plan turns a point (u, v), v downwards, clockwise by the angle.
    page = [
        (
            (x + u * math.cos(angle) - v * math.sin(angle)) / 100,
            -(y + u * math.sin(angle) + v * math.cos(angle)) / 100,
        )
        for u, v in ((60, -30), (-60, -30), (-60, 30), (60, 30))
    ]
    ours = floor_area.corners_of(placed.footprint)
    assert np.array(ours) == pytest.approx(np.array(page), abs=1e-6)


def test_a_model_keeps_left_and_right_and_turns_its_front_to_the_room(tmp_path: Path) -> None:
    # In the file x is right, y up and z the front: a post on the left (-x), a board in front (+z).
    def box(x0: float, x1: float, y1: float, z0: float, z1: float, n: int) -> str:
        rows = [f"v {x} {y} {z}" for x in (x0, x1) for y in (0, y1) for z in (z0, z1)]
        faces = ((1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4))
        rows += ["f " + " ".join(str(i + 8 * n) for i in face) for face in faces]
        return "\n".join(rows)

    obj = "\n".join((box(-0.5, -0.4, 1.0, -0.2, 0.2, 0), box(-0.5, 0.5, 0.3, 0.1, 0.2, 1)))
    home = drawn(
        tmp_path / "a.sh3d",
        piece("Thing", 200, 250, (100, 40, 100), model="7"),
        entries={"7": obj.encode()},
    )
    placed = home.furnishing.pieces[0]
    assert placed.source == "own model"
    vertices = np.concatenate([v.mesh.vertices for v in placed.shape.visuals])
    tall = vertices[vertices[:, 2] > 0.5]
    assert tall[:, 0].max() < -0.3  # the post stays on the left
    low_right = vertices[(vertices[:, 0] > 0.3) & (vertices[:, 2] < 0.4)]
    assert low_right[:, 1].max() < 0.0  # the front is at -y
