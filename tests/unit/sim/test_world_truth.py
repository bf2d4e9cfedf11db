"""Tests the truth that the world gives the evaluation: objects, trajectory and events."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helios_core.robot import Forward, Observe, Pick, Place, Turn
from helios_sim.episode_events import PickTried, PlaceTried
from helios_sim.episode_tracker import objectnav_episode_of
from helios_sim.failure_causes import AgentReport, failure_cause
from helios_sim.ground_truth_solver import GroundTruthSolver
from helios_sim.home import Home
from helios_sim.object_states import upright_box
from helios_sim.objectnav_metrics import MIN_SHORTEST_M
from helios_sim.world import World

from tests.unit.sim.open_floor import drive_to_open_floor


def test_object_states_list_every_object_at_its_true_position(world: World, sim_home: Home):
    things = {thing.name: thing for thing in world.object_states()}
    assert len(things) == len(sim_home.receptacles) + len(sim_home.fixtures) + len(sim_home.objects)
    for item in sim_home.receptacles:
        there = things[item.name]
        assert (there.class_name, there.size_m) == (item.class_name, item.size_m)
        assert there.center_m == (item.x, item.y, item.size_m[2] / 2)
        assert not there.graspable
    for thing in sim_home.objects:
        there = things[thing.name]
        assert there.graspable
        assert (there.class_name, there.on) == (thing.class_name, thing.receptacle)
        assert np.allclose(there.center_m, thing.position_m, atol=0.02)
        assert np.allclose(there.size_m, thing.size_m, atol=0.02)


def test_a_carried_and_dropped_object_is_listed_at_its_true_position(world: World):
    name = next(iter(world.tracker.targets.objects))
    oracle = GroundTruthSolver(world)
    assert oracle.fetch(name)
    held = next(thing for thing in world.object_states() if thing.name == name)
    assert held.on == ""
    x, y = world.trajectory_m[-1]
    assert math.hypot(held.center_m[0] - x, held.center_m[1] - y) < 0.3
    drive_to_open_floor(oracle, world)
    x, y = world.trajectory_m[-1]
    yaw = math.atan2(*world.state().T_world_base[1::-1, 0])
    world.act(Place((x + 0.6 * math.cos(yaw), y + 0.6 * math.sin(yaw), 0.02)), "drop")
    dropped = next(thing for thing in world.object_states() if thing.name == name)
    assert dropped.on == ""
    assert dropped.center_m[2] < 0.3
    picked, placed = (e for e in world.events if isinstance(e, PickTried | PlaceTried))
    assert isinstance(picked, PickTried)
    assert isinstance(placed, PlaceTried)
    assert (picked.name, picked.candidate, picked.at_candidate) == (name, True, True)
    assert (placed.name, placed.released, placed.on_floor, placed.placed) == (
        name,
        True,
        True,
        False,
    )
    assert picked.step < placed.step == world.progress.steps


def test_a_pick_at_an_empty_point_is_an_event(world: World):
    world.act(Observe(), "look")
    world.act(Pick((0.0, 0.0, 5.0), "mug"), "pick")
    (tried,) = world.events
    assert isinstance(tried, PickTried)
    assert tried == PickTried(2, 0.0, "mug", False, reason=tried.reason)
    assert "nothing to grasp" in tried.reason


def test_the_trajectory_has_a_point_for_the_start_and_each_action(world: World, sim_home: Home):
    assert np.allclose(world.trajectory_m, [sim_home.start_pose[:2]], atol=1e-3)
    for k, action in enumerate((Turn(0.3), Forward(0.2), Observe())):
        world.act(action, f"a{k}")
    track = world.trajectory_m
    assert track.shape == (4, 2)
    lengths = np.hypot(*np.diff(track, axis=0).T)
    assert lengths.sum() == pytest.approx(world.progress.path_m, abs=0.01)
    assert np.allclose(track[-1], world.state().T_world_base[:2, 3], atol=1e-6)


def test_the_upright_box_of_an_upright_object_has_its_own_size_and_yaw():
    c, s = math.cos(0.7), math.sin(0.7)
    R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    size, yaw = upright_box(R, (0.3, 0.2, 0.1))
    assert size == pytest.approx((0.3, 0.2, 0.1))
    assert yaw == pytest.approx(0.7)


def test_the_upright_box_of_a_fallen_object_has_its_rotated_size():
    R = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])  # about y, by 90 degrees
    size, _ = upright_box(R, (0.1, 0.2, 0.4))
    assert size[2] == pytest.approx(0.1)
    assert sorted(size[:2]) == pytest.approx([0.2, 0.4])


def test_object_navigation_succeeds_at_a_viewpoint_and_nowhere_else(sim_home: Home):
    episode = objectnav_episode_of(sim_home, 0, 0.3)
    assert episode.instruction == f"Find the {episode.object_class}"
    assert episode == objectnav_episode_of(sim_home, 0, 0.3)
    world = World(sim_home, episode)
    try:
        assert not world.arrived()
        shortest_m = world.tracker.shortest_path_m()
        assert shortest_m >= MIN_SHORTEST_M
        viewpoints = np.concatenate(list(world.tracker.targets.objects.values()))
        oracle = GroundTruthSolver(world)
        arrived = []
        for x, y in viewpoints[:: max(1, len(viewpoints) // 6)]:
            assert oracle.go_near((x, y))
            away_m = np.hypot(*(viewpoints - world.trajectory_m[-1]).T).min()
            assert world.arrived() == (away_m <= 0.1)
            arrived.append(world.arrived())
        assert any(arrived)
        assert world.progress.path_m > shortest_m - 0.1
    finally:
        world.close()


def test_driving_against_a_wall_is_one_collision(world: World):
    for k in range(20):
        if not world.act(Forward(1.0), f"on-{k}").succeeded:
            break
    assert world.progress.collisions == 1


def test_an_object_that_falls_from_the_edge_of_the_goal_counts_as_rolled_off(
    world: World, sim_home: Home
):
    name = next(iter(world.tracker.targets.objects))
    goal = next(iter(world.tracker.targets.goals))
    oracle = GroundTruthSolver(world)
    assert oracle.fetch(name)
    surface = sim_home.receptacle(goal).surfaces[0]
    c, s = math.cos(surface.yaw_rad), math.sin(surface.yaw_rad)
    before_m = surface.half_extent_xy[1] + 0.02  # its middle is beyond the front edge
    x, y = surface.center_xy[0] + s * before_m, surface.center_xy[1] - c * before_m
    assert oracle.go_near((x, y))
    assert oracle.face(np.array([x, y, surface.height_m]))
    assert world.act(Place((x, y, surface.height_m)), "edge").succeeded
    fell = world.events[-1]
    assert isinstance(fell, PlaceTried)
    assert (fell.rolled_off, fell.on_floor, fell.placed) == (True, True, False)
    assert not world.progress.place
    cause = failure_cause(world.progress, world.events, AgentReport("succeeded"), 1250)
    assert cause == "object rolled off"
