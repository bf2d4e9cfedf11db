"""Tests driving, grasping and releasing in a home."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helios_core.errors import InvalidInput
from helios_core.geometry import wrap_angle, yaw_of
from helios_core.robot import Forward, Observe, Pick, Place, Tilt, Turn
from helios_sim.episode_tracker import reachable
from helios_sim.ground_truth_solver import GroundTruthSolver
from helios_sim.home import Home
from helios_sim.world import World

from tests.unit.sim.open_floor import drive_to_open_floor


def position(world: World) -> np.ndarray:
    return world.state().T_world_base[:2, 3]


def fetch_the_object(world: World) -> str:
    """Let the ground-truth solver pick the task's object; the object's name."""
    name = next(iter(world.tracker.targets.objects))
    assert GroundTruthSolver(world).fetch(name)
    return name


def test_forward_moves_the_given_distance_straight_ahead(world: World):
    before, yaw = position(world), yaw_of(world.state().T_world_base)
    done = world.act(Forward(0.25), "go")
    assert done.succeeded
    assert done.moved_m == pytest.approx(0.25, abs=0.005)
    ahead = np.array([math.cos(yaw), math.sin(yaw)])
    assert np.allclose(position(world) - before, 0.25 * ahead, atol=0.005)
    assert not done.collided


def test_turn_rotates_the_robot_on_the_spot(world: World):
    before = position(world)
    for angle_rad in (math.radians(5), -math.radians(30), 0.4):
        yaw = yaw_of(world.state().T_world_base)
        done = world.act(Turn(angle_rad), f"turn {angle_rad}")
        assert done.succeeded
        assert done.turned_rad == pytest.approx(angle_rad, abs=0.01)
        turned = wrap_angle(yaw_of(world.state().T_world_base) - yaw)
        assert turned == pytest.approx(angle_rad, abs=0.01)
    assert np.allclose(position(world), before, atol=0.005)


def test_actions_outside_the_limits_do_nothing(world: World):
    before = world.state().T_world_base
    wrong = (Forward(0.05), Forward(1.2), Forward(-0.4), Turn(0.01), Turn(-0.6))
    for action in (*wrong, Tilt(2.0), Tilt(-1.0)):
        done = world.act(action, repr(action))
        assert not done.succeeded
        assert "outside" in done.reason
    assert world.progress.steps == 0
    assert np.array_equal(world.state().T_world_base, before)


def test_an_obstacle_blocks_the_robot_and_counts_one_collision_per_step(world: World):
    done = world.act(Forward(1.0), "go")
    for k in range(15):
        if not done.succeeded:
            break
        done = world.act(Forward(1.0), f"go-{k}")
    assert done.collided
    assert "blocked" in done.reason
    assert done.moved_m < 1.0
    assert world.progress.collisions == 1
    assert world.progress.collided_with
    assert not world.progress.success
    # The robot can drive away from the obstacle again.
    for k in range(6):
        assert world.act(Turn(math.pi / 6), f"away-{k}").succeeded
    assert world.act(Forward(0.3), "back").succeeded


def test_an_action_id_runs_once(world: World):
    first = world.act(Forward(0.2), "one")
    at = position(world)
    assert world.act(Forward(0.2), "one") == first
    assert np.array_equal(position(world), at)
    assert world.progress.steps == 1


def test_an_action_needs_an_id(world: World):
    with pytest.raises(InvalidInput):
        world.act(Observe(), "")


def test_stop_latches_until_cleared(world: World):
    world.stop("a person said so")
    assert world.state().stopped
    done = world.act(Forward(0.2), "go")
    assert not done.succeeded
    assert "a person said so" in done.reason
    world.clear_stop()
    assert not world.state().stopped
    assert world.act(Forward(0.2), "go").succeeded


def test_a_pick_at_an_empty_point_fails(world: World):
    x, y = (float(v) for v in position(world))
    done = world.act(Pick((x, y, 2.2), "mug"), "pick")
    assert not done.succeeded
    assert "nothing to grasp" in done.reason
    assert world.state().held == ""


def test_a_pick_from_across_the_home_is_out_of_reach(world: World, sim_home: Home):
    at = position(world)
    thing = max(sim_home.objects, key=lambda o: math.dist(o.position_m[:2], at))
    done = world.act(Pick(thing.position_m, thing.class_name), "pick")
    assert not done.succeeded
    assert "out of reach" in done.reason


def test_an_object_outside_the_view_is_not_picked(world: World):
    name = next(iter(world.tracker.targets.objects))
    oracle = GroundTruthSolver(world)
    assert oracle.approach(name)
    world.act(Tilt(-0.6), "look up")
    x, y, z = (float(v) for v in world.position_m(name))
    done = world.act(Pick((x, y, z), "thing"), "pick")
    assert not done.succeeded
    assert "not in view" in done.reason


def test_a_held_object_is_invisible_to_the_camera_and_falls_by_physics_when_released(world: World):
    name = fetch_the_object(world)
    asked_as = world.state().held
    assert asked_as == world.episode.object_class
    for k in range(3):
        world.act(Turn(0.5), f"turn-{k}")
        for tilt in (-0.6, 1.2):
            world.act(Tilt(tilt), f"tilt-{k}-{tilt}")
            seen = world.segmentation(world.capture().stamp_ns).instances
            assert name not in {i.name for i in seen}
    assert np.linalg.norm(world.position_m(name)[:2] - position(world)) < 0.3
    x, y = position(world)
    yaw = yaw_of(world.state().T_world_base)
    spot = (float(x + 0.55 * math.cos(yaw)), float(y + 0.55 * math.sin(yaw)), 0.02)
    second = world.act(Pick(spot, "mug"), "second")
    assert not second.succeeded
    assert "already holds" in second.reason
    done = world.act(Place(spot), "drop")
    assert done.succeeded, done.reason
    assert world.held_name == ""
    assert world.state().held == ""
    assert world.position_m(name)[2] < 0.3
    assert not world.progress.place


def test_pushing_a_movable_object_is_no_collision(world: World):
    name = fetch_the_object(world)
    oracle = GroundTruthSolver(world)
    drive_to_open_floor(oracle, world)
    x, y = position(world)
    yaw = yaw_of(world.state().T_world_base)
    spot = (float(x + 0.5 * math.cos(yaw)), float(y + 0.5 * math.sin(yaw)), 0.02)
    assert world.act(Place(spot), "drop").succeeded
    before = world.position_m(name)
    world.act(Forward(0.5), "push")
    assert np.linalg.norm(world.position_m(name) - before) > 0.02
    assert world.progress.collisions == 0


def test_a_place_with_an_empty_gripper_or_out_of_reach_fails(world: World):
    assert "empty" in world.act(Place((0.0, 0.0, 0.5)), "empty").reason
    name = fetch_the_object(world)
    done = world.act(Place((-5.0, 0.0, 0.5)), "far")
    assert "out of reach" in done.reason
    assert world.held_name == name


def test_a_place_through_a_wall_fails(world: World, sim_home: Home):
    fetch_the_object(world)
    oracle = GroundTruthSolver(world)
    free, origin_m = reachable(sim_home, 0.35)
    rows, columns = np.nonzero(free)
    nearest_wall = int(np.argmin(columns))
    y = origin_m[1] + 0.05 * (rows[nearest_wall] + 0.5)
    assert oracle.go_near((origin_m[0], y))
    behind = (sim_home.bounds[0] - 0.1, float(position(world)[1]), 0.5)
    assert position(world)[0] - behind[0] < 0.8
    oracle.face(np.array(behind))
    assert "in the arm's way" in world.act(Place(behind), "through").reason
