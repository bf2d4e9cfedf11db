"""Tests which object a pick takes under each pick rule."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from helios_core.errors import InvalidInput
from helios_core.robot import Pick
from helios_sim.episode_events import PickTried
from helios_sim.episode_tracker import episode_of
from helios_sim.gripper import Graspable
from helios_sim.ground_truth_solver import GroundTruthSolver
from helios_sim.home import Home
from helios_sim.manipulation import Manipulation, ManipulationFailed, PickRule, pick_rule_named
from helios_sim.service import world_of
from helios_sim.settings import Settings
from helios_sim.world import World
from pydantic import ValidationError

WRONG_CLASS = "no such thing"


@pytest.fixture
def world_with(sim_home: Home) -> Iterator[Callable[[PickRule], World]]:
    """Makes worlds in the home of seed 0 in which the robot faces the task's object."""
    made: list[World] = []

    def make(rule: PickRule) -> World:
        world = World(sim_home, episode_of(sim_home, 0), boot_id="boot", pick_rule=rule)
        made.append(world)
        assert GroundTruthSolver(world).approach(sought(world))
        return world

    yield make
    for world in made:
        world.close()


def sought(world: World) -> str:
    return next(iter(world.tracker.targets.objects))


def at(world: World, name: str, above_m: float = 0.0) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in world.position_m(name))
    return x, y, z + above_m


def test_a_wrong_object_at_the_point_is_taken_by_the_physical_rule(world_with):
    world = world_with("physical")
    assert world.act(Pick(at(world, sought(world)), WRONG_CLASS), "pick").succeeded
    assert world.held_name == sought(world)


def test_a_wrong_object_at_the_point_stays_under_the_ovmm_rule(world_with):
    world = world_with("ovmm")
    name = sought(world)
    before, steps = world.position_m(name), world.progress.steps
    done = world.act(Pick(at(world, name), WRONG_CLASS), "pick")
    assert not done.succeeded
    assert f"nothing of the class '{WRONG_CLASS}' is in reach" in done.reason
    assert world.held_name == world.state().held == ""
    assert np.allclose(world.position_m(name), before, atol=1e-3)
    assert world.progress.steps == done.steps == steps + 1
    tried = [event for event in world.events if isinstance(event, PickTried)]
    assert [(t.asked_class, t.name, t.reason) for t in tried] == [(WRONG_CLASS, "", done.reason)]
    # The right class can be picked afterwards, also with the point 0.3 m off.
    again = world.act(Pick(at(world, name, 0.3), world.episode.object_class), "again")
    assert again.succeeded, again.reason
    assert world.home.class_of(world.held_name) == world.episode.object_class


def test_an_object_out_of_view_is_not_picked_under_the_ovmm_rule(rig):
    with pytest.raises(ManipulationFailed, match=r"in reach \(0.8 m\) and in view"):
        rig("ovmm", seen=()).pick((0.5, 0.0, 0.0), "here", "mug")


THINGS = {  # name -> class, position (m)
    "mug_far": ("mug", (0.0, 2.0, 0.0)),
    "mug_near": ("mug", (0.5, 0.3, 0.0)),
    "mug_behind": ("mug", (0.5, 0.5, 0.0)),
    "bowl": ("bowl", (0.5, 0.0, 0.0)),
}
BODY = {name: k for k, name in enumerate(THINGS, 1)}


@pytest.fixture
def rig() -> Callable[..., Manipulation]:
    """Makes a Manipulation whose end effector is at the origin, with the objects of THINGS."""

    def make(rule: PickRule, seen: tuple[str, ...] = tuple(THINGS)) -> Manipulation:
        xpos = np.array([(0.0, 0.0, 9.0), *(p for _, p in THINGS.values())])
        data = SimpleNamespace(xpos=xpos, xmat=np.tile(np.eye(3).ravel(), (len(xpos), 1)))
        half_m = (0.02, 0.02, 0.02)
        things = [Graspable(name, body, 0, 0, (), half_m) for name, body in BODY.items()]
        gripper = SimpleNamespace(
            held=None, distance_m=lambda p: float(np.linalg.norm(p)), grasp=lambda _: None
        )
        ids = np.array([[0, *(BODY[name] for name in seen)]], np.int32)
        classes = {name: class_name for name, (class_name, _) in THINGS.items()}
        return Manipulation(cast(Any, data), cast(Any, gripper), things, lambda: ids, classes, rule)

    return make


@pytest.mark.parametrize(
    ("rule", "point", "class_name", "taken"),
    [
        ("physical", (0.5, 0.0, 0.0), "mug", "bowl"),
        ("ovmm", (0.5, 0.0, 0.0), "mug", "mug_near"),
        ("ovmm", (0.5, 0.0, 0.0), "Mugs", "mug_near"),
        ("ovmm", (0.5, 0.45, 0.0), "mug", "mug_behind"),
        ("ovmm", (0.0, 2.0, 0.0), "mug", "mug_behind"),  # the mug there is out of reach
        ("ovmm", (0.5, 0.3, 0.0), "bowl", "bowl"),
    ],
)
def test_the_rule_selects_the_object(rig, rule, point, class_name, taken):
    assert rig(rule).pick(point, "here", class_name).name == taken


def test_of_two_objects_of_the_class_only_the_visible_one_is_picked(rig):
    seen = ("bowl", "mug_behind")
    assert rig("ovmm", seen).pick((0.5, 0.3, 0.0), "here", "mug").name == "mug_behind"


def test_pick_rules_are_named():
    assert pick_rule_named("OVMM") == "ovmm"
    with pytest.raises(InvalidInput, match="physical or ovmm"):
        pick_rule_named("magic")


def test_the_served_world_picks_by_the_rule_of_its_settings(
    monkeypatch: pytest.MonkeyPatch, sim_home: Home
) -> None:
    """The sought object is at the point, but a pick of another class is asked for."""
    monkeypatch.setattr("helios_sim.service.generate_home", lambda *_: sim_home)
    for rule, taken in (("physical", True), ("ovmm", False)):
        monkeypatch.setenv("HELIOS_WORLD_PICK_RULE", rule)
        world = world_of(Settings.load([]))
        try:
            assert GroundTruthSolver(world).approach(sought(world))
            done = world.act(Pick(at(world, sought(world)), WRONG_CLASS), "pick")
            assert done.succeeded is taken
        finally:
            world.close()


def test_the_served_world_has_the_physical_rule_by_default_and_refuses_others() -> None:
    assert Settings.load([]).pick_rule == "physical"
    with pytest.raises(ValidationError, match="pick_rule"):
        Settings.model_validate({"pick_rule": "magic"})
