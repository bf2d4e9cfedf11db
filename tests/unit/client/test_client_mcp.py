"""The MCP server as a language agent uses it, connected to a gateway."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable
from typing import Any

import httpx
import pytest
from helios_client.mcp_server import build
from helios_client.mcp_tools import answer_models
from helios_client.sdk_async import AsyncHelios
from helios_client.version import helios_version
from helios_core.errors import Unavailable
from helios_gateway import api_map_models, api_models
from mcp import Client
from mcp.types import ImageContent, TextContent

from tests.gateway_process import Served, served

INSTRUCTION = "move the mug to the kitchen counter"


def run_with_client(act: Callable[[Served, Client], Awaitable[None]]) -> None:
    """Run `act` with a client of the server in this process."""

    async def run() -> None:
        with served() as gateway:
            async with AsyncHelios(gateway.url) as helios, Client(build(helios)) as client:
                await act(gateway, client)

    asyncio.run(run())


def text_of(content: object) -> str:
    assert isinstance(content, TextContent)
    return content.text


async def call(client: Client, tool: str, **arguments: Any) -> Any:
    """Call a tool and parse each content of its answer as JSON."""
    result = await client.call_tool(tool, arguments)
    texts = [text_of(content) for content in result.content]
    assert not result.is_error, texts
    values = [json.loads(text) for text in texts]
    return values[0] if len(values) == 1 else values


def test_every_tool_is_listed_with_a_title_and_a_description() -> None:
    async def act(_: Served, client: Client) -> None:
        tools = {tool.name: tool for tool in (await client.list_tools()).tools}
        assert set(tools) == {
            "submit_task", "wait_for_task", "list_tasks", "cancel_task", "why", "objects",
            "where_seen", "map_info", "map_picture", "camera", "robot", "status", "stop_robot",
            "clear_stop", "go_to_point", "explore", "go_home", "drive",
            "pause_task", "resume_task", "vocabulary", "suggest_tasks",
        }  # fmt: skip
        for tool in tools.values():
            assert tool.title
            assert tool.description
            assert "  " not in tool.description
            assert "\n" not in tool.description

    run_with_client(act)


def test_tool_annotations_mark_read_only_destructive_and_idempotent_tools() -> None:
    async def act(_: Served, client: Client) -> None:
        hints = {tool.name: tool.annotations for tool in (await client.list_tools()).tools}
        reads = {name for name, hint in hints.items() if hint and hint.read_only_hint}
        acts = {
            "submit_task", "cancel_task", "pause_task", "resume_task", "stop_robot", "clear_stop",
            "go_to_point", "explore", "go_home", "drive",
        }  # fmt: skip
        assert reads == set(hints) - acts
        destroys = {name for name in acts if (hint := hints[name]) and hint.destructive_hint}
        assert destroys == {"cancel_task", "clear_stop"}
        again = {name for name in acts if (hint := hints[name]) and hint.idempotent_hint}
        assert again == acts - {"submit_task", "go_to_point", "explore", "go_home", "drive"}
        assert all(hint and hint.title for hint in hints.values())

    run_with_client(act)


def test_the_server_reports_its_version() -> None:
    async def act(_: Served, client: Client) -> None:
        info = client.server_info
        assert info is not None
        assert info.version == helios_version()

    run_with_client(act)


def test_tool_answers_have_a_schema_and_equal_the_http_answers() -> None:
    async def act(gateway: Served, client: Client) -> None:
        tools = {tool.name: tool for tool in (await client.list_tools()).tools}
        pictures = {"map_picture", "camera"}
        assert {name for name, tool in tools.items() if tool.output_schema is None} == pictures
        submitted = await client.call_tool("submit_task", {"instruction": INSTRUCTION})
        task = {"eta_s": None} | httpx.get(f"{gateway.url}/v1/tasks/t1").json()
        assert submitted.structured_content == task
        listed = await client.call_tool("list_tasks", {"state": "queued"})
        assert listed.structured_content == {"result": [task]}
        for tool, path in (("vocabulary", "vocabulary"), ("robot", "robot"), ("status", "status")):
            answer = await client.call_tool(tool, {})
            reported = httpx.get(f"{gateway.url}/v1/{path}").json()
            assert _without_times(answer.structured_content) == _without_times(reported)
        objects = await client.call_tool("objects", {"min_score": 0.7})
        reported = httpx.get(f"{gateway.url}/v1/objects?min_score=0.7").json()["objects"]
        assert objects.structured_content == {"result": reported}
        seen = await client.call_tool("where_seen", {"prompt": "mug"})
        assert seen.structured_content is not None
        assert len(seen.structured_content["views"]) == 3

    run_with_client(act)


def _without_times(answer: Any) -> Any:
    """Remove the fields that change from second to second."""
    if isinstance(answer, dict):
        return {k: _without_times(v) for k, v in answer.items() if not k.endswith(("_s", "heard"))}
    return [_without_times(v) for v in answer] if isinstance(answer, list) else answer


def test_the_answer_schemas_name_only_fields_of_the_http_interface() -> None:
    task = {name for name in answer_models.Task.model_fields if name != "eta_s"}
    assert task <= set(api_models.Task.model_fields)
    assert set(answer_models.Decision.model_fields) <= set(api_models.Decision.model_fields)
    assert set(answer_models.FoundObject.model_fields) <= set(
        api_map_models.ObjectInstance.model_fields
    )
    assert set(answer_models.Map.model_fields) - {"frontiers"} <= set(
        api_map_models.MapInfo.model_fields
    )
    for ours, theirs in (
        (answer_models.Vocabulary, api_models.Vocabulary),
        (answer_models.Suggestions, api_models.Suggestions),
        (answer_models.Robot, api_models.Robot),
        (answer_models.Status, api_models.Status),
    ):
        assert set(ours.model_fields) <= set(theirs.model_fields)


def test_an_agent_pauses_and_resumes_a_task() -> None:
    async def act(gateway: Served, client: Client) -> None:
        await call(client, "submit_task", instruction=INSTRUCTION)
        gateway.backend.change_task("t1", "running")
        assert (await call(client, "pause_task", id="t1"))["state"] == "paused"
        assert (await call(client, "resume_task", id="t1"))["state"] == "running"

    run_with_client(act)


def test_an_agent_gets_the_vocabulary_and_suggested_tasks() -> None:
    async def act(_: Served, client: Client) -> None:
        assert (await call(client, "vocabulary"))["names"][0] == "bowl"
        reported = await call(client, "suggest_tasks", limit=2)
        assert len(reported["tasks"]) == 2
        assert {one["name"] for one in reported["seen"]} == {
            "mug",
            "coffee table",
            "kitchen counter",
        }

    run_with_client(act)


def test_waiting_for_an_unknown_task_is_an_error() -> None:
    async def act(_: Served, client: Client) -> None:
        result = await client.call_tool("wait_for_task", {"id": "none", "timeout_s": 1})
        assert result.is_error
        assert "none" in str(result.content)

    run_with_client(act)


def test_an_agent_submits_a_task_waits_for_it_and_reads_its_decisions() -> None:
    async def act(gateway: Served, client: Client) -> None:
        task = await call(client, "submit_task", instruction=INSTRUCTION)
        gateway.backend.decide()
        assert (await call(client, "wait_for_task", id="t1", timeout_s=0.1))["state"] == "queued"
        gateway.backend.change_task("t1", "succeeded")
        assert (await call(client, "wait_for_task", id=task["id"]))["state"] == "succeeded"
        assert (await call(client, "why", id="t1"))["rule"] == "global_search (eq. 10)"
        mugs = await call(client, "objects", class_name="mug")
        assert [mug["id"] for mug in mugs] == [1, 4]
        picture = await client.call_tool("map_picture", {"layer": "pick"})
        assert isinstance(picture.content[0], ImageContent)
        assert picture.content[0].mime_type == "image/png"
        assert (await call(client, "stop_robot", reason="test"))["state"]["stopped"]

    run_with_client(act)


def test_where_seen_returns_objects_and_past_views_with_images() -> None:
    async def act(_: Served, client: Client) -> None:
        answer = await client.call_tool("where_seen", {"prompt": "a mug", "limit": 2})
        reported, *pictures = answer.content
        found = json.loads(text_of(reported))
        assert [mug["id"] for mug in found["objects"]] == [1, 4]
        assert [view["score"] for view in found["views"]] == [0.82, 0.64]
        assert "jpeg_base64" not in found["views"][0]
        assert [p.mime_type for p in pictures if isinstance(p, ImageContent)] == ["image/jpeg"] * 2

    run_with_client(act)


def test_a_refusal_has_the_error_message_of_the_http_interface() -> None:
    async def act(_: Served, client: Client) -> None:
        result = await client.call_tool("submit_task", {"instruction": "dance"})
        assert result.is_error
        assert "names no action" in str(result.content)

    run_with_client(act)


@pytest.mark.parametrize(
    ("tool", "arguments", "sentence"),
    [
        ("submit_task", {}, "submit_task: instruction is missing; submit_task wants text"),
        ("drive", {"forward_m": "far"}, "drive: forward_m is 'far'; wanted a number"),
        (
            "go_to_point",
            {"x_m": "a", "y_m": None},
            "go_to_point: x_m is 'a'; wanted a number; y_m is None; wanted a number",
        ),
        (
            "list_tasks",
            {"state": "done"},
            "list_tasks: state is 'done'; wanted one of queued, running, paused, succeeded, "
            "failed, cancelled or null",
        ),
        ("drive", {"ahead_m": 1}, "drive has no argument 'ahead_m'; it takes forward_m, turn_rad"),
        ("robot", {"name": "a"}, "robot has no argument 'name'; it takes none"),
        ("submit_tsak", {}, "there is no tool 'submit_tsak'; did you mean submit_task?"),
    ],
)
def test_invalid_arguments_are_reported_with_the_expected_value(
    tool: str, arguments: dict[str, Any], sentence: str
) -> None:
    async def act(_: Served, client: Client) -> None:
        result = await client.call_tool(tool, arguments)
        assert result.is_error
        assert [text_of(content) for content in result.content] == [sentence]

    run_with_client(act)


def test_a_missing_mcp_package_is_reported_with_the_extra_to_install(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "mcp.server", None)
    monkeypatch.delitem(sys.modules, "helios_client.mcp_tools.server", raising=False)
    with pytest.raises(Unavailable, match=r"helios-ovmm\[mcp\]"):
        build(AsyncHelios())
