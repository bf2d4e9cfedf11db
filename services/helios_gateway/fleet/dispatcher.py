"""Dispatcher: gives each waiting task to an idle robot, and follows it to its end.

A task is offered to a robot on hold: the robot stores it and does not start it. Then the queue
notes that the robot may start it, and only then the robot is told to (`records.Stage`). If a robot
drops out, or an answer is lost, or the gateway restarts, the queue therefore knows whether the
robot can have begun. If it cannot, the task goes back to the queue, and the robot is told to drop
its offer as soon as it answers. If it can, the task stays with the robot: two robots never do one
task.
"""

from __future__ import annotations

import contextlib
import logging
import threading
import time
import uuid
from collections.abc import Callable, Mapping

from helios_core import proto as pb
from helios_core.errors import Conflict, HeliosError, InvalidInput, Unavailable
from helios_core.name_rules import ANY_ROBOT
from helios_core.task_states import ENDED
from helios_core.topics import CANCEL, CHECK, GET_TASK, PAUSE, RESUME, SUBMIT, Method, Req

from helios_gateway.error_responses import NotFound
from helios_gateway.fleet.assignment import Assignment, WaitingTask, assignments
from helios_gateway.fleet.fleet_robot import FleetRobot
from helios_gateway.fleet.queue import FleetQueue
from helios_gateway.fleet.records import FleetTask, Stage, WithdrawnOffer
from helios_gateway.robot_registry import RobotRegistry

log = logging.getLogger(__name__)

CYCLE_S = 0.5
ASK_S = 5.0  # period in which a robot is asked for its task, in case an event was lost
DROPPED_S = 5.0  # a robot that is away for this long gives back the task that it has not begun
RETRY_S = 5.0  # pause before the next offer to a robot that did not answer, or had no room
LATE_S = 60.0  # longest time for which an offer can be under way to its robot
TOLD = (Stage.STARTING, Stage.BEGUN)
_Subject = tuple[str, str]  # what a step of a cycle is about, such as "task", and its id


