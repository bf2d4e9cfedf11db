"""The asynchronous SDK has the same calls and answers as the synchronous one."""

from __future__ import annotations

import asyncio
import inspect
import io
from collections.abc import AsyncIterator, Callable
from types import SimpleNamespace
from typing import Any

import httpx
import numpy as np
import pytest
from helios_client.sdk import Helios
from helios_client.sdk_async import AsyncHelios
from helios_core.errors import DeadlineExceeded, InvalidInput, Unavailable

from tests.support import free_port

TASK = {"id": "t1", "instruction": "find it", "state": "running", "progress": 0.4}


def helios(answer: Callable[[httpx.Request], httpx.Response]) -> AsyncHelios:
    return AsyncHelios("http://robot", transport=httpx.MockTransport(answer))


def public(kind: type) -> dict[str, list[str]]:
    return {
        name: list(inspect.signature(member).parameters)
        for name, member in vars(kind).items()
        if not name.startswith("_") and callable(member)
    }


def test_both_clients_have_the_same_methods_with_the_same_parameters() -> None:
    assert public(Helios) == public(AsyncHelios)


def test_a_task_is_submitted_and_waited_for() -> None:
    answers = iter(
        [
            httpx.Response(202, json=TASK),
            httpx.Response(200, json=TASK),
            httpx.Response(503, json={"detail": "starting"}),
            httpx.Response(200, json=TASK | {"state": "succeeded"}),
        ]
    )
    heard: list[str] = []

    async def run() -> None:
        async with helios(lambda _: next(answers)) as client:
            task = await client.submit("find it")
            ended = await client.wait(task.id, 30, lambda t: heard.append(t.state))
            assert ended.succeeded

    asyncio.run(run())
    assert heard == ["running", "succeeded"]


def test_events_are_an_iterator_that_reconnects_after_a_break() -> None:
    answers = iter(
        [
            httpx.Response(200, text='id: b-1\nevent: map\ndata: {"map2d": 1}\n\n'),
            httpx.Response(200, text='id: b-2\nevent: map\ndata: {"map2d": 2}\n\n'),
        ]
    )

    async def run() -> list[int]:
        out: list[int] = []
        async for event in helios(lambda _: next(answers)).events():
            out.append(event.data["map2d"])
            if len(out) == 2:
                break
        return out

    assert asyncio.run(run()) == [1, 2]


def test_keepalives_count_as_contact_when_a_quiet_connection_is_lost(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now_s = 0.0

    async def keepalives() -> AsyncIterator[bytes]:
        nonlocal now_s
        for _ in range(240):
            now_s += 15
            yield b": still here\n\n"
        raise httpx.ReadError("reset by peer")

    answers = iter(
        [
            httpx.Response(200, content=keepalives()),
            httpx.Response(200, text='id: b-2\nevent: map\ndata: {"map2d": 2}\n\n'),
        ]
    )

    async def run() -> dict[str, Any]:
        async for event in helios(lambda _: next(answers)).events(silence_s=30):
            return event.data
        return {}

    clock = SimpleNamespace(monotonic=lambda: now_s)
    monkeypatch.setattr("helios_client.sdk_async.time", clock)
    assert asyncio.run(run()) == {"map2d": 2}


def test_every_method_has_a_docstring() -> None:
    for kind in (Helios, AsyncHelios):
        assert [name for name in public(kind) if not vars(kind)[name].__doc__] == []


def test_arrays_are_numpy_and_errors_are_typed() -> None:
    stream = io.BytesIO()
    np.savez_compressed(stream, occupancy=np.array([[0, 100]], np.int8))

    async def run() -> None:
        arrays = await helios(lambda _: httpx.Response(200, content=stream.getvalue())).occupancy()
        np.testing.assert_array_equal(arrays["occupancy"], [[0, 100]])
        with pytest.raises(InvalidInput, match="say what"):
            await helios(lambda _: httpx.Response(400, json={"detail": "say what"})).submit("x")
        with pytest.raises(DeadlineExceeded, match="still running"):
            await helios(lambda _: httpx.Response(200, json=TASK)).wait("t1", 0.0)
        async with AsyncHelios(f"http://127.0.0.1:{free_port()}") as nobody:
            assert not await nobody.ready()
            with pytest.raises(Unavailable, match="helios up"):
                await nobody.tasks()

    asyncio.run(run())
