"""The preset `vlfm-compatible`, which follows VLFM's rules."""

from __future__ import annotations

import math

import numpy as np
from helios_map2d.epoch_map import EpochMap
from helios_map2d.layers.explored_area import part_around, seen_of_cone
from helios_map2d.layers.parameters import MapRules
from helios_map2d.settings import Settings
from map2d_scene import Walk, room, table


def mapped(rules: MapRules, walk: Walk) -> EpochMap:
    state = EpochMap(rules, (1.0, 1.5), 0.0)
    state.integrate_frame(walk.frame(1.0, 1.5, 0.0))
    return state


def rules(*flags: str) -> MapRules:
    return Settings.load(["--size-cells", "400", *flags]).rules(5.0, 0.2)


def test_the_view_cone_is_explored_up_to_known_obstacles_even_without_depth() -> None:
    walk = Walk([*room(), *table(2.5, 1.5)])
    usual, vlfm = mapped(rules(), walk), mapped(rules("--preset", "vlfm-compatible"), walk)
    before_its_feet = vlfm.stack.grid.cell_of(1.3, 1.5)
    assert vlfm.stack.search.explored[before_its_feet] == 1
    assert usual.stack.occupancy.floor_seen[usual.stack.grid.cell_of(1.3, 1.5)] == 0
    behind_the_table = vlfm.stack.grid.cell_of(3.4, 1.5)
    assert vlfm.stack.search.explored[behind_the_table] == 0
    beside_an_obstacle = vlfm.stack.grid.cell_of(2.0, 1.5)
    assert vlfm.stack.search.explored[beside_an_obstacle] == 0


def test_occupied_cells_are_never_freed() -> None:
    walk = Walk([*room(), *table(2.5, 1.5)])
    state = mapped(rules("--preset", "vlfm-compatible"), walk)
    before = state.stack.occupancy.occupancy == 100
    walk.blocks = room()
    for _ in range(4):
        state.integrate_frame(walk.frame(1.0, 1.5, 0.0))
    assert (state.stack.occupancy.occupancy[before] == 100).all()


def test_only_the_explored_part_around_the_robot_is_kept_with_its_holes_filled() -> None:
    explored = np.zeros((40, 40), np.uint8)
    explored[5:15, 5:15] = 1
    explored[8:11, 8:11] = 0
    explored[25:35, 25:35] = 1
    got = part_around(explored.copy(), (7, 7))
    assert got[5:15, 5:15].all()
    assert got.sum() == 100
    # No part contains this cell, so the nearest part stays.
    assert part_around(explored.copy(), (24, 30))[30, 30] == 1


def test_the_explored_area_does_not_depend_on_the_viewing_direction() -> None:
    areas = []
    for k in range(4):
        state = EpochMap(rules("--preset", "vlfm-compatible"), (0.0, 0.0), 0.0)
        state.integrate_frame(Walk([]).frame(0.0, 0.0, k * math.pi / 2))
        areas.append(int(state.stack.search.explored.sum()))
    assert max(areas) - min(areas) < 0.02 * max(areas)
    assert min(areas) * 0.025**2 > 10


def test_an_obstacle_hides_only_the_part_of_the_cone_behind_it() -> None:
    blocked = np.zeros((200, 200), np.uint8)
    blocked[95:106, 130:136] = 1
    seen = seen_of_cone(blocked, (100, 100), 0.0, math.radians(30), 80.0)
    assert seen[100, 120] == 1
    assert seen[100, 130:175].sum() == 0
    assert seen[120, 150] == 1
    assert seen[100, 90] == 0  # behind the camera
    assert seen[100, 185] == 0  # beyond the reach
