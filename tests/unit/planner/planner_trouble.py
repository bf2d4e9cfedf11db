"""Inject failures into a fake world, and run robots in it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from helios_core.robot import Action, ActionResult
from helios_planner.instruction.parser import parse
from helios_planner.navigation.base_controller import BaseController
from helios_planner.settings import Settings
from helios_planner.tasks.mission import Mission
from planner_flat import MOVE
from planner_world import FakeWorld

Trouble = Callable[[FakeWorld, Action], ActionResult | None]


def troubled(world: FakeWorld, trouble: Trouble) -> FakeWorld:
    """Let `trouble` replace the world's actions, or run beside them."""
    honest = world._do
    world._do = lambda action: trouble(world, action) or honest(action)
    return world


def bring(world: FakeWorld, **settings: Any) -> None:
    """Run the mission that brings the mug."""
    Mission(world, parse(MOVE), Settings(**settings)).run()


def legs_in(world: FakeWorld) -> BaseController:
    """Return the base controller of a robot that has looked around."""
    base = BaseController(world, Settings())
    base.look_around()
    return base


def once(what: Callable[[], None], when: Callable[[], bool]) -> Trouble:
    """Call `what` beside the first action at which `when` holds."""
    done: list[bool] = []

    def trouble(_: FakeWorld, action: Action) -> None:
        if not done and when():
            done.append(True)
            what()

    return trouble
