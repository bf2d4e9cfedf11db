"""File beside a plan that says where household things lie: `flat.toml` beside `flat.sh3d`.

[[things]]
class = "mug"
on = "dining table"        # a class; the seed draws the piece and the place on it
at_m = [3.2, 1.45]         # or a point, as Sweet Home 3D counts: x right, y down, metres
"""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from helios_core.errors import InvalidInput
from helios_core.name_rules import same_name

from helios_sim.home import physics_settling
from helios_sim.home.distractor_placement import DistractorPlacer
from helios_sim.home.furnished_floor import FurnishedFloor
from helios_sim.home.home_types import Receptacle, SceneObject, Shape, Surface
from helios_sim.plans.plan_home import PlanHome

_KEYS = {"class", "on", "at_m"}
_MOST_BYTES, _MOST_THINGS = 1 << 20, 200
_DROP_M = 0.002
_FARTHEST_M = 1e4


@dataclass(frozen=True)
class Thing:
    """A household thing of a class, on a class of furniture or at a point (m, y down)."""

    class_name: str
    on: str = ""
    at_m: tuple[float, float] | None = None


def path_beside(plan: Path) -> Path:
    """Path of the file that belongs to a plan; it need not exist."""
    return plan.with_suffix(".toml")


def read_things(path: Path) -> tuple[Thing, ...]:
    """Things of a file. Raises InvalidInput if it cannot be used."""
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise InvalidInput(f"{path} has more than 1 MiB; list up to {_MOST_THINGS} things")
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise InvalidInput(
            f"{path} is no TOML file ({error}); see docs/tutorials/your-home.md"
        ) from error
    rows = table.get("things")
    if set(table) != {"things"} or not isinstance(rows, list) or not 1 <= len(rows) <= _MOST_THINGS:
        raise InvalidInput(f"{path}: wanted 1 to {_MOST_THINGS} parts [[things]] and nothing else")
    return tuple(_thing(row, f"{path}: thing {number}") for number, row in enumerate(rows, 1))


def _thing(row: Any, where: str) -> Thing:
    if not isinstance(row, dict) or not set(row) <= _KEYS or not isinstance(row.get("class"), str):
        raise InvalidInput(
            f'{where}: wanted class = "mug" and on = "dining table" or at_m = [x, y]'
        )
    on, at = row.get("on", ""), row.get("at_m")
    if not isinstance(on, str) or bool(on) == (at is not None):
        raise InvalidInput(f'{where}: wanted either on = "dining table" or at_m = [x, y]')
    if at is None:
        return Thing(row["class"], on)
    numbers = (
        isinstance(at, list)
        and len(at) == 2
        and all(isinstance(v, int | float) and abs(v) <= _FARTHEST_M for v in at)
    )
    if not numbers:
        raise InvalidInput(f"{where}: at_m is {at!r}; wanted two numbers, [x, y] in metres")
    return Thing(row["class"], at_m=(float(at[0]), float(at[1])))


def laid(home: PlanHome, floor: FurnishedFloor, things: tuple[Thing, ...]) -> PlanHome:
    """The home with these things at rest.

    Raises InvalidInput for an unknown class, for furniture that is not there or out of reach, and
    for a thing that does not stay where it is put.
    """
    placer = DistractorPlacer(floor)
    placed: list[SceneObject] = []
    for number, thing in enumerate(things, 1):
        class_name = same_name(thing.class_name, floor.catalog.objects)
        if class_name is None:
            known = ", ".join(sorted(floor.catalog.objects))
            raise InvalidInput(f"no household thing is called {thing.class_name!r}; known: {known}")
        make = floor.catalog.objects[class_name][0]
        shape = make(np.random.default_rng([7, number]), floor.palette)
        if thing.at_m is None:
            placed.append(_drawn(placer, floor, thing, class_name, shape))
        else:
            placed.append(_at(floor, thing.at_m, class_name, shape, number))
    full = replace(home, objects=physics_settling.renumbered(placed))
    kept = physics_settling.settled(full, floor.passable())
    lost = sorted({thing.name for thing in full.objects} - {thing.name for thing in kept})
    if lost:
        raise InvalidInput(
            f"{', '.join(lost)} would fall, or lies where the robot neither sees nor reaches it; "
            "give it another place"
        )
    return replace(full, objects=kept)


def _drawn(
    placer: DistractorPlacer, floor: FurnishedFloor, thing: Thing, class_name: str, shape: Shape
) -> SceneObject:
    on = same_name(thing.on, {host.class_name for host in floor.receptacles})
    hosts = [host for host in floor.receptacles if host.class_name == on]
    if not hosts:
        there = ", ".join(sorted({host.class_name for host in floor.receptacles})) or "none"
        raise InvalidInput(
            f"no {thing.on!r} within the robot's reach carries a {class_name}; there: {there}"
        )
    for k in floor.rng.permutation(len(hosts)):
        if (found := placer.put_on(class_name, shape, hosts[int(k)])) is not None:
            return found
    raise InvalidInput(f"no {on} has a free place within reach for a {class_name}")


def _at(
    floor: FurnishedFloor, at_m: tuple[float, float], class_name: str, shape: Shape, number: int
) -> SceneObject:
    x, y = at_m[0], -at_m[1]
    found: list[tuple[float, Receptacle]] = [
        (surface.height_m, host)
        for host in floor.receptacles
        for surface in host.surfaces
        if _covers(surface, x, y) and shape.size_m[2] < surface.clear_m
    ]
    if not found:
        raise InvalidInput(
            f"at [{at_m[0]:g}, {at_m[1]:g}] no furniture within the robot's reach carries a "
            f"{class_name}; `helios eval plan FILE` lists what does"
        )
    height, host = max(found, key=lambda pair: pair[0])
    return SceneObject(
        f"thing_{number}",
        class_name,
        host.name,
        (x, y, height + shape.size_m[2] / 2 + _DROP_M),
        host.yaw_rad,
        shape.size_m,
        shape.color,
        shape,
    )


def _covers(surface: Surface, x: float, y: float) -> bool:
    cos, sin = math.cos(surface.yaw_rad), math.sin(surface.yaw_rad)
    dx, dy = x - surface.center_xy[0], y - surface.center_xy[1]
    half_x, half_y = surface.half_extent_xy
    return abs(cos * dx + sin * dy) <= half_x and abs(cos * dy - sin * dx) <= half_y
