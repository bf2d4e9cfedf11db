"""Console and table for a terminal or a pipe."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from helios_core.printable_text import printable
from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.table import Column, Table

PIPE_COLUMNS = 100_000  # programs that read a pipe need whole lines


class Screen(Console):
    """Console for text of any origin: it keeps control characters from the terminal. Without a
    terminal it does not wrap lines."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        if not self.is_terminal and "width" not in options:
            self.width = PIPE_COLUMNS

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        """Segments as rich renders them, with control characters made printable."""
        for segment in super().render(renderable, options):
            text = segment.text
            if segment.control or text.isprintable() or text == "\n":
                yield segment
            else:
                lines = "\n".join(map(printable, text.split("\n")))
                yield Segment(lines, segment.style)


def plain_table(*titles: str) -> Table:
    """Table without lines. A word wider than its column continues on the next line; none is cut."""
    columns = (Column(title, overflow="fold") for title in titles)
    return Table(*columns, box=None, pad_edge=False, header_style="dim")
