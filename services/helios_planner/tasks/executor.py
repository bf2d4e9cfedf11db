"""Execution of one task, from its start or from its journal after a crash, to its end."""

from __future__ import annotations

import contextlib
import logging
import threading
from collections.abc import Sequence
from dataclasses import replace

from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.codec import context_to_proto
from helios_core.errors import HeliosError, Unavailable
from helios_core.heartbeat import HeartbeatSender
from helios_core.keyframe_acks import KeyframeAcks, MapPart
from helios_core.topics import CONTEXT, PLANNER_HEARTBEAT, VOCABULARY
from helios_core.types import WorldId

from helios_planner.agents import agent_named
from helios_planner.refuted_things import RefutedThings
from helios_planner.robot.client import RobotClient
from helios_planner.robot.rpc import RobotConnection
from helios_planner.settings import Settings
from helios_planner.task import Cause, State, Task, TaskCancelled, TaskFailed, TimeIsUp
from helios_planner.tasks.mission import Mission
from helios_planner.tasks.move_mission import MoveMission
from helios_planner.tasks.registry import TaskRegistry, TaskReporter
from helios_planner.tasks.run_control import Journal, PauseControl, TaskCalls, last_action
from helios_planner.tasks.search_context import check_able, in_vocabulary, search_context
from helios_planner.tasks.started_agents import (
    OBJECT_MAP_SETTINGS,
    reported_agent,
    started_for_another,
)
from helios_planner.tasks.store import Entry, Store

log = logging.getLogger(__name__)


