"""Records of the fleet's queue: a task, and an offer that was withdrawn from a robot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any

from helios_core import proto as pb
from helios_core.name_rules import ANY_ROBOT
from helios_core.task_states import ENDED, TaskState, is_task_state


class Stage(StrEnum):
    """Stage of a task. Each one is on the disk before the request that it allows is sent.

    A robot holds an offered task until it is told to start it. So until `STARTING` no robot can
    have begun the task, and the fleet may withdraw it. From `STARTING` on the task stays with its
    robot.
    """

    WAITING = "waiting"  # in the queue; no robot has it
    OFFERED = "offered"  # a robot holds it, or is about to
    STARTING = "starting"  # the robot may have been told to start it
    BEGUN = "begun"  # the robot has been told
    ENDED = "ended"


@dataclass(frozen=True)
class FleetTask:
    """One task of the fleet. Times are seconds since 1970, 0 while unknown."""

    id: str
    request: pb.SubmitRequest
    created_s: float
    wanted: str = ANY_ROBOT  # name of the robot that shall do it
    stage: Stage = Stage.WAITING
    robot: str = ""  # robot that has it; empty: none
    task_id: str = ""  # id of the task at that robot
    why: str = ""  # why that robot was chosen
    task: pb.Task = field(default_factory=pb.Task)  # newest known state at that robot, or the draft
    end: str = ""  # state at the end; empty before
    message: str = ""  # why it waits, or why it ended
    ended_s: float = 0.0
    cancelling: bool = False  # a client has asked for its end
    returned: int = 0  # times that it came back to the queue from a robot
    refused: Mapping[str, str] = field(default_factory=dict)  # reason by robot

    @property
    def ended(self) -> bool:
        return self.stage is Stage.ENDED

    @property
    def begun(self) -> bool:
        """True if a robot may have begun the task."""
        return bool(self.task_id) and self.stage in (Stage.STARTING, Stage.BEGUN, Stage.ENDED)

    @property
    def state(self) -> TaskState:
        """State in the words of a robot's task."""
        if self.ended:
            return self.end if is_task_state(self.end) else "failed"
        state = self.task.state
        if self.begun and is_task_state(state) and state not in ENDED:
            return state
        return "queued"

    @property
    def thing(self) -> str:
        """Class that the robot has to look for first; empty if none is known."""
        return self.task.object or self.task.goal

    def with_(self, **changes: Any) -> FleetTask:
        """A copy with some fields changed."""
        return replace(self, **changes)

    def withdrawn(self, **changes: Any) -> FleetTask:
        """A copy without its robot."""
        draft = pb.Task(
            kind=self.task.kind,
            object=self.task.object,
            start=self.task.start,
            goal=self.task.goal,
            unused=self.task.unused,
        )
        return self.with_(robot="", task_id="", why="", task=draft, **changes)


@dataclass(frozen=True)
class WithdrawnOffer:
    """Offer that its robot may still hold, and that has to be cancelled there."""

    robot: str
    task_id: str
    since_s: float
