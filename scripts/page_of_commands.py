"""Commands of `helios`, for docs/reference/command-line.md.

The page itself holds the list of all commands; `--check` exits 1 if it is stale. The options are
inserted when the site is built.
"""

from __future__ import annotations

import dataclasses
import re
import typing
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import typer
from helios_client.cli import app
from helios_client.commands.shared_options import GatewayAddress
from helios_eval.eval_command import app as eval_app

from scripts.markdown_tables import DOCS, Block, code, plain, sentence, table

ELSEWHERE = {"eval": eval_app}  # commands that hand their arguments to another parser
VALUES = {int: "whole number", float: "number", str: "text", Path: "path"}
NOTE = re.compile(r"\s*\[(default|env var): ([^\]]*)\]")


@dataclass(frozen=True)
class Command:
    """Command that runs something, not a group of commands."""

    name: str  # as typed: "map save"
    help: str
    params: tuple[Any, ...]

    @property
    def usage(self) -> str:
        arguments = [p for p in self.params if p.param_type_name == "argument"]
        return " ".join(["helios", self.name, *(_metavar(p) for p in arguments)])


def commands() -> list[Command]:
    """All commands, in the order of `helios --help`."""
    return list(_walk(typer.main.get_command(app), ()))


def _walk(command: Any, path: tuple[str, ...]) -> Iterator[Command]:
    for name, inner in getattr(command, "commands", {}).items():
        if name in ELSEWHERE:
            inner = typer.main.get_command(ELSEWHERE[name])
        if getattr(inner, "commands", None):
            yield from _walk(inner, (*path, name))
        elif not inner.hidden:
            yield Command(" ".join((*path, name)), inner.help or "", tuple(inner.params))


def listed() -> str:
    """Table of all commands with the first sentence of their help."""
    rows = ((code(command.usage), _first_sentence(command.help)) for command in commands())
    return table(("command", "does"), rows)


def options() -> str:
    """One section per command: help, arguments and options."""
    return "\n".join(_section(command) for command in commands())


def _section(command: Command) -> str:
    own = [p for p in command.params if not _is_address(p)]
    out = [f"### helios {command.name}\n", f"`{command.usage}{' [OPTIONS]' if own else ''}`\n"]
    out += [plain(sentence(paragraph)) + "\n" for paragraph in command.help.split("\n\n")]
    if own:
        out.append(table(("option", "value", "default", "meaning"), map(_row, own)))
    if len(own) < len(command.params):
        out.append("It also takes the options of [which robot](#which-robot).\n")
    return "\n".join(out)


def _is_address(param: Any) -> bool:
    """True if the parameter is one of the four options that select the robot, with the same
    help."""
    named = {f"--{f.name}": f for f in dataclasses.fields(GatewayAddress)}
    field = named.get(param.opts[0])
    if field is None:
        return False
    hint = typing.get_type_hints(GatewayAddress, include_extras=True)[field.name]
    return any(getattr(meta, "help", None) == param.help for meta in typing.get_args(hint)[1:])


def _row(param: Any) -> tuple[str, ...]:
    described = dict(NOTE.findall(param.help or ""))
    meaning = plain(NOTE.sub("", param.help or ""))
    if envvar := param.envvar or described.get("env var"):
        meaning += f"; variable `{envvar}`"
    default = described.get("default") or _default(param)
    if param.param_type_name == "argument":
        return code(_metavar(param)), _value(param), default, meaning
    return (
        ", ".join(map(code, (*param.opts, *param.secondary_opts))),
        _value(param),
        default,
        meaning,
    )


def _default(param: Any) -> str:
    if param.required:
        return "required"
    if param.default is None or param.default is False or param.default == "":
        return ""
    return code(str(param.default))


def _value(param: Any) -> str:
    kind = param.type_descriptor.annotation
    if kind is bool:
        return ""
    if choices := typing.get_args(kind) if typing.get_origin(kind) is typing.Literal else ():
        return ", ".join(map(code, choices))
    inner = typing.get_args(kind)
    return VALUES.get(inner[0] if inner else kind, "text")


def _metavar(param: Any) -> str:
    name = (param.metavar or param.name.upper()) + ("…" if param.nargs == -1 else "")
    return name if param.required else f"[{name}]"


def _first_sentence(text: str) -> str:
    """First sentence of the first paragraph."""
    first = " ".join(text.split("\n\n")[0].split())
    return plain(sentence(re.split(r"(?<=[a-z)])\.\s", first)[0]))


BLOCK = Block(DOCS / "reference/command-line.md", "commands", "scripts/page_of_commands.py", listed)

if __name__ == "__main__":
    BLOCK.main()
