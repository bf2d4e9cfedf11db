"""Renderer of the report as Markdown. It links the drawings; pictures are in the HTML alone."""

from __future__ import annotations

import itertools
import re

from helios_eval.report import svg_files
from helios_eval.report.report_model import (
    Block,
    Cell,
    Command,
    Episodes,
    Facts,
    Gallery,
    Graphic,
    Notice,
    Paragraph,
    Report,
    Table,
)

_SPECIAL = re.compile(r"([\\`*_{}\[\]<>#|~!$&])")


def markdown_of(report: Report) -> str:
    """GitHub Markdown; external text is escaped."""
    lines = [f"# {escape(report.title)}", "", escape(report.lead), ""]
    for section in report.sections:
        lines += [f"## {escape(section.title)}", ""]
        for drawing, block in svg_files.named(section):
            lines += [*_lines(block, drawing), ""]
    return "\n".join(lines).rstrip() + "\n"


def escape(text: str) -> str:
    """Text on one line, escaped for Markdown and HTML."""
    return _SPECIAL.sub(r"\\\1", " ".join(text.split()))


def _code(text: str) -> str:
    """Inline code that no backtick in the text ends."""
    flat = " ".join(text.split())
    fence = "`" * (max((len(m) for m in re.findall("`+", flat)), default=0) + 1)
    return f"{fence} {flat} {fence}" if "`" in flat else f"`{flat}`"


def _lines(block: Block, drawing: str) -> list[str]:
    match block:
        case Paragraph(text):
            return [escape(text)]
        case Notice(text):
            return [f"> {escape(text)}"]
        case Command(text):
            return [_code(text)]
        case Facts(items):
            return [f"- **{escape(name.strip())}**: {escape(value)}" for name, value in items]
        case Graphic(caption=caption, title=title):
            head = [f"### {escape(title)}", ""] if title else []
            if not drawing:
                return [*head, f"*Picture in report.html: {escape(caption)}*"]
            return [*head, f"![{escape(caption)}]({drawing})", "", f"*{escape(caption)}*"]
        case Table():
            return _table(block)
        case Gallery(title, pictures, caption):
            head = [f"### {escape(title)}", "", escape(caption), ""]
            return head + [
                f"- **{escape(p.title)}, {escape(p.cause)}**: {escape(p.instruction)} "
                f"The agent said: {escape(p.message) or '–'} Again: "
                + " or ".join(map(_code, p.commands))
                for p in pictures
            ]
        case Episodes(rows=rows):
            return [f"{len(rows)} episodes: in report.html, and in episodes.jsonl."]


def _table(table: Table) -> list[str]:
    tag = f" ({escape(table.tag)})" if table.tag else ""
    lines = [f"### {escape(table.title)}{tag}", ""]
    lines.append("| " + " | ".join(escape(c.name) for c in table.columns) + " |")
    lines.append("|" + "|".join("--:" if c.numeric else ":--" for c in table.columns) + "|")
    blank = " | " * (len(table.columns) - 1)
    for group, rows in itertools.groupby(table.rows, key=lambda row: row.group):
        if group:
            lines.append(f"| **{escape(group)}** {blank} |")
        lines += ["| " + " | ".join(map(_cell, row.cells)) + " |" for row in rows]
    if table.caption:
        lines += ["", escape(table.caption)]
    return lines


def _cell(cell: Cell) -> str:
    text = escape(cell.text)
    if cell.tone in ("strong", "good", "bad") and text:
        text = f"**{text}**"
    return f"{text} ({escape(cell.note)})" if cell.note else text
