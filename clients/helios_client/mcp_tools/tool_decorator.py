"""Decorator that makes a method a tool with a title, an effect and error conversion."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Awaitable, Callable, Iterator
from dataclasses import dataclass
from typing import Any, Concatenate, ParamSpec, TypeVar

from helios_core.errors import HeliosError
from mcp.server.mcpserver.exceptions import ToolError
from mcp.types import ToolAnnotations

from helios_client.sdk_async import AsyncHelios

S = TypeVar("S")
P = ParamSpec("P")
R = TypeVar("R")

_MARK = "_helios_tool"


@dataclass(frozen=True)
class Effect:
    """Effect of a tool call on the robot, as hints for the client that permits it."""

    reads_only: bool = False
    destroys: bool = False  # the call ends something that cannot be resumed
    repeatable: bool = False  # a second call changes nothing more

    def hints(self, title: str) -> ToolAnnotations:
        """MCP annotations. Every tool that does more than read acts on the open world."""
        if self.reads_only:
            return ToolAnnotations(title=title, read_only_hint=True, open_world_hint=False)
        return ToolAnnotations(
            title=title,
            read_only_hint=False,
            destructive_hint=self.destroys,
            idempotent_hint=self.repeatable,
            open_world_hint=True,
        )


READS = Effect(reads_only=True)
ACTS = Effect()
CHANGES_STATE = Effect(repeatable=True)
ENDS = Effect(destroys=True, repeatable=True)


class Tools:
    """Group of tools over one SDK client: its methods with `@tool`."""

    def __init__(self, helios: AsyncHelios) -> None:
        self.helios = helios

    def __iter__(self) -> Iterator[Tool]:
        for _, method in inspect.getmembers(self, inspect.ismethod):
            if (marked := getattr(method, _MARK, None)) is not None:
                title, effect = marked
                yield Tool(method, title, effect)


@dataclass(frozen=True)
class Tool:
    """Method that an agent may call."""

    call: Callable[..., Any]
    title: str
    effect: Effect

    @property
    def description(self) -> str:
        """Docstring of the method, on one line."""
        return " ".join((self.call.__doc__ or "").split())


def tool(
    title: str, effect: Effect
) -> Callable[
    [Callable[Concatenate[S, P], Awaitable[R]]], Callable[Concatenate[S, P], Awaitable[R]]
]:
    """Mark a method of `Tools` as a tool. Its HeliosError becomes a ToolError with the same
    sentence."""

    def mark(
        method: Callable[Concatenate[S, P], Awaitable[R]],
    ) -> Callable[Concatenate[S, P], Awaitable[R]]:
        @functools.wraps(method)
        async def with_errors(self: S, /, *args: P.args, **kwargs: P.kwargs) -> R:
            try:
                return await method(self, *args, **kwargs)
            except HeliosError as error:
                raise ToolError(error.message) from error

        setattr(with_errors, _MARK, (title, effect))
        return with_errors

    return mark
