"""Choice of a robot for each waiting task. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from helios_core.name_rules import ANY_ROBOT


@dataclass(frozen=True)
class WaitingTask:
    """Task that no robot has yet."""

    id: str
    priority: int
    created_s: float
    thing: str = ""  # class that the robot has to look for first; empty: none
    wanted: str = ANY_ROBOT  # name of the robot that shall do it
    refused: frozenset[str] = frozenset()  # robots that cannot do it


@dataclass(frozen=True)
class KnownThing:
    """Nearest object of a class in the map of one robot."""

    score: float  # Ψ
    distance_m: float  # from the robot, in a straight line on the floor


@dataclass(frozen=True)
class IdleRobot:
    """Robot that can do a task and has none, and the things that its map knows, by class."""

    name: str
    known: Mapping[str, KnownThing] = field(default_factory=dict)


@dataclass(frozen=True)
class Assignment:
    """Task for a robot, and the reason for this robot in one sentence."""

    task_id: str
    robot: str
    why: str


def assignments(waiting: Iterable[WaitingTask], idle: Iterable[IdleRobot]) -> list[Assignment]:
    """At most one task for each idle robot: the highest priority first, then the oldest.

    A task goes to the nearest robot whose map knows its thing, else to the first robot in order.
    """
    free = {robot.name: robot for robot in idle}
    out = []
    for task in sorted(waiting, key=lambda t: (-t.priority, t.created_s, t.id)):
        able = [r for r in free.values() if _may_do(r, task)]
        if able:
            robot = min(able, key=lambda r: _distance_m(r, task))  # the first of equal ones
            out.append(Assignment(task.id, robot.name, _why(robot, task, able)))
            del free[robot.name]
    return out


def _may_do(robot: IdleRobot, task: WaitingTask) -> bool:
    return task.wanted in (ANY_ROBOT, robot.name) and robot.name not in task.refused


def _distance_m(robot: IdleRobot, task: WaitingTask) -> float:
    known = robot.known.get(task.thing)
    return float("inf") if known is None else known.distance_m


def _why(robot: IdleRobot, task: WaitingTask, able: list[IdleRobot]) -> str:
    if task.wanted != ANY_ROBOT:
        return f"the task names {robot.name}"
    if not task.thing:
        return f"{robot.name} was idle, and the task needs no known thing"
    known = robot.known.get(task.thing)
    if known is None:
        return f"{robot.name} was idle; no idle robot's map had the {task.thing}"
    rivals = sum(task.thing in other.known for other in able)
    nearest = f"the nearest of {rivals} idle robots" if rivals > 1 else "the only idle robot"
    return (
        f"{robot.name}'s map had the {task.thing} {known.distance_m:.1f} m away (score "
        f"{known.score:.2f}): {nearest} with one in its map"
    )
