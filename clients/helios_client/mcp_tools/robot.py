"""Tools for the robot itself: state, short moves, stop-now."""

from __future__ import annotations

from helios_client.mcp_tools.answer_models import Moved, Robot, Status
from helios_client.mcp_tools.tool_decorator import ACTS, CHANGES_STATE, READS, Effect, Tools, tool

LIFTS = Effect(destroys=True, repeatable=True)  # it ends a stop that a client requested


class RobotTools(Tools):
    """Tools for the robot and its services."""

    @tool("Get the robot's state", READS)
    async def robot(self) -> Robot:
        """Get the robot's pose, the object it holds, its abilities, and whether it is stopped."""
        return Robot.model_validate(await self.helios.robot())

    @tool("Get readiness and health", READS)
    async def status(self) -> Status:
        """Check whether a task can be done now, and the health of every service, with reasons."""
        return Status.model_validate(await self.helios.status())

    @tool("Make one short move", ACTS)
    async def drive(self, forward_m: float = 0.0, turn_rad: float = 0.0) -> Moved:
        """Make one short move: either forward_m (-0.5 to 0.5; negative: back) or turn_rad (-0.6 to
        0.6; positive: left). Look at the camera image and the map first: no path is planned around
        obstacles. Refused while a task is running or paused."""
        return Moved.model_validate(await self.helios.drive(forward_m, turn_rad))

    @tool("Stop the robot", CHANGES_STATE)
    async def stop_robot(self, reason: str) -> Robot:
        """Stop the robot at once; it does not move until clear_stop."""
        return Robot.model_validate(await self.helios.stop_robot(reason))

    @tool("Clear the stop", LIFTS)
    async def clear_stop(self) -> Robot:
        """Clear the stop of stop_robot; the robot may move again. Ask a person first."""
        return Robot.model_validate(await self.helios.clear_stop())
