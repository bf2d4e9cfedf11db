"""MCP server that reports wrong arguments of a call as sentences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from typing import Any

from mcp.server import MCPServer
from mcp.server.mcpserver.exceptions import ToolError
from pydantic import ValidationError

MOST_ERRORS = 5
MOST_CHARACTERS = 80  # shown of a given name or value


class Server(MCPServer):
    """MCP server whose errors give the received value, the expected one and a remedy. Refuses
    unknown arguments and tools."""

    async def call_tool(self, name: str, arguments: dict[str, Any], context: Any = None) -> Any:
        """Call a tool. Raises ToolError with a sentence for an unknown tool and for wrong
        arguments."""
        tools = {tool.name: tool.input_schema for tool in await self.list_tools()}
        if name not in tools:
            raise ToolError(_no_tool(name, list(tools)))
        known = tools[name].get("properties", {})
        if unknown := [argument for argument in arguments if argument not in known]:
            raise ToolError("; ".join(_unknown(name, one, list(known)) for one in unknown))
        try:
            return await super().call_tool(name, arguments, context)
        except ToolError as error:
            if isinstance(error.__cause__, ValidationError):
                raise ToolError(_message(name, error.__cause__.errors(), known)) from error
            raise


def _no_tool(name: str, known: Sequence[str]) -> str:
    near = get_close_matches(name, known, 1)
    hint = f"did you mean {near[0]}?" if near else f"the tools are {', '.join(sorted(known))}"
    return f"there is no tool {name[:MOST_CHARACTERS]!r}; {hint}"


def _unknown(tool: str, argument: str, known: Sequence[str]) -> str:
    takes = f"it takes {', '.join(known)}" if known else "it takes none"
    return f"{tool} has no argument {argument[:MOST_CHARACTERS]!r}; {takes}"


def _message(tool: str, errors: Sequence[Mapping[str, Any]], known: Mapping[str, Any]) -> str:
    """Sentence that names each argument once: pydantic reports one error per member of a union."""
    said: dict[str, str] = {}
    for error in errors:
        name = str(error["loc"][0]) if error["loc"] else "the arguments"
        if name in said:
            continue
        if error["type"] == "missing":
            said[name] = f"{name} is missing; {tool} wants {_wanted(known.get(name, {}))}"
        else:
            came = repr(error.get("input"))
            if len(came) > MOST_CHARACTERS:
                came = f"{came[: MOST_CHARACTERS - 1]}…"
            said[name] = f"{name} is {came}; wanted {_wanted(known.get(name, {}))}"
    return f"{tool}: " + "; ".join(list(said.values())[:MOST_ERRORS])


_TYPES = {
    "string": "text",
    "integer": "a whole number",
    "number": "a number",
    "boolean": "true or false",
    "null": "null",
    "array": "a list",
    "object": "an object",
}


def _wanted(schema: Mapping[str, Any]) -> str:
    """JSON schema in words."""
    if "enum" in schema:
        return f"one of {', '.join(map(str, schema['enum']))}"
    if "anyOf" in schema:
        return " or ".join(_wanted(one) for one in schema["anyOf"])
    return _TYPES.get(schema.get("type", ""), "another value")
