"""Summary of several chaos runs."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from helios_chaos.summary import table, totals


def fault(kind: str, again_s: float | None, still_s: float | None = None) -> dict[str, Any]:
    return {"kind": kind, "acting_again_s": again_s, "still_after_s": still_s}


def run(*faults: dict[str, Any], journal_ok: bool = True) -> dict[str, Any]:
    return {
        "minutes": 30.4, "tasks": 3, "succeeded": 2, "failed": 1, "cancelled": 0, "lost": 0,
        "orphans": 0, "journal_ok": journal_ok, "map_ok": True, "faults": list(faults),
    }  # fmt: skip


def test_faults_of_all_runs_are_summed_by_kind_and_in_all() -> None:
    runs = [run(fault("kill", 1.0, 0.5), fault("cut", 4.0)), run(fault("kill", 3.0, 0.75))]
    assert table(runs) == [
        ("cut", "1", "4.00", "4.00", "4.00", "", ""),
        ("kill", "2", "3.00", "3.00", "3.00", "0.75", "0.75"),
        ("all", "3", "3.00", "4.00", "4.00", "0.75", "0.75"),
    ]
    assert totals(runs).startswith("3 faults in 61 minutes; 6 tasks: 4 succeeded, 2 failed")
    assert totals(runs).endswith("journal and maps sound.")


def test_a_run_with_a_damaged_journal_is_told() -> None:
    assert "not sound" in totals([run(fault("kill", 1.0)), run(journal_ok=False)])


def test_the_command_prints_markdown(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text(json.dumps(run(fault("kill", None))))
    done = subprocess.run(
        [sys.executable, "-m", "helios_chaos.summary", str(tmp_path / "a.json")],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    assert "\n| kill | 1 |  |  |  |  |  |\n" in done.stdout
