"""The MCP server as a language agent uses it, over a gateway."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable
from typing import Any

import pytest
from helios_client.mcp_server import build
from helios_client.sdk_async import AsyncHelios
from helios_core.errors import Unavailable
from mcp import Client
from mcp.types import ImageContent, TextContent

from tests.gateway_process import Served, served

INSTRUCTION = "move the mug to the kitchen counter"


def used(act: Callable[[Served, Client], Awaitable[None]]) -> None:
    """Run `act` with a client of the server in this process."""

    async def run() -> None:
        with served() as house:
            async with AsyncHelios(house.url) as helios, Client(build(helios)) as client:
                await act(house, client)

    asyncio.run(run())


def text_of(content: object) -> str:
    assert isinstance(content, TextContent)
    return content.text


async def said(client: Client, tool: str, **arguments: Any) -> Any:
    """What a tool answers: each content as JSON."""
    result = await client.call_tool(tool, arguments)
    texts = [text_of(content) for content in result.content]
    assert not result.is_error, texts
    values = [json.loads(text) for text in texts]
    return values[0] if len(values) == 1 else values


def test_an_agent_finds_the_tools_with_their_meaning() -> None:
    async def act(_: Served, client: Client) -> None:
        tools = {tool.name: tool for tool in (await client.list_tools()).tools}
        assert set(tools) == {
            "submit_task", "wait_for_task", "list_tasks", "cancel_task", "why", "objects",
            "where_seen", "map_info", "map_picture", "camera", "robot", "status", "stop_robot",
            "clear_stop", "go_to_point", "explore", "go_home", "drive",
        }  # fmt: skip
        assert all(tool.description for tool in tools.values())

    used(act)


def test_an_agent_gives_a_task_watches_it_and_asks_why() -> None:
    async def act(house: Served, client: Client) -> None:
        task = await said(client, "submit_task", instruction=INSTRUCTION)
        house.backend.decide()
        assert (await said(client, "wait_for_task", id="t1", timeout_s=0.1))["state"] == "queued"
        house.backend.change_task("t1", "succeeded")
        assert (await said(client, "wait_for_task", id=task["id"]))["state"] == "succeeded"
        assert (await said(client, "why", id="t1"))["rule"] == "global_search (eq. 10)"
        mugs = await said(client, "objects", class_name="mug")
        assert [mug["id"] for mug in mugs] == [1, 4]
        picture = await client.call_tool("map_picture", {"layer": "pick"})
        assert isinstance(picture.content[0], ImageContent)
        assert picture.content[0].mime_type == "image/png"
        assert (await said(client, "stop_robot", reason="test"))["state"]["stopped"]

    used(act)


def test_an_agent_asks_where_something_was_seen_and_sees_it() -> None:
    async def act(_: Served, client: Client) -> None:
        answer = await client.call_tool("where_seen", {"prompt": "a mug", "limit": 2})
        told, *pictures = answer.content
        found = json.loads(text_of(told))
        assert [mug["id"] for mug in found["objects"]] == [1, 4]
        assert [view["score"] for view in found["views"]] == [0.82, 0.64]
        assert "jpeg_base64" not in found["views"][0]
        assert [p.mime_type for p in pictures if isinstance(p, ImageContent)] == ["image/jpeg"] * 2

    used(act)


def test_what_cannot_be_done_is_said_in_the_interface_s_own_words() -> None:
    async def act(_: Served, client: Client) -> None:
        result = await client.call_tool("submit_task", {"instruction": "dance"})
        assert result.is_error
        assert "names no action" in str(result.content)

    used(act)


def test_without_the_library_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "mcp.server", None)
    with pytest.raises(Unavailable, match=r"helios-ovmm\[mcp\]"):
        build(AsyncHelios())
