"""Whether the end of a task contradicts the truth, and whether a fault has anything to hit."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helios_chaos.tasks import Home, TaskPlayer, moved_as_told
from helios_client.answer_types import Task
from helios_core import proto as pb
from helios_core.codec import state_to_proto
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import TRUTH_OBJECTS, WORLD_STATE
from helios_core.types import RobotState

MOVE = "Move the mug from the desk to the bed"
NAMES = {"desk_0": "desk", "bed_0": "bed", "mug_0": "mug", "cup_0": "cup"}


def home(mug_on: str, cup_on: str = "desk_0") -> Home:
    return Home({"mug_0": ("mug", mug_on), "cup_0": ("cup", cup_on)}, NAMES)


@pytest.mark.parametrize(
    ("after", "is_there"),
    [
        (home("bed_0"), True),
        (home("desk_0"), False),
        (home(""), False),
        (home("desk_0", "bed_0"), False),  # another thing
    ],
)
def test_a_move_is_done_if_a_thing_of_the_class_went_to_the_goal(
    after: Home, is_there: bool
) -> None:
    assert moved_as_told(MOVE, home("desk_0"), after)[0] is is_there


def test_what_the_robot_held_counts_once_it_is_on_the_goal() -> None:
    put = "Put the mug on the bed"
    assert moved_as_told(put, home(""), home("bed_0"))[0]
    assert not moved_as_told(put, home(""), home("desk_0"))[0]


def test_what_lay_on_the_goal_before_does_not_count() -> None:
    assert not moved_as_told(MOVE, home("bed_0"), home("bed_0"))[0]


def truth(mug_on: str) -> pb.TruthObjects:
    out = pb.TruthObjects()
    for name, class_name in NAMES.items():
        one = out.instances.add(name=name, class_name=class_name)
        one.graspable = class_name in ("mug", "cup")
        one.on = mug_on if name == "mug_0" else "desk_0"
    return out


@pytest.mark.parametrize(
    ("state", "mug_on", "untrue"),
    [
        ("succeeded", "bed_0", ""),
        ("succeeded", "desk_0", "moved: nothing"),
        ("failed", "desk_0", ""),
        ("failed", "bed_0", "moved: mug_0 on bed"),
        ("cancelled", "desk_0", "nobody cancelled it"),
    ],
)
def test_a_wrong_success_a_wrong_failure_and_a_strange_cancellation_are_untrue(
    state: str, mug_on: str, untrue: str
) -> None:
    hub = MemoryHub()
    world = MemoryBus(hub)
    world.serve(TRUTH_OBJECTS, lambda _: truth(mug_on))
    world.serve(WORLD_STATE, lambda _: state_to_proto(RobotState(np.eye(4))))
    no_client: Any = None
    player = TaskPlayer(no_client, MemoryBus(hub), 0)
    task = Task(id="a", state=state)
    found = player._untrue(MOVE, task, home("desk_0"))
    assert (untrue in found) if untrue else not found
    unknown = replace(task, state="failed", cause="system error")
    assert not player._untrue(MOVE, unknown, home("desk_0"))


def test_what_lies_on_a_thing_is_on_the_furniture_under_it() -> None:
    names = {"bench_0": "bench", "book_0": "book", "vase_0": "vase"}
    stacked = Home({"vase_0": ("vase", "book_0"), "book_0": ("book", "bench_0")}, names)
    assert stacked.class_under("vase_0") == "bench"
    assert stacked.class_under("book_0") == "bench"
    fallen = Home({"vase_0": ("vase", "book_0"), "book_0": ("book", "")}, names)
    assert fallen.class_under("vase_0") == ""


def test_home_is_where_the_map_began_not_where_the_player_was_made() -> None:
    hub = MemoryHub()
    world = MemoryBus(hub)
    world.serve(TRUTH_OBJECTS, lambda _: truth("desk_0"))
    world.serve(WORLD_STATE, lambda _: state_to_proto(RobotState(np.eye(4))))
    no_client: Any = None
    done, before = Task(id="a", state="succeeded"), home("desk_0")
    here = TaskPlayer(no_client, MemoryBus(hub), 0)
    assert not here._untrue("go home", done, before)
    elsewhere = TaskPlayer(no_client, MemoryBus(hub), 0, np.array([4.0, 0.0]))
    assert "4.00 m from its start" in elsewhere._untrue("go home", done, before)
