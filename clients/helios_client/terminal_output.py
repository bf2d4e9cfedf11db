"""What people read on a terminal or in a pipe."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from helios_core.printable_text import printable
from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.table import Column, Table

PIPE_COLUMNS = 100_000  # what reads a pipe wants whole lines


class Screen(Console):
    """A console for texts of any origin: no control character of theirs reaches the terminal, and
    where there is no terminal a line is as long as it has to be."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        if not self.is_terminal and "width" not in options:
            self.width = PIPE_COLUMNS

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        """As the console does, with the text of each segment made safe."""
        for segment in super().render(renderable, options):
            text = segment.text
            if segment.control or text.isprintable() or text == "\n":
                yield segment
            else:
                lines = "\n".join(map(printable, text.split("\n")))
                yield Segment(lines, segment.style)


def plain_table(*titles: str) -> Table:
    """A table without lines. A word that is wider than its column goes on below; none is cut."""
    columns = (Column(title, overflow="fold") for title in titles)
    return Table(*columns, box=None, pad_edge=False, header_style="dim")
