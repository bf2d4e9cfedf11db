"""Things that looked wrong in the hand are not picked again for the same name in later tasks."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import pytest
from helios_core.types import WorldId
from helios_planner.instruction.parser import parse
from helios_planner.refuted_things import KEPT_S, RefutedThing, RefutedThings
from helios_planner.settings import Settings
from helios_planner.task import TaskFailed
from helios_planner.tasks.mission import Mission
from helios_planner.tasks.store import Store
from planner_bus import ended, submit
from planner_eye import ROBOT
from planner_flat import MOVE, coffee_table, counter, flat, mug
from planner_group import PlannerGroup
from planner_things import Thing
from planner_world import FakeWorld
from test_planner_hand_check import DOUBTFUL, RIGHT, WRONG

HERE = (1.0, 2.0, 0.5)
SHOWING = replace(ROBOT, show_base_m=(0.5, 0.0, 1.1))


def thing(name: str = "mug", center_m: tuple[float, float, float] = HERE, ago_s: float = 0.0):
    return RefutedThing(name, center_m, 0.2, False, time.time() - ago_s)


def world_of(*mugs: Thing) -> FakeWorld:
    world = flat([coffee_table(), counter(), *mugs])
    world.description = SHOWING
    return world


def run(world: FakeWorld, known: RefutedThings, absent_from: float = 1.0) -> str:
    mission = Mission(world, parse(MOVE), Settings(hand_sides=6, absent_from=absent_from))
    mission.hand.refuted = known
    try:
        return mission.run()
    except TaskFailed as failure:
        return failure.message


@pytest.mark.parametrize("look", [WRONG, DOUBTFUL])
def test_a_later_task_prefers_another_thing_to_one_that_looked_wrong(look) -> None:
    wrong = mug(3)
    wrong.in_hand = WRONG
    world, known = world_of(wrong), RefutedThings()
    assert "put the mug" not in run(world, known)
    assert world.retired == [3]
    wrong.in_hand = look
    other = mug(4, 6.7, 5.6)
    other.in_hand = RIGHT
    world.things[4] = other
    assert "put the mug on the counter" in run(world, known)
    assert world.retired == [3, 4]
    assert world.released is other


@pytest.mark.parametrize("absent_from", [1.0, 0.5, 0.1])
def test_a_later_task_looks_again_if_nothing_better_is_found_and_then_forgets(
    absent_from: float,
) -> None:
    only = mug(3)
    only.in_hand = WRONG
    world, known = world_of(only), RefutedThings()
    run(world, known)
    assert [t.class_name for t in known.of("mug")] == ["mug"]
    only.in_hand = RIGHT  # somebody put the right mug there
    assert "put the mug on the counter" in run(world, known, absent_from)
    assert world.retired == [3, 3]
    assert known.of("mug") == []


@pytest.mark.timeout(180)
def test_a_planner_that_was_started_again_remembers_it(group: PlannerGroup) -> None:
    wrong, other = mug(3), mug(4, 6.7, 5.6)
    wrong.in_hand, other.in_hand = WRONG, RIGHT
    world = world_of(wrong)
    group.peers(world)
    bus = group.planner(hand_sides=6)
    assert ended(bus, submit(bus, MOVE).id).state == "failed"
    assert world.retired == [3]
    group.planners[-1].close()
    world.things[4] = other
    bus = group.planner(hand_sides=6)
    assert ended(bus, submit(bus, MOVE).id).state == "succeeded"
    assert world.retired == [3, 4]


def test_a_place_has_one_entry_for_each_name_and_entries_expire() -> None:
    saved: list[list[RefutedThing]] = []
    known = RefutedThings([thing(ago_s=KEPT_S + 60)], saved.append)
    assert known.of("mug") == []
    known.add(thing())
    known.add(thing(center_m=(1.05, 2.0, 0.5)))
    known.add(thing("glass"))
    assert len(known.of("mug")) == 1
    assert len(known.of("glass")) == 1
    known.forget("glass", (5.0, 5.0, 0.5))
    assert len(saved) == 3
    known.forget("mug", HERE)
    assert (known.of("mug"), len(known.of("glass")), len(saved)) == ([], 1, 4)


def test_entries_that_are_too_old_or_of_the_future_are_dropped_at_the_next_change() -> None:
    saved: list[list[RefutedThing]] = []
    old = [thing("can", ago_s=KEPT_S + 60), thing("pot", ago_s=-KEPT_S - 60)]
    known = RefutedThings(old, saved.append)
    assert known.of("pot") == []
    known.add(thing())
    assert [kept.class_name for kept in saved[-1]] == ["mug"]


def test_the_store_keeps_them_over_a_restart_for_each_world_until_they_are_too_old(
    tmp_path: Path,
) -> None:
    here, there = WorldId("", 1, "dock"), WorldId("boot", 1)
    store = Store(tmp_path)
    things = [thing(ago_s=5), thing("glass")]
    assert store.keep_refuted(here, things)
    assert store.keep_refuted(there, [thing(ago_s=KEPT_S + 60)])
    store.close()
    again = Store(tmp_path)
    assert again.refuted(here) == things
    assert again.refuted(WorldId("", 2, "dock")) == []
    assert again.keep_refuted(here, things[1:])
    assert again.refuted(here) == things[1:]
    assert again.refuted(there) == []
    again.close()
