"""The report's drawings as separate SVG files, for Markdown and for a README.

Each file has its own light and dark colours and its own background, since a page that shows it,
such as GitHub, provides none.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from helios_core.atomic_file import write_file

from helios_eval.report import colors
from helios_eval.report.report_model import Block, Graphic, Report, Section

FOLDER = "drawings"  # beside the report
MARGIN = 10.0  # around a drawing, in SVG units
_SANS = "system-ui,-apple-system,'Segoe UI',Roboto,'DejaVu Sans',sans-serif"
_VIEW_BOX = re.compile(r'<svg[^>]*?viewBox="([\d.]+) ([\d.]+) ([\d.]+) ([\d.]+)"[^>]*?>')


def named(section: Section) -> Iterator[tuple[str, Block]]:
    """Blocks of a section in order, each drawing with its file name, others with an empty name."""
    count = 0
    for block in section.blocks:
        drawn = isinstance(block, Graphic) and bool(block.svg)
        count += drawn
        number = f"-{count}" if count > 1 else ""
        yield (f"{FOLDER}/{section.id}{number}.svg" if drawn else "", block)


def write_drawings(folder: Path, report: Report) -> None:
    """Write the drawings into `folder`/drawings; delete all other SVG files there."""
    into = folder / FOLDER
    into.mkdir(exist_ok=True)
    kept = set[Path]()
    for section in report.sections:
        for name, block in named(section):
            if name and isinstance(block, Graphic):
                kept.add(folder / name)
                write_file(folder / name, standalone_svg(block.svg))
    for former in set(into.glob("*.svg")) - kept:
        former.unlink()


def standalone_svg(svg: str) -> str:
    """Drawing of `plots` with size, colours and background, as a separate file.

    Raises ValueError for a drawing without a viewBox.
    """
    head = _VIEW_BOX.search(svg)
    if head is None:
        raise ValueError(f"a drawing has no viewBox: {svg[:80]!r}; draw it with `plots`")
    x, y, width, height = map(float, head.groups())
    width, height = width + 2 * MARGIN, height + 2 * MARGIN
    box = f"{x - MARGIN:g} {y - MARGIN:g} {width:g} {height:g}"
    start = re.sub(r'viewBox="[^"]*"', f'viewBox="{box}"', head[0])[:-1]
    start += f' width="{width:g}" height="{height:g}">'
    colours = (
        f"<style>:root{{--sans:{_SANS};{colors.css_variables(dark=False)}}}"
        f"@media (prefers-color-scheme:dark){{:root{{{colors.css_variables(dark=True)}}}}}</style>"
    )
    ground = (
        f'<rect x="{x - MARGIN:g}" y="{y - MARGIN:g}" width="{width:g}" height="{height:g}" '
        'rx="6" fill="var(--paper)"/>'
    )
    return svg.replace(head[0], f"{start}\n{colours}\n{ground}", 1)
