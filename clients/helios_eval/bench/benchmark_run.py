"""Runs the benchmarks, prints their table and writes it as JSON."""

from __future__ import annotations

import importlib
import json
from pathlib import Path

from helios_client.terminal_output import Screen
from helios_core.atomic_file import write_file
from helios_core.errors import InvalidInput
from rich.table import Table

from helios_eval.bench.comparison import Change, changes, read_rows
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


def main(
    only: str | None = None, json_path: Path | None = None, compared_with: Path | None = None
) -> bool:
    """Measure all rows, or the one named `only`; print a table; write JSON to `json_path`.

    compared_with: file of an earlier run. Returns True if a row got slower by more than noise.
    """
    before = None if compared_with is None else read_rows(compared_with)
    if only is not None and only not in ROWS:
        raise InvalidInput(f"no row is called {only!r}; wanted one of {', '.join(ROWS)}")
    console = Screen()
    rows = []
    for name in [only] if only else ROWS:
        with console.status(f"measuring {name}"):
            module = importlib.import_module(f"helios_eval.bench.{ROWS[name]}")
            measured = getattr(module, name)()
            rows += measured if isinstance(measured, list) else [measured]
    table = Table(title=f"{machine()} · commit {commit()}")
    for heading in ("name", "size", "ours (ms)", "peer", "peer (ms)", "ratio", "±"):
        table.add_column(
            heading, justify="right" if "ms" in heading or heading in ("ratio", "±") else "left"
        )
    for row in rows:
        table.add_row(row.name, row.size, f"{row.ours_ms:.2f}", row.peer, f"{row.peer_ms:.2f}",
                      f"{row.ratio:.2f}", f"{row.ratio_spread:.2f}")  # fmt: skip
    console.print(table)
    if json_path is not None:
        document = {
            "machine": machine(),
            "commit": commit(),
            "rows": [row.as_dict() for row in rows],
        }
        json_path.parent.mkdir(parents=True, exist_ok=True)
        write_file(json_path, json.dumps(document, indent=1) + "\n")
    if before is None:
        return False
    wanted = before if only is None else [row for row in before if row["name"] == only]
    return _told(*changes(wanted, [row.as_dict() for row in rows]))


def _told(found: list[Change], alone: list[str]) -> bool:
    """Print the comparison. True if a row got slower."""
    slower = [change for change in found if change.slower]
    for change in slower:
        print(f"slower: {change.sentence}")
    if alone:
        print(f"not compared, because only one of the runs has them: {', '.join(alone)}")
    print(f"{len(slower)} of {len(found)} rows got slower by more than noise")
    return bool(slower)
