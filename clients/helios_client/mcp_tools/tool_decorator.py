"""What makes a method a tool: its title, what it may do, and how its errors are told."""

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
    """What a call does to the robot, as hints for whoever allows it."""

    reads_only: bool = False
    destroys: bool = False  # what it ends or lifts does not come back by itself
    repeatable: bool = False  # a second call changes nothing more

    def hints(self, title: str) -> ToolAnnotations:
        """As MCP says it. What moves the robot acts on the open world."""
        if self.reads_only:
            return ToolAnnotations(title=title, read_only_hint=True, open_world_hint=False)
        return ToolAnnotations(
            title=title, read_only_hint=False, destructive_hint=self.destroys,
            idempotent_hint=self.repeatable, open_world_hint=True,
        )  # fmt: skip


READS = Effect(reads_only=True)
ACTS = Effect()
SETS = Effect(repeatable=True)
ENDS = Effect(destroys=True, repeatable=True)


class Tools:
    """A group of tools over one SDK client: its methods with `@tool`."""

    def __init__(self, helios: AsyncHelios) -> None:
        self.helios = helios

    def __iter__(self) -> Iterator[Tool]:
        for _, method in inspect.getmembers(self, inspect.ismethod):
            if (marked := getattr(method, _MARK, None)) is not None:
                title, effect = marked
                yield Tool(method, title, effect)


@dataclass(frozen=True)
class Tool:
    """A method that an agent may call."""

    call: Callable[..., Any]
    title: str
    effect: Effect

    @property
    def description(self) -> str:
        """Its docstring on one line."""
        return " ".join((self.call.__doc__ or "").split())


def tool(
    title: str, effect: Effect
) -> Callable[
    [Callable[Concatenate[S, P], Awaitable[R]]], Callable[Concatenate[S, P], Awaitable[R]]
]:
    """Marks a method of `Tools`; a HeliosError becomes an error of the tool with its sentence."""

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
