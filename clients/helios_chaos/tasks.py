"""Plays tasks one after the other, and judges each end by the simulator's ground truth."""

from __future__ import annotations

import random
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np
from helios_client.answer_types import Task
from helios_client.sdk import Helios
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.codec import state_from_proto
from helios_core.errors import HeliosError, InvalidInput
from helios_core.topics import TRUTH_OBJECTS, WORLD_STATE
from helios_core.types import RobotState

T = TypeVar("T")

POLL_S, RETRY_S, CALL_S = 0.3, 0.5, 5.0
EXPLORE_S = 25.0  # time limit of an exploration
AT_HOME_M = 0.6
ANSWERS_WITHIN_S = 120.0  # of a service that a fault has hit
TASK_WITHIN_S = 900.0
SYSTEM_ERROR = "system error"  # cause of a failure that is not the task's
MOVES = ("Move the ", "Put the ")  # how an instruction to move a thing begins

Places = dict[str, tuple[str, str]]  # name of an object -> its class, name of what it stands on


@dataclass(frozen=True)
class PlayedTask:
    """A task that was played.

    untrue: why its end contradicts the truth; empty if it does not. unjudged: it failed with the
    message that it is not known how far it came, which no truth contradicts.
    """

    id: str
    instruction: str
    state: str
    message: str
    untrue: str = ""
    unjudged: bool = False

    @property
    def lost(self) -> bool:
        return bool(self.untrue) or self.state not in ("succeeded", "failed", "cancelled")

    @property
    def moves_a_thing(self) -> bool:
        return self.instruction.startswith(MOVES)


@dataclass
class Home:
    """True contents of the home."""

    places: Places
    names: dict[str, str] = field(default_factory=dict)  # name of a body -> its class

    def class_under(self, thing: str) -> str:
        """Class of the furniture under an object, also of what lies on another one; empty for the
        floor and the gripper."""
        under = thing
        for _ in self.places:
            under = self.places[under][1]
            if under not in self.places:
                break
        return self.names.get(under, "")