class TaskExecutor:
    """One life of a task: its execution by one planner process. `cancelled` ends it within an
    action, `hold` pauses it."""

    def __init__(
        self,
        bus: Bus,
        settings: Settings,
        robot: pb.RobotDescription,
        acks: KeyframeAcks,
        store: Store,
        registry: TaskRegistry,
        task: Task,
        cancelled: threading.Event,
        hold: PauseControl,
    ) -> None:
        self._settings, self._robot, self._acks = settings, robot, acks
        self._registry, self._task, self._cancelled = registry, task, cancelled
        self._store = store
        kept = store.entry(task.id)
        self._again = kept is not None
        entry = Entry() if kept is None else replace(kept, life=kept.life + 1)
        self._journal = Journal(store, task.id, entry)
        self._reporter = TaskReporter(registry, task, settings, store.last_number(task.id) + 1)
        self._bus = bus
        self._calls = TaskCalls(bus, self._journal, hold, self._reporter, settings.keep_within_s)

    def run(self) -> None:
        """Run the task until it ends or the planner closes; the registry publishes the end."""
        robot: RobotClient | None = None
        mission: Mission | MoveMission | None = None
        try:
            self._check_agent()
            if not self._task.instruction.kind.only_moves:
                self._named()
            check_able(self._task.instruction, self._robot)
            context = search_context(self._task.context_id, self._task.instruction, self._settings)
            self._bus.publish(CONTEXT, context_to_proto(context))
            robot = self._client(context.id)
            mission = self._mission(robot)
            if self._again:
                self._take_up(mission)
            self._journal.checkpoint = mission.checkpoint
            self._journal.note()
            robot.begin()
            self._check_agent()  # the object map may have been away before
            if isinstance(mission, Mission):
                mission.hand.refuted = self._refuted(robot.world)
            message = mission.run() + _contacts(robot)
            self._end(mission, State.SUCCEEDED, message)
        except TaskCancelled:
            self._end(mission, State.CANCELLED, f"cancelled; {self._left(robot)}")
        except TaskFailed as failure:
            by_robot = failure.cause is not Cause.SYSTEM_ERROR and robot is not None
            message = failure.message
            if isinstance(failure, TimeIsUp) and robot is not None:
                message += robot.detector_trouble()
            message += _contacts(robot) if by_robot else ""
            if by_robot and (held := self._held(robot)):
                message += f"; {held}"
            self._end(mission, State.FAILED, message, failure.cause)
        except HeliosError as error:
            self._end(mission, State.FAILED, error.message, Cause.SYSTEM_ERROR)
        finally:
            if robot is not None:
                robot.end()

    def _end(
        self,
        mission: Mission | MoveMission | None,
        state: State,
        message: str,
        cause: Cause | None = None,
    ) -> None:
        seen = mission and mission.seen_at_goal
        self._registry.end(self._task.id, state, message, cause, seen_at_goal=seen)

    def _left(self, robot: RobotClient | None) -> str:
        """Message about the robot after a task that does not go on."""
        if not self._journal.is_settled:
            return "the robot has not answered its last action and may still be at it"
        held = self._held(robot)
        return f"the robot stands; {held}" if held else "the robot stands"

    def _held(self, robot: RobotClient | None) -> str:
        """Message about the held object; empty if there is none, or if it is not known."""
        if robot is None or not self._journal.is_settled:
            return ""
        self._calls.task_over = True
        try:
            thing = robot.held()
        except (TaskCancelled, TaskFailed, HeliosError):
            return ""
        return f"it holds a {thing} (“put the {thing} on the …” sets it down)" if thing else ""

    def _line(self) -> RobotConnection:
        return RobotConnection(self._calls, self._settings, self._cancelled, self._reporter.on_wait)

    def _client(self, context_id: str) -> RobotClient:
        """The task's robot client. Each life has its own action ids, so that none repeats
        an earlier one."""
        life = self._journal.entry.life
        robot = RobotClient(
            self._bus,
            self._line(),
            self._settings,
            self._robot,
            self._acks,
            f"{self._task.id}.{life}" if life else self._task.id,
            context_id,
            self._task.max_steps,
            self._reporter,
            self._parts(),
        )
        robot.steps = self._task.steps
        return robot

    def _mission(self, robot: RobotClient) -> Mission | MoveMission:
        instruction = self._task.instruction
        if instruction.kind.only_moves:
            return MoveMission(robot, instruction, self._settings)
        return Mission(robot, instruction, self._settings, self._task.agent)

    def _parts(self) -> Sequence[str]:
        """Parts of a keyframe that must be acknowledged before the next action. A task that only
        moves needs no detector."""
        if self._task.instruction.kind.only_moves:
            return (MapPart.OCCUPANCY,)
        return agent_named(self._task.agent).belief.required_parts

    def _refuted(self, world: WorldId) -> RefutedThings:
        """Things that looked wrong in the hand in earlier tasks of this world."""
        store = self._store
        return RefutedThings(store.refuted(world), lambda things: store.keep_refuted(world, things))

    def _take_up(self, mission: Mission | MoveMission) -> None:
        """Settle the action in flight, and restore the mission's state."""
        log.info("task %s is taken up again, life %d", self._task.id, self._journal.entry.life)
        last = last_action(
            self._line(),
            self._settings,
            self._journal,
            lambda: self._calls.held_s,
            HeartbeatSender(self._bus, PLANNER_HEARTBEAT),
        )
        if self._journal.entry.checkpoint:
            mission.restore(self._journal.entry.checkpoint, last)

    def _check_agent(self) -> None:
        """Raises TaskFailed if the services were started for another agent than the task's. Waits
        for an object map that is slow to answer; one that is away is not known."""
        object_map = ""
        if not self._task.instruction.kind.only_moves:
            with contextlib.suppress(Unavailable):
                reply = self._line().call(OBJECT_MAP_SETTINGS, pb.Empty(), refusals=(Unavailable,))
                object_map = reported_agent(reply)
        said = started_for_another(self._task.agent, self._settings.agent, object_map)
        if said:
            raise TaskFailed(Cause.SYSTEM_ERROR, said)

    def _named(self) -> None:
        """Translate the task's names to the detector's; waits for a detector that is away."""
        named = in_vocabulary(self._task.instruction, self._line().call(VOCABULARY, pb.Empty()))
        self._task = self._registry.change(self._task.id, instruction=named)


def _contacts(robot: RobotClient | None) -> str:
    if robot is None or not robot.collisions:
        return ""
    return f" (with {robot.collisions} contact{'' if robot.collisions == 1 else 's'} on the way)"
