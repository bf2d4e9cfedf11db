"""Markdown tables, units by name suffix, and generated blocks in committed pages."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

DOCS = Path(__file__).resolve().parent.parent / "docs"
# Suffixes of names, longest first: `speed_m_s` is not in seconds.
UNITS = {
    "_per_cell": "1/cell", "_rad_s": "rad/s", "_per_m": "1/m", "_per_s": "1/s", "_m_s": "m/s",
    "_cells": "cells", "_bytes": "bytes", "_steps": "steps", "_views": "views", "_rad": "rad",
    "_min": "min", "_m2": "m²", "_ms": "ms", "_ns": "ns", "_mm": "mm", "_hz": "Hz", "_px": "px",
    "_mb": "MB", "_m": "m", "_s": "s",
}  # fmt: skip


def unit_of(name: str) -> str:
    """Unit that the suffix of a name denotes; empty if none."""
    return next((unit for end, unit in UNITS.items() if name.endswith(end)), "")


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Markdown table, without the columns that are empty in every row."""
    body = [[_cell(cell) for cell in row] for row in rows]
    kept = [i for i, name in enumerate(head) if not body or any(row[i] for row in body) or not name]
    lines = [[head[i] for i in kept], ["---"] * len(kept)]
    lines += [[row[i] for i in kept] for row in body]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"


def code(text: str) -> str:
    """Text as Markdown code; empty text stays empty."""
    return f"`{text}`" if text else ""


def sentence(text: str) -> str:
    """Text with a capital first letter, unless it starts with a name or a list of values, and a
    final full stop."""
    text = " ".join(text.split())
    first = text.split(" ")[0].rstrip(":,;")
    listed = text.split(" ")[0].endswith((",", ":", ";"))
    if first.isalpha() and first.islower() and not listed:
        text = text[0].upper() + text[1:]
    return text if not text or text[-1] in ".!?…" else f"{text}."


def plain(text: str) -> str:
    """Text with `<x>`, `*`, `_` and `[` escaped outside code spans, so that Markdown shows them."""
    parts = re.split(r"(`[^`]*`)", text)
    return "".join(
        p if p.startswith("`") else re.sub(r"([<>*_\[\]\\{}])", r"\\\1", p) for p in parts
    )


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


@dataclass(frozen=True)
class Block:
    """Generated part of a committed page, between two marks that name its script."""

    page: Path
    name: str  # name of its content in the marks
    script: str
    made: Callable[[], str]

    def fresh(self, page: str) -> str:
        """Text of the page with the block generated anew. Raises ValueError without the marks."""
        begin, end = f"<!-- {self.name}: {self.script} -->\n", f"<!-- end of {self.name} -->\n"
        start, stop = page.index(begin) + len(begin), page.index(end)
        return f"{page[:start]}\n{self.made()}\n{page[stop:]}"

    def main(self) -> None:
        """Write the block; with `--check` exit 1 if the page is stale."""
        write_or_check([self])


def write_or_check(blocks: Sequence[Block]) -> None:
    """Write the blocks; with `--check` exit 1 at the first stale one."""
    names = " and ".join(f"the {block.name} of {block.page.name}" for block in blocks)
    parser = argparse.ArgumentParser(description=f"Write {names}")
    parser.add_argument("--check", action="store_true", help="change nothing; exit 1 if stale")
    check = parser.parse_args().check
    for block in blocks:
        page = block.page.read_text()
        if not check:
            block.page.write_text(block.fresh(page))
        elif block.fresh(page) != page:
            sys.exit(f"the {block.name} of {block.page.name} are stale; run {block.script}")