class TaskPlayer:
    """Thread that always has one task running, until `finish`."""

    def __init__(
        self,
        helios: Helios,
        bus: Bus,
        seed: int,
        start_xy: np.ndarray | None = None,
        most_things: int | None = None,
    ) -> None:
        """start_xy: where the robot's map began, world, m; None: where it stands now. most_things:
        objects that the tasks ask for; None: all of the home."""
        self._most_things = most_things
        self._helios, self._bus, self._random = helios, bus, random.Random(seed)
        self._ending, self._given_up = threading.Event(), threading.Event()
        self.start_xy = self._robot_xy() if start_xy is None else start_xy
        self._cancelled: set[str] = set()  # ids of the tasks that the player cancelled
        self.played: list[PlayedTask] = []
        self.running = threading.Event()  # a task runs at this moment
        self._thread = threading.Thread(target=self._run, name="tasks", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def finish(self, within_s: float) -> None:
        """Let the present task end, or cancel it after the limit; start no other."""
        self._ending.set()
        self._thread.join(within_s)
        if self._thread.is_alive():
            self._given_up.set()
            self._thread.join(ANSWERS_WITHIN_S)

    def _run(self) -> None:
        number = 0
        while not self._ending.is_set():
            try:
                self._play(number)
            except HeliosError:  # a service was away too long; the planner's list tells the rest
                time.sleep(RETRY_S)
            number += 1

    def _play(self, number: int) -> None:
        home = self._home()
        if number % 3 == 1:
            instruction, submit = "explore", lambda: self._helios.explore(EXPLORE_S)
        elif number % 3 == 2:
            instruction, submit = "go home", self._helios.home
        else:
            instruction = self._move(home)
            submit = lambda: self._helios.submit(instruction)  # noqa: E731
        id = self._submitted(submit)
        self.running.set()
        try:
            task = self._ended(id)
        finally:
            self.running.clear()
        untrue = self._untrue(instruction, task, home)
        unjudged = task.state == "failed" and task.cause == SYSTEM_ERROR
        self.played.append(PlayedTask(id, instruction, task.state, task.message, untrue, unjudged))

    def _move(self, home: Home) -> str:
        """Instruction for what the robot holds after a task that failed; else for an object that is
        not yet where it shall go."""
        under = {thing: home.class_under(thing) for thing in sorted(home.places)}
        on = [thing for thing, where in under.items() if where][: self._most_things]
        if held := self._robot().held:
            goal = self._random.choice(sorted({where for where in under.values() if where}))
            return f"Put the {held} on the {goal}"
        thing = self._random.choice(on)
        class_name = home.places[thing][0]
        goals = {where for where in under.values() if where and where != under[thing]}
        goals -= {under[t] for t in on if home.places[t][0] == class_name}
        goal = self._random.choice(sorted(goals) or [under[thing]])
        return f"Move the {class_name} from the {under[thing]} to the {goal}"

    def _untrue(self, instruction: str, task: Task, before: Home) -> str:
        """Why the end of a task contradicts the truth; empty if it does not.

        The time of an exploration is its whole goal, so its success is never untrue. A failure of
        HELIOS itself says that it is not known how far the task came, and is not judged.
        """
        if task.state == "cancelled":
            return "" if task.id in self._cancelled else "nobody cancelled it"
        if task.state == "failed" and task.cause == SYSTEM_ERROR:
            return ""
        if instruction == "go home":
            away_m = float(np.hypot(*(self._robot_xy() - self.start_xy)))
            is_there = away_m <= AT_HOME_M
            found = f"the robot is {away_m:.2f} m from its start"
        elif instruction.startswith(MOVES):
            is_there, found = moved_as_told(instruction, before, self._home())
        else:
            return ""
        return found if is_there != (task.state == "succeeded") else ""

    def _submitted(self, submit: Callable[[], Task]) -> str:
        """Id of the new task. After an error the task may exist all the same: it is then found in
        the planner's list."""
        known = {task.id for task in self._patiently(self._helios.tasks)}

        def submit_or_find() -> str:
            for task in self._helios.tasks():
                if task.id not in known:
                    return task.id
            return submit().id

        return self._patiently(submit_or_find)

    def _ended(self, id: str) -> Task:
        deadline_s = time.monotonic() + TASK_WITHIN_S
        while True:
            task = self._patiently(lambda: self._helios.task(id))
            if task.ended:
                return task
            if self._given_up.is_set() or time.monotonic() > deadline_s:
                self._cancelled.add(id)
                self._patiently(lambda: self._helios.cancel(id))
            time.sleep(POLL_S)

    def _home(self) -> Home:
        truth = self._patiently(lambda: self._bus.call(TRUTH_OBJECTS, pb.Empty(), CALL_S))
        names = {one.name: one.class_name for one in truth.instances}
        return Home({o.name: (o.class_name, o.on) for o in truth.instances if o.graspable}, names)

    def _robot_xy(self) -> np.ndarray:
        return self._robot().T_world_base[:2, 3]

    def _robot(self) -> RobotState:
        state = self._patiently(lambda: self._bus.call(WORLD_STATE, pb.Empty(), CALL_S))
        return state_from_proto(state)

    def _patiently(self, call: Callable[[], T]) -> T:
        """Result of a call that is repeated while a service is away."""
        deadline_s = time.monotonic() + ANSWERS_WITHIN_S
        while True:
            try:
                return call()
            except InvalidInput:
                raise
            except HeliosError:
                if time.monotonic() > deadline_s:
                    raise
                time.sleep(RETRY_S)


def _thing_and_goal(instruction: str) -> tuple[str, str]:
    """Of "Move the cup from the desk to the bed", or "Put the cup on the bed"."""
    thing, _, goal = instruction.removeprefix("Put the ").partition(" on the ")
    if instruction.startswith("Move the "):
        thing, _, way = instruction.removeprefix("Move the ").partition(" from the ")
        goal = way.partition(" to the ")[2]
    return thing, goal


def moved_as_told(instruction: str, before: Home, after: Home) -> tuple[bool, str]:
    """Whether an object of the class is on its goal and was not before, and what was moved."""
    class_name, goal = _thing_and_goal(instruction)
    moved = [t for t in after.places if after.places[t] != before.places.get(t)]
    is_there = any(after.places[t][0] == class_name and after.class_under(t) == goal for t in moved)
    found = ", ".join(f"{t} on {after.class_under(t) or 'nothing'}" for t in moved) or "nothing"
    return is_there, f"a {class_name} to a {goal} was asked for; moved: {found}"
