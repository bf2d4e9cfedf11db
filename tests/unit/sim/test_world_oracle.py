"""Tests that the demo's tasks can be solved and that the metrics show success."""

from __future__ import annotations

import pytest
from helios_sim.episode_tracker import episode_of
from helios_sim.ground_truth_solver import GroundTruthSolver
from helios_sim.home import PRESETS, generate_home
from helios_sim.world import World


@pytest.mark.parametrize("seed", [0, 7])
def test_the_ground_truth_solver_succeeds_without_a_collision(seed: int):
    home = generate_home(seed, PRESETS["demo-v1"])
    world = World(home, episode_of(home, seed))
    done = GroundTruthSolver(world).run()
    world.close()
    assert (done.find_object, done.pick, done.find_receptacle, done.place) == (True,) * 4
    assert done.collisions == 0
    assert done.success
