"""The robot for language agents: an MCP server over the SDK, started by `helios mcp`.

Every tool answers with what the HTTP interface answers, as JSON; errors are its sentences.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

from helios_core.errors import HeliosError, Unavailable

from helios_client.sdk_async import AsyncHelios

if TYPE_CHECKING:
    from mcp.server import MCPServer

P = ParamSpec("P")
R = TypeVar("R")

INSTRUCTIONS = (
    "A robot in a home that it explores itself. Give it tasks in words (move, find, go to), send "
    "it to a point, let it explore or come home, watch its tasks, ask what it believes to be where "
    "and why it went there. Lengths are metres, the world is z up. stop_robot latches until "
    "clear_stop."
)
LONGEST_WAIT_S = 600.0


def build(helios: AsyncHelios) -> MCPServer:
    """The server, without a transport. Raises Unavailable where the `mcp` library is missing."""
    try:
        from mcp.server import MCPServer
        from mcp.server.mcpserver import Image
        from mcp.server.mcpserver.exceptions import ToolError
    except ImportError as error:
        raise Unavailable(
            f"the MCP server cannot be loaded ({error}); pip install 'helios-ovmm[mcp]'"
        ) from error

    server = MCPServer("helios", instructions=INSTRUCTIONS)

    def tool(function: Callable[P, Awaitable[R]]) -> Callable[P, Awaitable[R]]:
        @functools.wraps(function)
        async def told(*args: P.args, **kwargs: P.kwargs) -> R:
            try:
                return await function(*args, **kwargs)
            except HeliosError as error:
                raise ToolError(error.message) from error

        server.tool(structured_output=False)(told)
        return told

    @tool
    async def submit_task(
        instruction: str, priority: int = 0, time_limit_s: float | None = None
    ) -> dict[str, Any]:
        """Give the robot a task, such as "Move the mug from the coffee table to the kitchen
        counter", "Find the apple" or "Go to the sofa". It queues, those of a higher priority
        (-100 to 100) first; watch it with wait_for_task."""
        task = await helios.submit(instruction, time_limit_s=time_limit_s, priority=priority)
        return task.raw

    @tool
    async def go_to_point(x_m: float, y_m: float, yaw_deg: float | None = None) -> dict[str, Any]:
        """Send the robot to a point on the floor: metres in the world frame, the one that robot,
        objects and map_info answer in. yaw_deg: which way to face there, in degrees
        counter-clockwise from the x axis. It queues; watch it with wait_for_task."""
        yaw_rad = None if yaw_deg is None else math.radians(yaw_deg)
        return (await helios.go(x_m, y_m, yaw_rad)).raw

    @tool
    async def explore(time_limit_s: float | None = None) -> dict[str, Any]:
        """Let the robot explore until nothing that it can reach is unknown, or for so many seconds.
        It queues; watch it with wait_for_task."""
        return (await helios.explore(time_limit_s)).raw

    @tool
    async def go_home() -> dict[str, Any]:
        """Send the robot back to where it started. It queues; watch it with wait_for_task."""
        return (await helios.home()).raw

    @tool
    async def wait_for_task(id: str, timeout_s: float = 60.0) -> dict[str, Any]:
        """Wait until a task has ended, or for so many seconds (at most 600), and tell how it is."""
        try:
            return (await helios.wait(id, min(max(timeout_s, 0.0), LONGEST_WAIT_S))).raw
        except HeliosError:
            return (await helios.task(id)).raw

    @tool
    async def list_tasks(state: str | None = None) -> list[dict[str, Any]]:
        """Tasks, newest first; state: queued, running, paused, succeeded, failed, cancelled."""
        return [task.raw for task in await helios.tasks(state)]

    @tool
    async def cancel_task(id: str) -> dict[str, Any]:
        """Ask a task to end; the robot comes to rest."""
        return (await helios.cancel(id)).raw

    @tool
    async def why(id: str, newest: int = 3) -> list[dict[str, Any]]:
        """Why a task went as it did: its newest decisions, each with the candidates it chose from,
        their terms, the rule and one sentence."""
        decisions = await helios.decisions(id)
        return [decision.raw for decision in decisions[-max(newest, 1) :]]

    @tool
    async def objects(
        class_name: str | None = None, min_score: float | None = None
    ) -> list[dict[str, Any]]:
        """What is believed to be where: class, centre, size, score Ψ and views of each instance;
        only those of a class, or with a score from min_score on."""
        return [found.raw for found in await helios.objects(class_name, min_score)]

    @tool
    async def where_seen(prompt: str, limit: int = 3) -> list[Any]:
        """Where something was seen, in any words: believed objects of that name, and past views
        that fit, best first, each followed by its picture."""
        found = await helios.seen(prompt, limit)
        views = [{k: v for k, v in one.raw.items() if k != "jpeg_base64"} for one in found.views]
        out: list[Any] = [found.raw | {"views": views}]
        return out + [Image(data=view.jpeg, format="jpeg") for view in found.views if view.jpeg]

    @tool
    async def map_info() -> dict[str, Any]:
        """The 2D map's size and explored area, where the robot is and has walked, and the borders
        of what was seen with their values."""
        info = dict(await helios.map_info())
        return info | {"frontiers": await helios.frontiers()}

    @tool
    async def map_picture(layer: str = "occupancy") -> object:
        """A picture of the map: occupancy, or a value layer such as pick or place."""
        what = layer if layer == "occupancy" else f"value/{layer}"
        return Image(data=await helios.picture(what), format="png")

    @tool
    async def camera() -> object:
        """What the robot sees now, with boxes around what it detects."""
        return Image(data=await helios.camera(), format="jpeg")

    @tool
    async def robot() -> dict[str, Any]:
        """Where the robot is, what it holds, what it can do, and whether it is stopped."""
        return dict(await helios.robot())

    @tool
    async def drive(forward_m: float = 0.0, turn_rad: float = 0.0) -> dict[str, Any]:
        """Make one short move: either forward_m (-0.5 to 0.5; below 0: back) or turn_rad (-0.6 to
        0.6; above 0: left). Look at camera and map first: nothing plans a way around what is
        there. Refused while a task has the robot."""
        return dict(await helios.drive(forward_m, turn_rad))

    @tool
    async def status() -> dict[str, Any]:
        """Whether a task would start now, and how every service is, with reasons."""
        return dict(await helios.status())

    @tool
    async def stop_robot(reason: str) -> dict[str, Any]:
        """Stop the robot at once; it will not move until clear_stop."""
        return dict(await helios.stop_robot(reason))

    @tool
    async def clear_stop() -> dict[str, Any]:
        """Lift stop_robot. Ask a person first."""
        return dict(await helios.clear_stop())

    return server
