"""Fixtures: a home and worlds for several tests."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest
from helios_sim.episode_tracker import episode_of
from helios_sim.home import PRESETS, Home, generate_home
from helios_sim.world import World


@pytest.fixture(scope="session")
def sim_home() -> Home:
    """The home of seed 0."""
    return generate_home(0, PRESETS["demo-v1"])


@pytest.fixture
def make_world(sim_home: Home) -> Iterator[Callable[[], World]]:
    """Makes new worlds in the home of seed 0."""
    made: list[World] = []

    def make() -> World:
        made.append(World(sim_home, episode_of(sim_home, 0), boot_id="boot"))
        return made[-1]

    yield make
    for world in made:
        world.close()


@pytest.fixture
def world(make_world: Callable[[], World]) -> World:
    """A new world in the home of seed 0."""
    return make_world()
