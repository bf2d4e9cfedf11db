"""Tests the episode tracker's event of a release, for each place where the object may rest."""

from __future__ import annotations

import pytest
from helios_sim.episode_events import PlaceTried
from helios_sim.episode_tracker import EpisodeTracker, episode_of
from helios_sim.home import Home
from helios_sim.ovmm_metrics import ReleaseResult
from helios_sim.robot_model import BASE_BODY


@pytest.fixture
def tracker(sim_home: Home) -> EpisodeTracker:
    return EpisodeTracker(sim_home, episode_of(sim_home, 0), 0.3)


def released_on(tracker: EpisodeTracker, body: str) -> PlaceTried:
    name = next(iter(tracker.targets.objects))
    tracker.place_tried(name, ReleaseResult(name, True, {body: 0.2}, 0.25), "")
    (event,) = tracker.events
    assert isinstance(event, PlaceTried)
    return event


def test_an_object_that_falls_onto_the_robot_is_neither_placed_nor_on_the_floor(
    tracker: EpisodeTracker,
) -> None:
    event = released_on(tracker, BASE_BODY)
    assert event.on == (BASE_BODY,)
    assert not any((event.met_goal, event.placed, event.on_floor))


def test_an_object_on_the_floor_is_recorded_as_on_the_floor(
    tracker: EpisodeTracker, sim_home: Home
) -> None:
    floor = next(n for n in sim_home.body_names() if sim_home.class_of(n) == "floor")
    assert released_on(tracker, floor).on_floor


def test_an_object_in_the_hand_is_not_found_by_looking_at_it(tracker: EpisodeTracker) -> None:
    name, viewpoints = next(iter(tracker.targets.objects.items()))
    at = (float(viewpoints[0, 0]), float(viewpoints[0, 1]))
    assert name in tracker.targets_needing_coverage(at, "")
    assert name not in tracker.targets_needing_coverage(at, name)
