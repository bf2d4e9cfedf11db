"""Tools for tasks: submit, watch, control, explain."""

from __future__ import annotations

import math

from helios_core.errors import DeadlineExceeded, Unavailable
from helios_core.task_states import TaskState

from helios_client.mcp_tools.answer_models import Decision, Suggestions, Task, Vocabulary
from helios_client.mcp_tools.tool_decorator import ACTS, CHANGES_STATE, ENDS, READS, Tools, tool

LONGEST_WAIT_S = 600.0


class TaskTools(Tools):
    """Tools for the tasks of the robot."""

    @tool("Submit a task", ACTS)
    async def submit_task(
        self, instruction: str, priority: int = 0, time_limit_s: float | None = None
    ) -> Task:
        """Give the robot a task, such as "Move the mug from the coffee table to the kitchen
        counter", "Find the apple" or "Go to the sofa". The task is queued; queued tasks with a
        higher priority (-100 to 100) start first. Watch it with wait_for_task."""
        task = await self.helios.submit(instruction, time_limit_s=time_limit_s, priority=priority)
        return Task(**task.raw)

    @tool("Drive to a point", ACTS)
    async def go_to_point(self, x_m: float, y_m: float, yaw_deg: float | None = None) -> Task:
        """Send the robot to a point on the floor, in metres in the world frame, which robot,
        objects and map_info also use. yaw_deg: final heading, in degrees counter-clockwise from the
        x axis. The task is queued; watch it with wait_for_task."""
        yaw_rad = None if yaw_deg is None else math.radians(yaw_deg)
        return Task(**(await self.helios.go(x_m, y_m, yaw_rad)).raw)

    @tool("Explore the home", ACTS)
    async def explore(self, time_limit_s: float | None = None) -> Task:
        """Let the robot explore until all reachable floor is known, or for time_limit_s seconds.
        The task is queued; watch it with wait_for_task."""
        return Task(**(await self.helios.explore(time_limit_s)).raw)

    @tool("Drive back to the start position", ACTS)
    async def go_home(self) -> Task:
        """Send the robot back to its start position. The task is queued; watch it with
        wait_for_task."""
        return Task(**(await self.helios.home()).raw)

    @tool("Wait for a task", READS)
    async def wait_for_task(self, id: str, timeout_s: float = 60.0) -> Task:
        """Wait until a task has ended, or for timeout_s seconds (at most 600), and return the
        task."""
        try:
            task = await self.helios.wait(id, min(max(timeout_s, 0.0), LONGEST_WAIT_S))
        except (DeadlineExceeded, Unavailable):
            task = await self.helios.task(id)
        return Task(**task.raw)

    @tool("List tasks", READS)
    async def list_tasks(self, state: TaskState | None = None) -> list[Task]:
        """List tasks, newest first: all, or those in one state."""
        return [Task(**task.raw) for task in await self.helios.tasks(state)]

    @tool("Cancel a task", ENDS)
    async def cancel_task(self, id: str) -> Task:
        """Cancel a task; the robot comes to rest. A cancelled task cannot be resumed."""
        return Task(**(await self.helios.cancel(id)).raw)

    @tool("Pause a task", CHANGES_STATE)
    async def pause_task(self, id: str) -> Task:
        """Pause a task: the current action is finished, and no further action starts until
        resume_task."""
        return Task(**(await self.helios.pause(id)).raw)

    @tool("Resume a task", CHANGES_STATE)
    async def resume_task(self, id: str) -> Task:
        """Resume a paused task; the robot moves again."""
        return Task(**(await self.helios.resume(id)).raw)

    @tool("Explain a task", READS)
    async def why(self, id: str, newest: int = 3) -> list[Decision]:
        """Explain a task by its newest decisions, each with its candidates and their terms, its
        rule and its reason."""
        decisions = await self.helios.decisions(id)
        return [Decision(**decision.raw) for decision in decisions[-max(newest, 1) :]]

    @tool("List the known names", READS)
    async def vocabulary(self) -> Vocabulary:
        """List the object and furniture names that a task may use: those that the detector knows,
        or any name (open)."""
        return Vocabulary.model_validate(await self.helios.vocabulary())

    @tool("Suggest tasks", READS)
    async def suggest_tasks(self, limit: int = 3) -> Suggestions:
        """List the names seen in this home, and at most limit tasks to try there."""
        return Suggestions.model_validate(await self.helios.suggestions(limit))
