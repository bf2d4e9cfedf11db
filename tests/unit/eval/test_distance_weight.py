"""Tests the study of the distance weight: repeated decisions, and one short episode."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from helios_core.errors import InvalidInput
from helios_core.types import ObjectInstance
from helios_eval.studies.distance_weight import decisions_of, main, rows_of, table
from helios_planner.decisions.decision import Decision, FrontierOption, ReceptacleOption
from helios_planner.decisions.gain import Gain, normalised_gain
from helios_planner.decisions.global_search import (
    ChosenFrontier,
    FirstSeen,
    SearchMemory,
    by_objective,
)


def option(id: int, gain: Gain, away_m: float) -> ReceptacleOption:
    instance = ObjectInstance(
        id, "table", np.array([float(id), 0.0, 0.5]), np.ones(3), 0.4, 0.5, 0.1, 2, gain.gaussians,
        {}, 0.5, np.empty((0, 2)),
    )  # fmt: skip
    return ReceptacleOption(instance, 0.5, normalised_gain(gain, "sum"), away_m, gain=gain)


NEAR = option(1, Gain(1000.0, 1000, 1.0, 10_000.0), 1.0)
FAR = option(2, Gain(100.0, 10, 0.5, 1000.0), 5.0)
FRONTIER = FrontierOption(3, (0.0, 0.0), 0.3, 2.0)
EMPTY = SearchMemory()


def rows(*decisions: Decision) -> dict[str, dict]:
    return {row.norm: row.as_json() for row in rows_of(decisions, "sum")}


def test_decisions_are_repeated_in_the_units_of_every_norm() -> None:
    """By the sum and per area the near table wins, per Gaussian the far one."""
    decision = by_objective([NEAR, FAR], [FRONTIER], EMPTY, 0.001)
    got = rows(decision)
    assert {norm: r["other_winner_than_played"] for norm, r in got.items()} == {
        "sum": 0,
        "per_gaussian": 1,
        "per_area": 0,
        "per_pixel": 1,
    }
    wins = {norm: r["receptacle_wins"] for norm, r in got.items()}
    assert wins == {"sum": 1, "per_gaussian": 1, "per_area": 1, "per_pixel": 0}
    assert all(r["receptacle_wins"] + r["frontier_wins"] == 1 for r in got.values())


def test_first_seen_gains_are_repeated_in_the_units_too() -> None:
    """F_0 is a ratio of a first-seen gain and a frontier's value."""
    memory = SearchMemory({1: FirstSeen(0.5, 1000.0, (0.0, 0.0), NEAR.gain)})
    memory.choose(ChosenFrontier((0.0, 0.0), 0.25))
    decision = by_objective([FAR], [FRONTIER], memory, 0.001)
    assert rows(decision)["per_pixel"]["both"] == 1
    scale = {norm: row["frontier_scale"] for norm, row in rows(decision).items()}
    assert scale["sum"] == [decision.settings["frontier_scale"]] == [0.5 * 1000.0 / 0.25]
    assert scale["per_gaussian"] == [0.5 * 1.0 / 0.25]
    memory.first_seen[9] = FirstSeen(0.5, 1.0, (0.0, 0.0))
    with pytest.raises(InvalidInput, match="does not hold what gain_norm=sum needs"):
        rows(by_objective([FAR], [FRONTIER], memory, 0.001))


def test_only_a_weight_that_outweighs_the_gain_changes_a_winner() -> None:
    """The far frontier is worth 0.1 more and lies 20 m farther away."""
    near, far = FrontierOption(3, (0.0, 0.0), 0.3, 2.0), FrontierOption(4, (0.0, 0.0), 0.4, 22.0)
    alone = by_objective([], [near], EMPTY, 0.001)
    decision = by_objective([], [near, far], EMPTY, 0.001)
    for row in rows(alone, decision).values():
        assert (row["decisions"], row["both"]) == (1, 0)
        assert row["changed_by_alpha_d"] == {"0.0001": 0, "0.001": 0, "0.01": 1, "0.1": 1}
        assert row["changed_by_alpha_d_of_both"]["0.1"] == 0
    said = table(rows_of([alone, decision], "sum"), "sum")
    assert "| sum | 1 | 0 | – | – | – | – | 0, 0% (–) | 1, 100% (–) | 1, 100% (–) |" in said


@pytest.mark.parametrize("flags", [["--seed0", "999"], ["--seed0", "2000"], ["--episodes", "0"]])
def test_homes_of_published_results_are_refused(
    flags: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--episodes", "2", *flags, "--out", str(tmp_path / "out")]) == 1
    said = capsys.readouterr().err
    assert "belong to published results" in said or "wanted at least one" in said
    assert not (tmp_path / "out").exists()


def test_an_episode_is_played_once_and_its_decisions_hold_their_gains(tmp_path: Path) -> None:
    flags = [
        "--preset", "demo-v1", "--seed0", "0", "--episodes", "1", "--max-steps", "60",
        "--semantics", "ground-truth", "--set", "alpha_d=0.02", "--out", str(tmp_path),
    ]  # fmt: skip
    assert main(flags) == 0
    first = (tmp_path / "episodes.jsonl").read_text()
    (episode,) = map(json.loads, first.splitlines())
    decisions = decisions_of(episode)
    assert decisions
    assert all(d.settings["alpha_d"] == 0.02 for d in decisions)
    study = json.loads((tmp_path / "study.json").read_text())
    assert study["settings"] == {
        "planner.alpha_d": "0.02",
        "planner.gain_norm": "sum",
        "max_steps": "60",
        "detector.scorer": "simulated:itc-v1",
    }
    assert study["rows"][0]["decisions"] == sum(len(d.candidates) > 1 for d in decisions)
    assert main(flags) == 0
    assert (tmp_path / "episodes.jsonl").read_text() == first
