"""Tests that the demo's tasks can be solved and that the metrics show success."""

from __future__ import annotations

from argparse import ArgumentTypeError

import pytest
from helios_sim.episode_tracker import episode_of
from helios_sim.ground_truth_solver import GroundTruthSolver, seeds_of
from helios_sim.home import PRESETS, generate_home
from helios_sim.world import World


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("1000", "in the ledger"),
        ("990-2400", "in the ledger"),
        ("9-0", "write 3"),
        ("x", "write 3"),
    ],
)
def test_the_ground_truth_solver_plays_homes_for_development_only(text: str, words: str) -> None:
    assert list(seeds_of("998-999")) == [998, 999]
    with pytest.raises(ArgumentTypeError, match=words):
        seeds_of(text)


@pytest.mark.parametrize("seed", [0, 7])
def test_the_ground_truth_solver_succeeds_without_a_collision(seed: int):
    home = generate_home(seed, PRESETS["demo-v1"])
    world = World(home, episode_of(home, seed))
    done = GroundTruthSolver(world).run()
    world.close()
    assert (done.find_object, done.pick, done.find_receptacle, done.place) == (True,) * 4
    assert done.collisions == 0
    assert done.success