class Dispatcher:
    """Queue of the fleet and the thread that empties it. `add`, `cancel` and the readers are
    thread-safe; `cycle` is called by one thread."""

    def __init__(self, registry: RobotRegistry, queue: FleetQueue, timeout_s: float) -> None:
        self.queue = queue
        self._timeout_s = timeout_s
        self._wake, self._ending = threading.Event(), threading.Event()
        self.robots: Mapping[str, FleetRobot] = {
            name: FleetRobot(name, served, timeout_s, self._wake.set)
            for name, served in registry.robots.items()
        }
        self._asked_s: dict[str, float] = {}  # last request for each begun task
        self._rests_until_s: dict[str, float] = {}  # robots that have not taken an offer
        self._said: dict[_Subject, str] = {}  # last logged trouble of each
        self._thread = threading.Thread(target=self._run, name="fleet", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        self._ending.set()
        self._wake.set()
        if self._thread.is_alive():
            self._thread.join(1.0)
        self.queue.close()

    # --- requests ------------------------------------------------------------------------------
    def add(self, request: pb.SubmitRequest, wanted: str) -> FleetTask:
        """Queue a task for a robot, or for any. Raises NotFound for an unknown robot, and what a
        robot's planner raises if each one that answers refuses the task."""
        if wanted != ANY_ROBOT and wanted not in self.robots:
            raise NotFound(
                f"there is no robot {wanted[:80]!r} here; there are: {', '.join(self.robots)}, "
                f"or {ANY_ROBOT}"
            )
        draft, refused = self._checked(request, wanted)
        task = FleetTask(
            uuid.uuid4().hex[:12], request, time.time(), wanted, task=draft, refused=refused
        )
        self.queue.add(task)
        self._wake.set()
        return task

    def cancel(self, id: str) -> FleetTask:
        """End a task at once if no robot may have begun it; else ask its robot to end it.

        A robot that does not answer is asked again in every cycle. A task of a robot that this
        gateway does not serve ends at once. One that has ended stays unchanged. Raises NotFound.
        """
        while True:
            task = self.queue.get(id)
            over = {
                "stage": Stage.ENDED,
                "end": "cancelled",
                "ended_s": time.time(),
                "message": "cancelled before it began",
            }
            if task.ended:
                return task
            if task.stage is Stage.WAITING:
                changed = self.queue.change(id, (Stage.WAITING,), **over)
            elif task.stage is Stage.OFFERED:
                changed = self.queue.withdraw(id, task.task_id, (Stage.OFFERED,), **over)
            elif task.robot not in self.robots:
                over["message"] = (
                    f"cancelled, but this gateway serves no robot {task.robot} (--robots), so its "
                    "outcome is unknown; see whether that robot still does it"
                )
                changed = self.queue.change(id, TOLD, **over)
            else:
                changed = self.queue.change(id, TOLD, cancelling=True)
            if changed is not None:
                break  # else it has reached the next stage meanwhile
        if changed.cancelling and not changed.ended:
            with contextlib.suppress(HeliosError):
                self._cancel_at_robot(changed)
        self._wake.set()
        return self.queue.get(id)

    def message(self, task: FleetTask) -> str:
        """What the task does or waits for, in one sentence."""
        if task.ended:
            return task.message
        if task.stage in TOLD:
            robot = self.robots.get(task.robot)
            if robot is None:
                return (
                    f"this gateway serves no robot {task.robot} (--robots); the task stays with "
                    "it, as it may have begun; cancel the task to end it here"
                )
            if not robot.connected:
                cancel = "; it will be cancelled when the robot is back" if task.cancelling else ""
                return f"{task.robot} is away; the task stays with it, as it may have begun{cancel}"
            return task.task.message
        if task.robot:
            return f"{task.robot} gets the task"
        return task.message or self._waiting_words(task)

    def _waiting_words(self, task: FleetTask) -> str:
        if task.wanted != ANY_ROBOT:
            robot = self.robots.get(task.wanted)
            state = "no robot of this gateway" if robot is None else robot.state()
            return f"waits for {task.wanted}, which is {state}"
        states = [robot.state() for robot in self.robots.values()]
        counts = [
            f"{states.count(s)} {s}"
            for s in ("busy", "not ready", "stopped", "away")
            if s in states
        ]
        return f"waits for an idle robot: {', '.join(counts) or 'one will start it now'}"

    def _checked(self, request: pb.SubmitRequest, wanted: str) -> tuple[pb.Task, dict[str, str]]:
        """Draft of the task by the first robot that accepts it, and the refusals before that."""
        refusals: dict[str, HeliosError] = {}
        for robot in self._of(wanted):
            if not robot.planner_here:
                continue
            try:
                draft = robot.served.bus.call(CHECK, request, self._timeout_s)
                return draft, {name: error.message for name, error in refusals.items()}
            except (InvalidInput, Conflict) as error:
                refusals[robot.name] = error
            except HeliosError as error:
                log.info("%s cannot check a task now: %s", robot.name, error.message)
        if refusals and len(refusals) == sum(r.planner_here for r in self._of(wanted)):
            raise next(iter(refusals.values()))
        return pb.Task(), {name: error.message for name, error in refusals.items()}

    def _of(self, wanted: str) -> list[FleetRobot]:
        return [r for r in self.robots.values() if wanted in (ANY_ROBOT, r.name)]

    # --- the thread ----------------------------------------------------------------------------
    def _run(self) -> None:
        while not self._ending.is_set():
            self._wake.wait(CYCLE_S)
            self._wake.clear()
            try:
                self.cycle()
            except Exception:
                log.exception("a cycle of the fleet failed; trying again")

    def cycle(self) -> None:
        """Follow every open task one step, and give the waiting ones to idle robots."""
        is_used = len(self.robots) > 1 or bool(self.queue.open_tasks())
        for robot in self.robots.values():
            robot.note_presence()
            if is_used:
                self._contained(("robot", robot.name), robot.refresh)
        for offer in self.queue.withdrawn():
            subject = ("withdrawn offer", offer.task_id)
            self._contained(subject, lambda offer=offer: self._drop_at_robot(offer))
        for task in self.queue.open_tasks():
            self._contained(("task", task.id), lambda task=task: self._follow(task))
        self._assign()
        self._forget_ended()

    def _contained(self, subject: _Subject, step: Callable[[], None]) -> None:
        """Run one step; any error is logged once, the other steps go on, and the next cycle
        repeats this one."""
        try:
            step()
            self._said.pop(subject, None)
        except Exception as error:
            known = isinstance(error, HeliosError)
            said = error.message if known else repr(error)
            if self._said.get(subject) != said:
                self._said[subject] = said
                level = logging.INFO if known else logging.ERROR
                log.log(level, "%s %s of the fleet: %s", *subject, said, exc_info=not known)

    def _forget_ended(self) -> None:
        """Drop what is kept of tasks and offers that are over."""
        tasks = {task.id for task in self.queue.open_tasks()}
        kept = tasks | {offer.task_id for offer in self.queue.withdrawn()} | set(self.robots)
        self._asked_s = {id: at_s for id, at_s in self._asked_s.items() if id in tasks}
        self._said = {about: said for about, said in self._said.items() if about[1] in kept}

    def _follow(self, task: FleetTask) -> None:
        if task.stage is Stage.OFFERED:  # the offer was not confirmed, or the gateway restarted
            self._return(task, f"{task.robot} did not confirm that it has the task")
        elif task.stage is Stage.STARTING and task.cancelling:
            self._cancel_at_robot(task)
        elif task.stage is Stage.STARTING:
            self._start_at_robot(task)
        elif task.stage is Stage.BEGUN:
            self._watch(task)

    def _return(self, task: FleetTask, why: str) -> None:
        """Put a task that its robot cannot have begun back into the queue."""
        self.queue.withdraw(
            task.id,
            task.task_id,
            (task.stage,),
            stage=Stage.WAITING,
            message="",
            returned=task.returned + 1,
        )
        log.info("task %s of the fleet is in the queue again: %s", task.id, why)
        self._wake.set()

    # --- assignment ----------------------------------------------------------------------------
    def _assign(self) -> None:
        waiting = [t for t in self.queue.open_tasks() if t.stage is Stage.WAITING]
        if not waiting:
            return
        taken = {t.robot for t in self.queue.open_tasks() if t.robot}
        things = {task.thing for task in waiting}
        now_s = time.monotonic()
        idle = [
            robot.idle(things)
            for name, robot in self.robots.items()
            if name not in taken
            and robot.planner_here
            and robot.state() == "idle"
            and now_s >= self._rests_until_s.get(name, 0.0)
        ]
        asked = [
            WaitingTask(
                t.id, t.request.priority, t.created_s, t.thing, t.wanted, frozenset(t.refused)
            )
            for t in waiting
        ]
        for one in assignments(asked, idle):
            self._contained(("offer of task", one.task_id), lambda one=one: self._offer(one))

    def _offer(self, one: Assignment) -> None:
        """Offer a task to a robot on hold; if it accepts, let it start."""
        task = self.queue.change(
            one.task_id,
            (Stage.WAITING,),
            stage=Stage.OFFERED,
            robot=one.robot,
            task_id=uuid.uuid4().hex[:12],
            why=one.why,
            message="",
        )
        if task is None:  # it was cancelled
            return
        request = pb.SubmitRequest()
        request.CopyFrom(task.request)
        request.id, request.on_hold = task.task_id, True
        try:
            held = self._call(task, SUBMIT, request)
        except InvalidInput as error:
            self._refuse(task, error.message)
            return
        except Conflict as error:  # such as a full queue
            self._rest(one.robot)
            self._decline(task, error.message)
            raise
        except Exception as error:
            self._rest(one.robot)
            self._return(task, f"{one.robot} gave no answer: {error}")
            raise
        started = self.queue.change(task.id, (Stage.OFFERED,), stage=Stage.STARTING, task=held)
        if started is not None and started.task_id == task.task_id:
            self._start_at_robot(started)

    def _rest(self, robot: str) -> None:
        """Offer a robot nothing for a while."""
        self._rests_until_s[robot] = time.monotonic() + RETRY_S

    def _decline(self, task: FleetTask, why: str) -> None:
        """Put a task back that its robot has not taken, and may take later."""
        self.queue.change(
            task.id,
            (Stage.OFFERED,),
            stage=Stage.WAITING,
            robot="",
            task_id="",
            why="",
            message=f"{task.robot} could not take it: {why}",
        )
        self._wake.set()

    def _refuse(self, task: FleetTask, why: str) -> None:
        """Note that a robot cannot do a task; the task fails if no robot is left for it."""
        refused = {**task.refused, task.robot: why}
        changes: dict[str, object] = {"stage": Stage.WAITING}
        if all(robot.name in refused for robot in self._of(task.wanted)):
            changes = {
                "stage": Stage.ENDED,
                "end": "failed",
                "ended_s": time.time(),
                "message": f"no robot can do it; {task.robot}: {why}",
            }
        self.queue.change(
            task.id, (Stage.OFFERED,), robot="", task_id="", why="", refused=refused, **changes
        )
        self._wake.set()

    # --- a robot's task ------------------------------------------------------------------------
    def _start_at_robot(self, task: FleetTask) -> None:
        """Tell the robot to start. Repeating it has no effect."""
        try:
            begun = self._call(task, RESUME, pb.TaskRequest(id=task.task_id))
        except InvalidInput:
            self._lost(task)
        except Conflict:  # it has ended
            self._take(task, self._call(task, GET_TASK, pb.TaskRequest(id=task.task_id)))
        else:
            self.queue.change(task.id, (Stage.STARTING,), stage=Stage.BEGUN, task=begun)

    def _watch(self, task: FleetTask) -> None:
        robot = self.robots.get(task.robot)
        heard = robot.newest(task.task_id) if robot is not None else None
        if task.cancelling and (heard is None or heard.state not in ENDED):
            self._cancel_at_robot(task)
            return
        now_s = time.monotonic()
        if heard is None or now_s - self._asked_s.get(task.id, 0.0) > ASK_S:
            self._asked_s[task.id] = now_s
            try:
                heard = self._call(task, GET_TASK, pb.TaskRequest(id=task.task_id))
            except InvalidInput:
                self._lost(task)
                return
        self._take(task, heard)
        if heard.state == "queued" and robot is not None and robot.away_s > DROPPED_S:
            self._take_back(task)

    def _take(self, task: FleetTask, heard: pb.Task) -> None:
        """Take the state of a task at its robot."""
        if heard.state not in ENDED:
            self.queue.observe(task.id, task.task_id, heard)
            return
        self.queue.change(
            task.id,
            TOLD,
            stage=Stage.ENDED,
            end=heard.state,
            message=heard.message,
            ended_s=heard.ended_s or time.time(),
            task=heard,
        )

    def _take_back(self, task: FleetTask) -> None:
        """Take a task that waits at a robot which dropped out, unless it starts just now."""
        held = self._call(task, PAUSE, pb.TaskRequest(id=task.task_id))
        if held.state == "queued" and held.on_hold:
            self._return(task, f"{task.robot} is away and has not begun it")
        else:
            self._call(task, RESUME, pb.TaskRequest(id=task.task_id))

    def _lost(self, task: FleetTask) -> None:
        """End a task whose robot does not know it any more."""
        self.queue.change(
            task.id,
            TOLD,
            stage=Stage.ENDED,
            end="failed",
            ended_s=time.time(),
            message=f"{task.robot} does not know the task any more, so how far it came is not "
            "known; see what the robot holds, and submit the task again",
        )

    def _cancel_at_robot(self, task: FleetTask) -> None:
        """Ask the robot to end a task. Raises HeliosError if the robot does not answer."""
        try:
            self._take(task, self._call(task, CANCEL, pb.TaskRequest(id=task.task_id)))
        except InvalidInput:
            self._lost(task)
        except Conflict:  # it has ended
            self._take(task, self._call(task, GET_TASK, pb.TaskRequest(id=task.task_id)))

    def _drop_at_robot(self, offer: WithdrawnOffer) -> None:
        """Cancel a withdrawn offer, which no robot can have begun."""
        robot = self.robots.get(offer.robot)
        if robot is not None and not robot.planner_here:
            return
        try:
            if robot is not None:
                request = pb.TaskRequest(id=offer.task_id)
                robot.served.bus.call(CANCEL, request, self._timeout_s)
        except InvalidInput:  # it never came, or may still come
            if time.time() - offer.since_s < LATE_S:
                return
        except Conflict:
            pass
        self.queue.forget(offer)

    def _call(self, task: FleetTask, method: Method[Req, pb.Task], request: Req) -> pb.Task:
        robot = self.robots.get(task.robot)
        if robot is None:
            raise Unavailable(f"this gateway serves no robot {task.robot!r}; see --robots")
        if not robot.planner_here:
            raise Unavailable(f"the planner of {task.robot} is away")
        return robot.served.bus.call(method, request, self._timeout_s)
