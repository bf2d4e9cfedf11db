"""Trouble for a made-up world, and the robots that meet it."""

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
    """A world in which `trouble` may do an action in its own way, or something beside it."""
    honest = world._do
    world._do = lambda action: trouble(world, action) or honest(action)
    return world


def bring(world: FakeWorld, **settings: Any) -> None:
    """Bring the mug, come what may."""
    Mission(world, parse(MOVE), Settings(**settings)).run()


def legs_in(world: FakeWorld) -> BaseController:
    """Of a robot that has looked around."""
    base = BaseController(world, Settings())
    base.look_around()
    return base


def once(what: Callable[[], None], when: Callable[[], bool]) -> Trouble:
    """Does `what` beside the first action at which `when` holds."""
    done: list[bool] = []

    def trouble(_: FakeWorld, action: Action) -> None:
        if not done and when():
            done.append(True)
            what()

    return trouble
