"""A fake planner: accepts tasks, and changes their states when a test calls for it."""

from __future__ import annotations

from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.errors import Conflict, InvalidInput
from helios_core.topics import (
    CANCEL,
    CHECK,
    DECISION,
    DECISIONS,
    GET_TASK,
    LIST_TASKS,
    PAUSE,
    RESERVE,
    RESUME,
    SUBMIT,
    TASK,
)

from tests.gateway_home import decision


class MadeUpTasks:
    """The planner of the fake backend. `calls`: requests to any part of the backend."""

    def __init__(self, bus: Bus) -> None:
        self.bus = bus
        self.calls: list[str] = []
        self.tasks: dict[str, pb.Task] = {}
        self.decided: list[pb.Decision] = []
        self.unused: list[str] = []  # words of each instruction without effect
        self.reserved = ""  # the reason why no task starts now

    def serve_tasks(self) -> None:
        serve = self.bus.serve
        serve(SUBMIT, self._submit)
        serve(CHECK, self._drafted)
        serve(GET_TASK, self._get)
        serve(LIST_TASKS, self._list)
        serve(CANCEL, self._cancel)
        serve(PAUSE, lambda request: self._hold(request, True))
        serve(RESUME, lambda request: self._hold(request, False))
        serve(DECISIONS, self._decisions)
        serve(RESERVE, self._reserve)

    def submit(self, instruction: str) -> pb.Task:
        """Submit a task as another client would."""
        return self._submit(pb.SubmitRequest(instruction=instruction))

    def change_task(self, id: str, state: str, **changes: object) -> None:
        """Set the task's state and publish the task."""
        task = self.tasks[id]
        task.state = state
        for name, value in changes.items():
            setattr(task, name, value)
        self.bus.publish(TASK, task)

    def decide(self) -> None:
        made = decision(len(self.decided))
        self.decided.append(made)
        self.bus.publish(DECISION, made)

    def _submit(self, request: pb.SubmitRequest) -> pb.Task:
        self.calls.append("submit")
        task = self.tasks.get(request.id) or self._drafted(request)
        if task.id not in self.tasks:
            self.tasks[task.id] = task
            self.bus.publish(TASK, task)
        return task

    def _drafted(self, request: pb.SubmitRequest) -> pb.Task:
        words = request.instruction.lower().split()
        moves = {"go": "go_to_point", "explore": "explore", "return": "go_home"}
        if "move" not in words and words[0] not in moves:
            raise InvalidInput(
                f"{request.instruction[:60]!r} names no action; understood: nothing; say for "
                "example: move the mug from the coffee table to the kitchen counter"
            )
        task = pb.Task(
            id=request.id or f"t{len(self.tasks) + 1}", instruction=request.instruction,
            state="queued", kind="move", object="mug", start="coffee table", goal="kitchen counter",
            created_s=1.8e9 + len(self.tasks), max_steps=request.max_steps or 500,
            agent=request.agent or "helios", priority=request.priority, settings=request.settings,
            time_limit_s=request.time_limit_s, on_hold=request.on_hold, unused=self.unused,
        )  # fmt: skip
        if kind := moves.get(words[0]):
            task.kind, task.object, task.start, task.goal = kind, "", "", ""
        if task.kind == "go_to_point":
            task.point.CopyFrom(pb.GoalPoint(x_m=3.2, y_m=-4.1))
        return task

    def _get(self, request: pb.TaskRequest) -> pb.Task:
        if request.id not in self.tasks:
            raise InvalidInput(f"there is no task {request.id!r}; list them with GET /v1/tasks")
        return self.tasks[request.id]

    def _list(self, _: pb.Empty) -> pb.TaskList:
        self.calls.append("list")
        return pb.TaskList(tasks=self.tasks.values())

    def _cancel(self, request: pb.TaskRequest) -> pb.Task:
        task = self._get(request)
        if task.state in ("succeeded", "failed", "cancelled"):
            raise Conflict(f"task {task.id} has ended ({task.state})")
        task.state = "cancelled"
        self.bus.publish(TASK, task)
        return task

    def _hold(self, request: pb.TaskRequest, on_hold: bool) -> pb.Task:
        task = self._get(request)
        if task.state in ("succeeded", "failed", "cancelled"):
            raise Conflict(f"task {task.id} has ended ({task.state})")
        begun = "paused" if on_hold else "running"
        self.change_task(task.id, task.state if task.state == "queued" else begun, on_hold=on_hold)
        return task

    def _decisions(self, request: pb.TaskRequest) -> pb.DecisionList:
        self._get(request)
        return pb.DecisionList(decisions=self.decided)

    def _reserve(self, request: pb.ReserveRequest) -> pb.ReserveReply:
        if request.token:
            self.reserved = ""
            return pb.ReserveReply()
        for task in self.tasks.values():
            if task.state in ("queued", "running", "paused"):
                raise Conflict(f"task {task.id} is {task.state} and relies on the present maps")
        self.reserved = request.why
        return pb.ReserveReply(token="r1")
