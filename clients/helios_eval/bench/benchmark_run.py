"""Runs the benchmarks, prints their table and writes it as JSON."""

from __future__ import annotations

import importlib
import json
from pathlib import Path

from helios_client.terminal_output import Screen
from helios_client.usage_errors import check_writable
from helios_core.atomic_file import write_file
from helios_core.errors import InvalidInput
from rich.table import Table

from helios_eval.bench.comparison import Change, changes, read_run
from helios_eval.bench.timing import Row
from helios_eval.provenance import commit, machine

ROWS = {
    "occupancy_update": "map_benchmarks",
    "value_fusion": "map_benchmarks",
    "frontiers": "map_benchmarks",
    "plan_fm2": "path_planner_benchmark",
    "render": "object_map_benchmarks",
    "object_update": "object_map_benchmarks",
    "view_scores": "object_map_benchmarks",
    "frame_transport": "transport_benchmark",
}
RUNS = 3


def main(
    only: str | None = None,
    json_path: Path | None = None,
    compared_with: Path | None = None,
    runs: int = RUNS,
) -> bool:
    """Measure all rows, or the one named `only`; print a table; write JSON to `json_path`.

    runs: number of times that all rows are measured; of each row the run with the median ratio is
    told. compared_with: file of an earlier run. Returns True if a row got slower by more than
    noise.
    """
    before = None if compared_with is None else read_run(compared_with)
    if only is not None and only not in ROWS:
        raise InvalidInput(f"no row is called {only!r}; wanted one of {', '.join(ROWS)}")
    if json_path is not None:
        check_writable(json_path)
    console = Screen()
    measured = [_measured([only] if only else list(ROWS), console, k, runs) for k in range(runs)]
    found = [sorted(same, key=lambda row: row.ratio) for same in zip(*measured, strict=True)]
    rows = [same[len(same) // 2] for same in found]
    ratios = [[round(row.ratio, 3) for row in same] for same in found]
    now = [row.as_dict() | {"ratios": of} for row, of in zip(rows, ratios, strict=True)]
    console.print(_table(rows, ratios))
    if json_path is not None:
        document = {
            "machine": machine(),
            "commit": commit(),
            "rows": now,
        }
        write_file(json_path, json.dumps(document, indent=1) + "\n")
    if before is None:
        return False
    other, known = before
    if other and other != machine():
        print(f"the other run was on another machine ({other}), so ratios may differ as well")
    wanted = known if only is None else [row for row in known if row["name"] == only]
    return _told(*changes(wanted, now))


def _measured(names: list[str], console: Screen, run: int, runs: int) -> list[Row]:
    """All rows of these names, measured once."""
    rows: list[Row] = []
    for name in names:
        with console.status(f"run {run + 1} of {runs}: measuring {name}"):
            module = importlib.import_module(f"helios_eval.bench.{ROWS[name]}")
            found = getattr(module, name)()
            rows += found if isinstance(found, list) else [found]
    return rows


def _table(rows: list[Row], ratios: list[list[float]]) -> Table:
    table = Table(title=f"{machine()} · commit {commit()}")
    right = ("ours (ms)", "peer (ms)", "ratio", "of all runs")
    for heading in ("name", "size", "ours (ms)", "peer", "peer (ms)", "ratio", "of all runs"):
        table.add_column(heading, justify="right" if heading in right else "left")
    for row, of in zip(rows, ratios, strict=True):
        span = f"{of[0]:.2f}–{of[-1]:.2f}"
        table.add_row(
            row.name,
            row.size,
            f"{row.ours_ms:.2f}",
            row.peer,
            f"{row.peer_ms:.2f}",
            f"{row.ratio:.2f}",
            span,
        )
    return table


def _told(found: list[Change], alone: list[str]) -> bool:
    """Print the comparison. True if a row got slower."""
    slower = [change for change in found if change.slower]
    for change in slower:
        print(f"slower: {change.sentence}")
    if alone:
        print(f"not compared, because only one of the runs has them: {', '.join(alone)}")
    print(f"{len(slower)} of {len(found)} rows got slower by more than noise")
    return bool(slower)
