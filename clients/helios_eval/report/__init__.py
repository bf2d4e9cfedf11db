"""Report on a folder of episodes: `report.md` with drawings, and one `report.html`.

The HTML file is self-contained.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from helios_core.atomic_file import write_file
from helios_core.errors import InvalidInput

from helios_eval.episodes import episode_record
from helios_eval.episodes.episode_record import EpisodeRecord
from helios_eval.report.render_html import html_of
from helios_eval.report.render_md import markdown_of
from helios_eval.report.report_builder import build
from helios_eval.report.run_description import run_of
from helios_eval.report.svg_files import write_drawings

MARKDOWN, HTML = "report.md", "report.html"


def write_report(folder: Path) -> None:
    """Write both files and the drawings for the episodes of `folder`, into that folder.

    Raises InvalidInput for a folder without episodes.
    """
    write_report_of(folder, episode_record.read(folder), run_of(folder))


def write_report_of(folder: Path, records: Sequence[EpisodeRecord], run: Mapping[str, Any]) -> None:
    """Write both files and the drawings for these episodes into `folder`.

    Raises InvalidInput if there are none.
    """
    if not records:
        raise InvalidInput(
            f"{folder} holds no episode in {episode_record.EPISODES}; run "
            f"`helios eval ovmm --agents helios --episodes 10 --out {folder}` first"
        )
    report = build(folder, records, run)
    write_drawings(folder, report)
    for name, content in ((HTML, html_of(report)), (MARKDOWN, markdown_of(report))):
        write_file(folder / name, content)
