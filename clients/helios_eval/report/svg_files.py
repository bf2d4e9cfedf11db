"""The report's drawings as SVG files of their own, for Markdown and for a README.

They have their colours with them, light and dark, and a ground of their own: where they are shown,
as on GitHub, no page gives them any.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from helios_core.atomic_file import write_file

from helios_eval.report import colors
from helios_eval.report.report_model import Block, Graphic, Report, Section

FOLDER = "drawings"  # beside the report
MARGIN = 10.0  # around a drawing, in its own units
_SANS = "system-ui,-apple-system,'Segoe UI',Roboto,'DejaVu Sans',sans-serif"
_VIEW_BOX = re.compile(r'<svg[^>]*?viewBox="([\d.]+) ([\d.]+) ([\d.]+) ([\d.]+)"[^>]*?>')


def named(section: Section) -> Iterator[tuple[str, Block]]:
    """Its blocks in order, each drawing with the name of its file, everything else with none."""
    count = 0
    for block in section.blocks:
        drawn = isinstance(block, Graphic) and bool(block.svg)
        count += drawn
        number = f"-{count}" if count > 1 else ""
        yield (f"{FOLDER}/{section.id}{number}.svg" if drawn else "", block)


def write_drawings(folder: Path, report: Report) -> None:
    """Leave them in `folder`/drawings, which belongs to the report: other SVG files there go."""
    into = folder / FOLDER
    into.mkdir(exist_ok=True)
    kept = set[Path]()
    for section in report.sections:
        for name, block in named(section):
            if name and isinstance(block, Graphic):
                kept.add(folder / name)
                write_file(folder / name, standing_alone(block.svg))
    for former in set(into.glob("*.svg")) - kept:
        former.unlink()


def standing_alone(svg: str) -> str:
    """A drawing of `plots` with size, colours and ground, as a file of its own.

    Raises ValueError for one without a viewBox.
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
