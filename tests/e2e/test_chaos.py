"""`helios chaos` with twenty faults: no task is lost. Times depend on the machine: see the reports.

A hundred faults: `helios chaos --minutes 60 --faults 100 --seed 1 --json runs/chaos.json`.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.timeout(1800)
FAULTS = 20
COMMAND = (sys.executable, "-m", "helios_client", "chaos")


def test_twenty_faults_lose_no_task(tmp_path: Path) -> None:
    result = tmp_path / "chaos.json"
    ended = subprocess.run(
        [*COMMAND, "--minutes", "25", "--faults", str(FAULTS), "--longest-s", "1.5", "--seed", "3",
         "--json", str(result), "--logs", str(tmp_path / "logs")],
        capture_output=True, text=True, timeout=1750, check=False,
    )  # fmt: skip
    print(ended.stdout, ended.stderr)  # the times depend on the machine, so the status does, too
    run = json.loads(result.read_text())
    assert len(run["faults"]) == FAULTS
    assert run["tasks"] >= 1
    assert (run["lost"], run["orphans"], run["never_acted_again"]) == (0, 0, 0)
    assert run["journal_faults"] == run["map_faults"] == []
    assert all(set(skipped) == {"kind", "reason"} for skipped in run["skipped"])
    played = {fault["kind"] for fault in run["faults"]}
    assert played.isdisjoint(skipped["kind"] for skipped in run["skipped"])


def test_an_unknown_kind_of_fault_is_wrong_use(tmp_path: Path) -> None:
    ended = subprocess.run(
        [*COMMAND, "--kinds", "kill,burn", "--json", str(tmp_path / "a.json")],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert ended.returncode == 2
    assert "no fault is called 'burn'; wanted some of kill" in ended.stderr
