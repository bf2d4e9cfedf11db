"""Progress of a run: a bar with running statistics per agent, or plain lines."""

from __future__ import annotations

import time
from collections.abc import Sequence
from types import TracebackType
from typing import Self

from rich.console import Console, Group
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from helios_eval.episodes.episode_record import EpisodeRecord
from helios_eval.episodes.episode_spec import EpisodeSpec
from helios_eval.report.record_metrics import values


class Board:
    """Progress display that receives every record; a context manager while episodes are played."""

    def __init__(
        self,
        console: Console,
        known: Sequence[EpisodeRecord],
        specs: Sequence[EpisodeSpec],
        where: str,
        shows_figures: bool = True,
    ) -> None:
        """known: episodes of this run that exist already. where: text such as "2 at a time".
        shows_figures: False shows how many episodes were played, and nothing of their results."""
        self._console, self._where, self.total = console, where, len(specs)
        self._shows_figures = shows_figures
        self._known = len(known)
        self._records = {spec.agent: [] for spec in specs}
        self._wanted = dict.fromkeys(self._records, 0)
        for spec in specs:
            self._wanted[spec.agent] += 1
        for record in known:
            self._records[record.agent].append(record)
        self._began_s = time.monotonic()
        self._live = Live(console=console, get_renderable=self._shown, refresh_per_second=2)
        if known:
            console.print(f"{len(known)} of {self.total} episodes are there already")

    @property
    def done(self) -> int:
        return sum(map(len, self._records.values()))

    def add(self, record: EpisodeRecord) -> None:
        self._records[record.agent].append(record)
        if not self._console.is_terminal:
            said = f"{self.done}/{self.total} {record.agent} seed {record.seed}"
            if self._shows_figures:
                how = "success" if record.success else record.cause or "failed"
                said += f": {how}, {record.steps} steps in {record.wall_s:.1f} s; "
                said += self._figures(record.agent)
            print(f"{said}; {self._left()}", file=self._console.file, flush=True)

    def skip(self, spec: EpisodeSpec, reason: str, told: bool) -> None:
        """Count an episode no longer. told: the reason was printed for another agent."""
        self.total -= 1
        self._wanted[spec.agent] -= 1
        if not told:
            said = f"seed {spec.seed} skipped: {reason}"
            self._console.print(said, highlight=False, soft_wrap=True)

    def __enter__(self) -> Self:
        if self._console.is_terminal:
            self._live.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._console.is_terminal:
            self._live.stop()

    def _figures(self, agent: str) -> str:
        records = self._records[agent]
        n = max(1, len(records))
        success = sum(r.success for r in records) / n
        picks = values(records, "Pick")
        picked = f" Pick {picks.mean():.0%}" if _picks(records) and len(picks) else ""
        return f"SR {success:.0%}{picked} of {len(records)}"

    def _left(self) -> str:
        """Remaining time as text, from the rate of this run."""
        fresh = self.done - self._known
        if not fresh:
            return "time left unknown"
        left_s = (time.monotonic() - self._began_s) / fresh * (self.total - self.done)
        return f"{left_s / 60:.0f} min left" if left_s >= 90 else f"{left_s:.0f} s left"

    def _shown(self) -> Group:
        table = Table(box=None, header_style="dim")
        figures = ("SR", "Pick", "steps", "s/step") if self._shows_figures else ()
        for heading in ("agent", "n", *figures):
            table.add_column(heading, justify="left" if heading == "agent" else "right")
        for agent, records in self._records.items():
            n = len(records)
            row = [agent, f"{n}/{self._wanted[agent]}"]
            if n and self._shows_figures:
                steps = sum(r.steps for r in records)
                picks = values(records, "Pick")
                pace = sum(r.wall_s for r in records) / max(1, steps)
                row += [
                    f"{sum(r.success for r in records) / n:.1%}",
                    f"{picks.mean():.1%}" if _picks(records) and len(picks) else "–",
                    f"{steps / n:.0f}",
                    f"{pace:.3f}",
                ]
            table.add_row(*row)
        line = Table.grid(padding=(0, 1))
        line.add_row(
            ProgressBar(self.total, self.done, width=40),
            Text(f"{self.done}/{self.total}, {self._where}, {self._left()}"),
        )
        return Group(table, line)


def _picks(records: Sequence[EpisodeRecord]) -> bool:
    """True if these episodes include picks."""
    return any(r.benchmark == "ovmm" for r in records)
