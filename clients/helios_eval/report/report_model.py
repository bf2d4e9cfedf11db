"""Data structure of a report, rendered as Markdown and as HTML."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Cell:
    """Table cell: a text, and below it a smaller note, such as an interval or a published value."""

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
    group: str = ""  # heading above the first row of each group


@dataclass(frozen=True)
class Paragraph:
    text: str


@dataclass(frozen=True)
class Notice:
    """Highlighted paragraph."""

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
    tag: str = ""  # label beside the title
    folded: bool = False  # collapsed where the format allows it


@dataclass(frozen=True)
class Graphic:
    """Drawing as SVG, whose colours follow the page, or picture as PNG."""

    caption: str
    svg: str = ""
    png: bytes = b""
    title: str = ""


@dataclass(frozen=True)
class Picture:
    """Pictures and texts of one failed episode."""

    title: str
    cause: str
    instruction: str
    message: str
    png: bytes
    jpeg: bytes  # camera image; may be empty
    commands: tuple[str, ...]  # to play and film it again


@dataclass(frozen=True)
class Gallery:
    title: str
    pictures: tuple[Picture, ...]
    caption: str = ""


@dataclass(frozen=True)
class Episodes:
    """Table of every episode; `filters`: indices of the columns that can be filtered."""

    columns: tuple[Column, ...]
    rows: tuple[tuple[str, ...], ...]
    filters: tuple[int, ...]


@dataclass(frozen=True)
class Command:
    """Shell command."""

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
    """Builder of a table's rows."""

    rows: list[Row] = field(default_factory=list)

    def add(self, cells: Sequence[Cell | str], group: str = "") -> None:
        """Add a row; a plain string becomes a cell without note."""
        self.rows.append(Row(tuple(c if isinstance(c, Cell) else Cell(c) for c in cells), group))

    def table(
        self,
        title: str,
        columns: Sequence[str],
        caption: str = "",
        tag: str = "",
        words: Sequence[str] = (),
    ) -> Table:
        """Table of the rows; the first column and those in `words` hold text, others numbers."""
        heads = tuple(
            Column(name, numeric=i > 0 and name not in words) for i, name in enumerate(columns)
        )
        return Table(title, heads, tuple(self.rows), caption, tag)
