"""MCP server over the SDK for language agents, started by `helios mcp`.

`mcp_tools` holds the tools, one class per subject. Each tool returns the response of the HTTP
interface; its errors are the sentences of that interface.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from helios_core.errors import Unavailable

from helios_client.sdk_async import AsyncHelios
from helios_client.version import helios_version

if TYPE_CHECKING:
    from mcp.server import MCPServer

INSTRUCTIONS = (
    "A robot in a home that it explores itself. Give it tasks in words (move, find, go to), send "
    "it to a point, let it explore or come home, watch its tasks, ask what it believes to be where "
    "and why it went there. Lengths are metres, the world is z up. After stop_robot it does not "
    "move until clear_stop."
)


def build(helios: AsyncHelios) -> MCPServer:
    """MCP server without a transport. Raises Unavailable if the `mcp` library cannot be loaded."""
    try:
        from helios_client.mcp_tools.maps import MapTools
        from helios_client.mcp_tools.robot import RobotTools
        from helios_client.mcp_tools.server import Server
        from helios_client.mcp_tools.tasks import TaskTools
    except ImportError as error:
        raise Unavailable(
            f"the MCP server cannot be loaded ({error}); pip install 'helios-ovmm[mcp]'"
        ) from error

    server = Server("helios", title="HELIOS", version=helios_version(), instructions=INSTRUCTIONS)
    for group in (TaskTools(helios), MapTools(helios), RobotTools(helios)):
        for tool in group:
            server.tool(
                title=tool.title,
                description=tool.description,
                annotations=tool.effect.hints(tool.title),
            )(tool.call)
    return server
