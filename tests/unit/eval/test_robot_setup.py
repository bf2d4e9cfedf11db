"""Study of the robot checks: its table counts alarms, finds and size errors."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import pytest
from helios_core.robot_checks.finding import CHECKS
from helios_eval.studies.robot_setup import HEALTHY, KINDS, Run, main, read, table


def run(seed: int, faults: str, **wrong: float) -> Run:
    names = [check.name for check in CHECKS]
    values = {name: wrong.get(name, 0.0) for name in names}
    verdicts = {name: "wrong" if values[name] else "ok" for name in names}
    return Run(seed, "none", faults, 1.0, "", verdicts, values, dict.fromkeys(names, 0.1), [])


def test_the_table_counts_alarms_finds_and_sizes(tmp_path: Path) -> None:
    runs = [
        run(0, HEALTHY),
        run(1, HEALTHY, roll=0.7),
        run(0, "pitch_deg=1", pitch=1.1),
        run(1, "pitch_deg=-1", pitch=-1.5),
        run(0, "delay_ms=40"),
    ]
    lines = table(runs).splitlines()
    assert "| none | 2 | 1 | 0 of 2 |  |" in lines
    assert "| pitch_deg 1 | none | 2 | 2 | 2 | 30.0 % | 1 | 0 |" in lines
    assert "| delay_ms 40 | none | 1 | 1 | 0 | - | 0 | 0 |" in lines
    path = tmp_path / "runs.jsonl"
    path.write_text("".join(json.dumps(asdict(r)) + "\n" for r in runs))
    assert read(path) == runs
    assert read(tmp_path / "none") == []


def test_every_kind_of_fault_has_a_check_and_both_signs() -> None:
    assert {kind.check for kind in KINDS} == {check.name for check in CHECKS}
    assert KINDS[0].text(0) == "pitch_deg=1"
    assert KINDS[0].text(1) == "pitch_deg=-1"


def test_homes_that_are_kept_for_evaluations_are_refused(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["robot_setup", "--seed0", "900"])
    with pytest.raises(SystemExit):
        main()
    assert "0 to 999" in capsys.readouterr().err
