"""What a report is made of. Built once, rendered as Markdown and as HTML."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Cell:
    """One cell: what it says, and below it, smaller, what it is compared with."""

    text: str
    note: str = ""
    tone: str = ""  # "good", "bad", "strong", "muted"


@dataclass(frozen=True)
class Column:
    name: str
    numeric: bool = True


@dataclass(frozen=True)
class Row:
    cells: tuple[Cell, ...]
    group: str = ""  # a line above the first row of each group


@dataclass(frozen=True)
class Paragraph:
    text: str


@dataclass(frozen=True)
class Notice:
    """Something that the reader must not miss."""

    text: str


@dataclass(frozen=True)
class Facts:
    """Names with their values."""

    items: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Table:
    title: str
    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    caption: str = ""
    tag: str = ""  # a mark beside the title
    folded: bool = False  # shown on demand, where that is possible


@dataclass(frozen=True)
class Graphic:
    """A drawing as SVG, whose colours follow the page, or a picture as PNG."""

    caption: str
    svg: str = ""
    png: bytes = b""
    title: str = ""


@dataclass(frozen=True)
class Picture:
    """One failed episode."""

    title: str
    cause: str
    instruction: str
    message: str
    png: bytes
    jpeg: bytes  # of the robot's camera; may be empty
    commands: tuple[str, ...]  # that play it again


@dataclass(frozen=True)
class Gallery:
    title: str
    pictures: tuple[Picture, ...]
    caption: str = ""


@dataclass(frozen=True)
class Episodes:
    """Every episode; `filters` are the numbers of the columns that can be filtered by."""

    columns: tuple[Column, ...]
    rows: tuple[tuple[str, ...], ...]
    filters: tuple[int, ...]


@dataclass(frozen=True)
class Command:
    """Something to type."""

    text: str


Block = Paragraph | Notice | Facts | Table | Graphic | Gallery | Episodes | Command


@dataclass(frozen=True)
class Section:
    id: str
    title: str
    blocks: tuple[Block, ...]


@dataclass(frozen=True)
class Report:
    title: str
    lead: str
    sections: tuple[Section, ...]


@dataclass
class Rows:
    """Collects the rows of a table."""

    rows: list[Row] = field(default_factory=list)

    def add(self, cells: Sequence[Cell | str], group: str = "") -> None:
        """One more row; a plain string is a cell without note."""
        self.rows.append(Row(tuple(c if isinstance(c, Cell) else Cell(c) for c in cells), group))

    def table(self, title: str, columns: Sequence[str], caption: str = "", tag: str = "",
              words: Sequence[str] = ()) -> Table:  # fmt: skip
        """The table; the first column and those in `words` are read, the others are numbers."""
        heads = tuple(
            Column(name, numeric=i > 0 and name not in words) for i, name in enumerate(columns)
        )
        return Table(title, heads, tuple(self.rows), caption, tag)
