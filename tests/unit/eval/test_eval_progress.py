"""Tests the progress output of a run."""

from __future__ import annotations

import io

from eval_constructed_records import record
from helios_eval.episodes.episode_spec import EpisodeSpec
from helios_eval.runs.progress import Board
from rich.console import Console

SPECS = [
    EpisodeSpec("ovmm", agent, "noisy", "ovmm-v1", seed, None)
    for seed in range(2)
    for agent in ("helios", "trusting")
]


def shown(terminal: bool) -> str:
    file = io.StringIO()
    console = Console(file=file, force_terminal=terminal, width=100)
    known = [record(0, agent="helios", steps=100, wall_s=10.0)]
    with Board(console, known, SPECS, "2 at a time") as board:
        board.add(record(0, agent="trusting", success=False, pick=False, cause="collision"))
        board.add(record(1, agent="helios", success=False, steps=300, wall_s=20.0))
    return file.getvalue()


def test_without_a_terminal_every_episode_prints_a_line() -> None:
    lines = shown(terminal=False).splitlines()
    assert lines[0] == "1 of 4 episodes are there already"
    assert lines[1].startswith("2/4 trusting seed 0: collision, 100 steps")
    assert "SR 50% Pick 100% of 2" in lines[2]
    assert lines[2].endswith("left")
    assert len(lines) == 3


def test_a_terminal_shows_the_metrics_of_each_agent() -> None:
    text = shown(terminal=True)
    last = text[text.rindex("agent") :]
    assert "2/2" in last  # of helios
    assert "50.0%" in last
    assert "0.075" in last  # seconds per step: 30 s, 400 steps
    assert "3/4, 2 at a time" in last
