"""Tests relabelling old results: agents get their current names once, and nothing else changes."""

from __future__ import annotations

import gzip
import importlib.util
import json
from pathlib import Path
from typing import Any

import pytest
from helios_eval.episodes import episode_record
from helios_eval.episodes.episode_record import EPISODES, PACKED

_SCRIPT = Path(__file__).parents[2] / "scripts/relabel_agents.py"
_spec = importlib.util.spec_from_file_location("relabel_agents", _SCRIPT)
assert _spec is not None
assert _spec.loader is not None
relabel_agents = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(relabel_agents)

OLD = ("helios", "helios-next", "helios-5050", "vlfm-helios-stop", "trusting")
NEW = ("helios-paper", "helios", "helios-5050", "vlfm-helios-stop", "trusting")
COMMAND = ["helios", "eval", "ovmm", "--out", "helios", "--agents", ",".join(OLD), "--jobs", "1"]


def line(agent: str) -> str:
    reported = {
        "benchmark": "ovmm",
        "agent": agent,
        "semantics": "noisy",
        "preset": "ovmm-v1",
        "seed": 7,
        "instruction": "Find the hat",
        "path_m": 126.6152089463771,
        "wall_s": 1e-05,
        "message": "helios-next said: ü",
        "commit": "dc49a59",
    }
    return json.dumps(reported, separators=(",", ":"), ensure_ascii=False)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    run: dict[str, Any] = {
        "machine": "helios",
        "versions": {"helios-ovmm": "0.1.0"},
        "commands": [COMMAND],
        "asked": [{"agents": list(OLD), "seed0": 0}],
        "ran_with": {agent: {"planner.tau_g": str(k)} for k, agent in enumerate(OLD)},
    }
    (tmp_path / "run.json").write_text(json.dumps(run))
    (tmp_path / PACKED).write_bytes(gzip.compress("".join(line(a) + "\n" for a in OLD).encode()))
    rows = [{"agent": a, "settings": {}, "metrics": {"SR": {"mean": 1 / 3}}} for a in OLD]
    (tmp_path / "results.json").write_text(json.dumps(rows))
    return tmp_path


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_agents_get_their_current_names_and_everything_else_is_unchanged(folder: Path) -> None:
    assert relabel_agents.main([str(folder)]) == 0
    packed = gzip.decompress((folder / PACKED).read_bytes()).decode()
    assert packed.splitlines() == [line(agent) for agent in NEW]
    run = json.loads((folder / "run.json").read_text())
    assert run.pop("relabelled") == {"helios": "helios-paper", "helios-next": "helios"}
    assert run == {
        "machine": "helios",
        "versions": {"helios-ovmm": "0.1.0"},
        "commands": [[",".join(NEW) if w == ",".join(OLD) else w for w in COMMAND]],
        "asked": [{"agents": list(NEW), "seed0": 0}],
        "ran_with": {agent: {"planner.tau_g": str(k)} for k, agent in enumerate(NEW)},
    }
    rows = json.loads((folder / "results.json").read_text())
    assert [row["agent"] for row in rows] == list(NEW)
    assert all(row["metrics"] == {"SR": {"mean": 1 / 3}} for row in rows)


def test_relabelled_results_are_refused_and_unchanged(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert relabel_agents.main([str(folder)]) == 0
    before = contents(folder)
    assert relabel_agents.main([str(folder)]) == 2
    assert "relabelled already" in capsys.readouterr().err
    assert contents(folder) == before


def test_results_with_a_current_name_are_refused_even_without_the_relabelled_entry(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert relabel_agents.main([str(folder)]) == 0
    run = json.loads((folder / "run.json").read_text())
    del run["relabelled"]
    (folder / "run.json").write_text(json.dumps(run))
    assert relabel_agents.main([str(folder)]) == 2
    assert "episodes of helios-paper" in capsys.readouterr().err


def test_a_refused_folder_leaves_the_other_folders_unchanged(
    folder: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    unpacked = tmp_path_factory.mktemp("run")
    (unpacked / EPISODES).write_text("")
    before = contents(folder)
    assert relabel_agents.main([str(folder), str(unpacked)]) == 2
    assert contents(folder) == before


@pytest.mark.parametrize(
    ("words", "wanted"),
    [
        (
            ["helios", "eval", "video", "--agent", "helios"],
            "helios eval video --agent helios-paper",
        ),
        (["helios", "--agents=helios-next,vlfm"], "helios --agents=helios,vlfm"),
        (["helios", "eval", "report", "helios-next"], "helios eval report helios-next"),
    ],
)
def test_a_command_is_relabelled_only_in_its_agent_options(words: list[str], wanted: str) -> None:
    assert " ".join(relabel_agents.relabelled_command(words)) == wanted


def test_the_committed_results_are_relabelled() -> None:
    """Runs from before the agents' new names; only those do not say when they started. Of `paper`
    only the report is kept."""
    results = Path(__file__).parents[2] / "docs/results"
    for run in sorted(r for r in results.glob("*/run.json") if r.parent.name != "paper"):
        about = json.loads(run.read_text())
        assert about.keys() & {"started", "folders", "relabelled"}, run
        agents = {record.agent for record in episode_record.read(run.parent)}
        assert "helios-next" not in agents
