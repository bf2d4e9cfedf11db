"""Table of the Python SDK's methods, for docs/reference/python-sdk.md."""

from __future__ import annotations

import inspect
import re

from helios_client.sdk import Helios

from scripts.markdown_tables import plain, sentence, table


def methods() -> str:
    """Table of all public methods with parameters and the first sentence of their docstrings."""
    return table(("method", "does"), (_row(name) for name in names()))


def names() -> list[str]:
    """Names of the public methods, in the order of the class."""
    return [n for n, m in vars(Helios).items() if inspect.isfunction(m) and not n.startswith("_")]


def _row(name: str) -> tuple[str, str]:
    method = getattr(Helios, name)
    parameters = ", ".join(list(inspect.signature(method).parameters)[1:])
    text = " ".join((inspect.getdoc(method) or "").split())
    first = re.split(r"(?<=[a-z`)])\.\s", text)[0]
    return f"[`{name}({parameters})`](#helios_client.sdk.Helios.{name})", plain(sentence(first))
