"""Sphinx extension that inserts the generated parts of the reference when the site is built.

Each part replaces its mark in a page, such as `<!-- written by make docs: options -->`.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from sphinx.application import Sphinx
from sphinx.errors import ExtensionError

from scripts import page_of_commands, page_of_http, page_of_messages, page_of_sdk

MARK = re.compile(r"<!-- written by make docs: (\S+) -->\n")
PARTS: dict[str, tuple[str, Callable[[], str]]] = {  # name -> page with the mark, generator
    "options": ("reference/command-line", page_of_commands.options),
    "errors": ("reference/http-api", page_of_http.errors),
    "details": ("reference/http-api", page_of_http.details),
    "messages": ("reference/wire-contract", page_of_messages.messages),
    "methods": ("reference/python-sdk", page_of_sdk.methods),
}


def setup(app: Sphinx) -> dict[str, Any]:
    app.connect("source-read", _write)
    app.connect("env-get-outdated", lambda *_: sorted({page for page, _ in PARTS.values()}))
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _write(app: Sphinx, page: str, source: list[str]) -> None:
    source[0] = written(page, source[0])


def written(page: str, text: str) -> str:
    """Text of the page with its parts inserted. Raises ExtensionError for a missing or unknown
    mark."""
    wanted = {name for name, (of, _) in PARTS.items() if of == page}
    found = MARK.findall(text)
    if sorted(found) != sorted(wanted):
        raise ExtensionError(
            f"{page} has marks for {found}, wanted one for each of {sorted(wanted)}; write "
            "<!-- written by make docs: NAME --> where the part belongs"
        )
    return MARK.sub(lambda mark: PARTS[mark[1]][1](), text)
