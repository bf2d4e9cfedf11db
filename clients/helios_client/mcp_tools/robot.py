"""Tools for the robot itself: how it is, stop-now."""

from __future__ import annotations

from helios_client.mcp_tools.answer_models import Moved, Robot, Status
from helios_client.mcp_tools.tool_decorator import ACTS, READS, SETS, Effect, Tools, tool

LIFTS = Effect(destroys=True, repeatable=True)  # a stop that somebody wanted is gone


class RobotTools(Tools):
    """State of the robot and of the services."""

    @tool("The robot", READS)
    async def robot(self) -> Robot:
        """Where the robot is, what it holds, what it can do, and whether it is stopped."""
        return Robot.model_validate(await self.helios.robot())

    @tool("Status", READS)
    async def status(self) -> Status:
        """Whether a task would start now, and how every service is, with reasons."""
        return Status.model_validate(await self.helios.status())

    @tool("Make one short move", ACTS)
    async def drive(self, forward_m: float = 0.0, turn_rad: float = 0.0) -> Moved:
        """Make one short move: either forward_m (-0.5 to 0.5; below 0: back) or turn_rad (-0.6 to
        0.6; above 0: left). Look at camera and map first: nothing plans a way around what is
        there. Refused while a task has the robot."""
        return Moved.model_validate(await self.helios.drive(forward_m, turn_rad))

    @tool("Stop the robot", SETS)
    async def stop_robot(self, reason: str) -> Robot:
        """Stop the robot at once; it will not move until clear_stop."""
        return Robot.model_validate(await self.helios.stop_robot(reason))

    @tool("Lift the stop", LIFTS)
    async def clear_stop(self) -> Robot:
        """Lift stop_robot: the robot may move again. Ask a person first."""
        return Robot.model_validate(await self.helios.clear_stop())
