"""The effort of the search for the object, by agent."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from eval_constructed_records import record
from helios_eval.episodes import episode_record
from helios_eval.studies.search_effort import main


def paths(spl: float, steps: int = 40) -> dict[str, Any]:
    return {
        "shortest_path_m": 5.0,
        "find_object_path_m": 5.0 / spl,
        "find_object_steps": steps,
    }


def write(folder: Path, *records: episode_record.EpisodeRecord) -> None:
    folder.mkdir()
    for one in records:
        episode_record.append(folder, one)


def test_steps_and_spl_are_of_the_way_to_the_object(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    never: dict[str, Any] = {"find_object": False, "success": False, "shortest_path_m": 5.0}
    write(
        tmp_path / "run",
        *(record(s, agent="helios-paper", **paths(0.5, 40 + s)) for s in range(10)),
        *(record(s, agent="trusting", **paths(0.25)) for s in range(9)),
        record(9, agent="trusting", **never),
    )
    assert main([str(tmp_path / "run")]) == 0
    paper, trusting = capsys.readouterr().out.splitlines()[2:]
    start = "| helios-paper | 10 | 100.0 (72.2 to 100.0) | 44 ± 1 | 44 |  | 50.0 ± 0.0 |  |  |"
    assert paper == start
    assert "| 90.0 (59.6 to 98.2) | 40 ± 0 | 161 | +116" in trusting  # (9 x 40 + 1250) / 10
    assert "| 22.5 ± 2.5 | −27.5 (−32.5 to −25.0) |" in trusting


def test_without_the_object_the_budget_of_the_run_counts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    never: dict[str, Any] = {"find_object": False, "success": False, "shortest_path_m": 5.0}
    write(
        tmp_path / "run",
        *(record(s, settings={"max_steps": 2000}, **paths(0.5, 40)) for s in range(9)),
        record(9, settings={"max_steps": 2000}, **never),
    )
    assert main([str(tmp_path / "run")]) == 0
    assert "| 40 ± 0 | 236 |" in capsys.readouterr().out  # (9 x 40 + 2000) / 10


def test_differences_are_to_the_agent_that_is_asked_for_and_a_failed_episode_has_spl_0(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    broken = record(9, agent="trusting", cause="system error", success=False, find_object=False)
    write(
        tmp_path / "run",
        *(record(s, agent="helios", **paths(0.5)) for s in range(10)),
        *(record(s, agent="trusting", **paths(0.25)) for s in range(9)),
        broken,
    )
    run = str(tmp_path / "run")
    assert main([run, "--against", "trusting"]) == 0
    helios, trusting = capsys.readouterr().out.splitlines()[2:]
    assert "| 50.0 ± 0.0 | +27.5 (+25.0 to +32.5) |" in helios
    assert "| 22.5 ± 2.5 |  |" in trusting
    assert "| 40 ± 0 | 161 |" in trusting  # (9 x 40 + 1250) / 10
    assert main([run, "--against", "vlfm"]) == 2
    assert "there is no arm vlfm; give one of helios, trusting" in capsys.readouterr().err


def test_records_without_paths_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write(tmp_path / "old", record(3))
    assert main([str(tmp_path / "old")]) == 2
    assert "lacks the path to the object" in capsys.readouterr().err


def test_a_folder_without_episodes_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "empty").mkdir()
    assert main([str(tmp_path / "empty")]) == 2
    assert "holds no episode" in capsys.readouterr().err
