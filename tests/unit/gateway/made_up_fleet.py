"""Robots of a fleet whose links lose requests and answers, for tests of the dispatcher.

Each robot has a planner with the rules of the real one. A request may come late.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

from helios_core import proto as pb
from helios_core.errors import Conflict, DeadlineExceeded, InvalidInput, Unavailable
from helios_core.task_states import ENDED, HOLDS_ROBOT
from helios_core.topics import CANCEL, CHECK, GET_TASK, LIST_TASKS, PAUSE, RESUME, SUBMIT, Method
from helios_gateway.fleet.dispatcher import Dispatcher
from helios_gateway.fleet.queue import FleetQueue
from helios_gateway.robot_registry import RobotRegistry


@dataclass
class MadeUpRobot:
    """A robot and its planner. `reach`: how the next request fares; `begun`: ids of its tasks that
    it has begun."""

    name: str
    reach: str = "ok"  # ok, lost, answer lost, late
    here: bool = True  # the planner is alive
    bridge: bool = True
    stopped: bool = False
    objects: list[tuple[str, float, float, float]] = field(default_factory=list)  # class, x, y, Ψ
    refuses: str = ""
    full: bool = False  # its queue
    tasks: dict[str, pb.Task] = field(default_factory=dict)
    begun: list[str] = field(default_factory=list)
    late: list[Callable[[], pb.Task]] = field(default_factory=list)
    calls: list[str] = field(default_factory=list)
    hear: Callable[[pb.Task], None] | None = None

    # --- the bus -------------------------------------------------------------------------------
    def subscribe(self, topic: Any, handler: Callable[[pb.Task], None]) -> None:
        self.hear = handler

    def call(self, method: Method, request: Any, timeout_s: float) -> Any:
        self.calls.append(method.name)
        if not self.here or self.reach == "lost":
            raise Unavailable(f"nobody serves {method.name}")
        if self.reach == "late":
            self.late.append(lambda: self._answer(method, request))
            raise DeadlineExceeded(f"{method.name} did not answer")
        answer = self._answer(method, request)
        if self.reach == "answer lost":
            raise DeadlineExceeded(f"{method.name} did not answer")
        return answer

    def deliver(self) -> None:
        """Let the late requests arrive."""
        late, self.late = self.late, []
        for request in late:
            try:
                request()
            except (InvalidInput, Conflict):
                continue

    # --- the planner ---------------------------------------------------------------------------
    def step(self) -> None:
        """Begin the first queued task that is not on hold, unless one is under way."""
        if not self.here or any(t.state in HOLDS_ROBOT for t in self.tasks.values()):
            return
        for task in self.tasks.values():
            if task.state == "queued" and not task.on_hold:
                task.state, task.started_s = "running", 1.0
                self.begun.append(task.id)
                self._tell(task)
                return

    def finish(self, state: str = "succeeded") -> None:
        """End the task under way."""
        for task in self.tasks.values():
            if self.here and task.state in HOLDS_ROBOT:
                task.state, task.message, task.ended_s = state, f"{state} here", 2.0
                self._tell(task)

    def _tell(self, task: pb.Task) -> None:
        if self.hear is not None and self.here and self.reach == "ok":
            told = pb.Task()
            told.CopyFrom(task)
            self.hear(told)

    def _answer(self, method: Method, request: Any) -> Any:
        if method is LIST_TASKS:
            return pb.TaskList(tasks=self.tasks.values())
        if method in (SUBMIT, CHECK):
            task = self._submit(request, keeps=method is SUBMIT)
        else:
            if request.id not in self.tasks:
                raise InvalidInput(f"there is no task {request.id!r}")
            task = self.tasks[request.id]
            if method is CANCEL and task.state not in ENDED:
                task.state, task.ended_s = "cancelled", 2.0
            elif method in (PAUSE, RESUME):
                if task.state in ENDED:
                    raise Conflict(f"task {task.id} is {task.state}")
                task.on_hold = method is PAUSE
            assert method in (CANCEL, PAUSE, RESUME, GET_TASK)
        if method is not CHECK:
            self._tell(task)
        out = pb.Task()
        out.CopyFrom(task)
        return out

    def _submit(self, request: pb.SubmitRequest, keeps: bool) -> pb.Task:
        if request.id in self.tasks:
            return self.tasks[request.id]
        if self.refuses:
            raise InvalidInput(self.refuses)
        task = pb.Task(
            id=request.id,
            instruction=request.instruction,
            state="queued",
            kind="find",
            object=request.instruction.split()[-1],
            on_hold=request.on_hold,
        )
        if keeps:
            if self.full:
                raise Conflict("64 tasks wait already")
            self.tasks[request.id] = task
        return task

    # --- what the gateway knows of it ----------------------------------------------------------
    def served(self) -> Any:
        one = lambda name, x_m, y_m, score: SimpleNamespace(  # noqa: E731
            class_name=name, center_m=[x_m, y_m, 0.5], score=score
        )
        alive = {"bridge": lambda: self.bridge, "planner": lambda: self.here}
        state = SimpleNamespace(pose=SimpleNamespace(x_m=0.0, y_m=0.0))
        maps = SimpleNamespace(
            objects=lambda: SimpleNamespace(objects=[one(*found) for found in self.objects])
        )
        monitor = SimpleNamespace(
            services=SimpleNamespace(is_alive=lambda service: alive[service]()),
            robot=lambda: SimpleNamespace(state=state),
            maps=maps,
            not_ready_reasons=lambda: [] if self.here and self.bridge else ["it is away"],
        )
        robot = self

        class Monitor(SimpleNamespace):
            @property
            def stopped(self) -> bool:
                return robot.stopped

        return SimpleNamespace(bus=self, monitor=Monitor(**vars(monitor)))


class MadeUpFleet:
    """Robots, and the dispatcher of a gateway that can be restarted."""

    def __init__(self, robots: Iterable[MadeUpRobot], file: Path | None = None) -> None:
        self.robots = {robot.name: robot for robot in robots}
        self._file = file
        self.dispatcher = self._made(FleetQueue(file))

    def restart(self) -> None:
        """Another gateway over the same file; without a file, over the same queue."""
        queue = self.dispatcher.queue
        if self._file is not None:
            self.dispatcher.close()
            queue = FleetQueue(self._file)
        self.dispatcher = self._made(queue)

    def _made(self, queue: FleetQueue) -> Dispatcher:
        served = {name: robot.served() for name, robot in self.robots.items()}
        registry = cast(RobotRegistry, SimpleNamespace(robots=served))
        return Dispatcher(registry, queue, 1.0)

    def add(self, instruction: str, wanted: str = "any", priority: int = 0) -> str:
        request = pb.SubmitRequest(instruction=instruction, priority=priority)
        return self.dispatcher.add(request, wanted).id

    def cycle(self, times: int = 1) -> None:
        for _ in range(times):
            self.dispatcher.cycle()
            for robot in self.robots.values():
                robot.step()

    def begun(self, instruction: str) -> list[str]:
        """Robots that have begun the task, each as often as it has begun it."""
        return [
            robot.name
            for robot in self.robots.values()
            for id in robot.begun
            if robot.tasks[id].instruction == instruction
        ]
