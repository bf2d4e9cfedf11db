"""The whole flow over a world of plain arrays."""

from __future__ import annotations

from helios_planner.flow import Mission
from helios_planner.instruction import parse
from helios_planner.settings import Settings
from planner_world import coffee_table, counter, flat, mug

TASK = parse("Move the mug from the coffee table to the counter")


def test_a_mug_in_another_room_is_brought_to_the_counter_without_contact() -> None:
    world = flat([coffee_table(), counter(), mug()])
    Mission(world, TASK, Settings()).run()
    assert world.contacts == 0
    assert world.released is not None
    x, y, _ = world.released.center_m
    assert 1.2 < x < 3.2
    assert 6.3 < y < 6.95
