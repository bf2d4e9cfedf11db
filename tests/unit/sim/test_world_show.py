"""The robot shows a held object to its camera, turned, until its next motion."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helios_core.geometry import project
from helios_core.robot import Observe, Show, Tilt, Turn
from helios_sim.ground_truth import Segmentation, VisibleBody
from helios_sim.ground_truth_solver import GroundTruthSolver
from helios_sim.robot_model import SHOW_BASE_M
from helios_sim.world import World


def fetch_the_object(world: World) -> str:
    """Let the ground-truth solver pick the task's object; the object's name."""
    name = next(iter(world.tracker.targets.objects))
    assert GroundTruthSolver(world).fetch(name)
    return name


def show_point_m(world: World) -> np.ndarray:
    T = world.state().T_world_base
    return T[:3, :3] @ np.array(SHOW_BASE_M) + T[:3, 3]


def truth_now(world: World) -> Segmentation:
    return world.segmentation(world.capture().stamp_ns)


def seen_as(world: World, name: str) -> VisibleBody | None:
    return next((i for i in truth_now(world).instances if i.name == name), None)


def test_an_empty_gripper_shows_nothing(world: World) -> None:
    done = world.act(Show(0.0), "show")
    assert not done.succeeded
    assert done.reason == "the gripper is empty; pick something first"


def test_the_held_object_is_shown_where_the_description_says(world: World) -> None:
    name = fetch_the_object(world)
    assert seen_as(world, name) is None  # carried behind the camera
    world.act(Tilt(0.35), "tilt")
    assert world.act(Show(1.0), "show").succeeded
    capture = world.capture()
    truth = world.segmentation(capture.stamp_ns)
    (shown,) = (i for i in truth.instances if i.name == name)
    assert np.allclose(shown.center_m, show_point_m(world), atol=1e-6)
    assert shown.turn_rad == pytest.approx(1.0)
    pixel, _ = project(show_point_m(world)[None], capture.camera, capture.T_world_cam)
    rows, columns = np.nonzero(truth.ids == shown.id)
    assert np.hypot(columns.mean() - pixel[0, 0], rows.mean() - pixel[0, 1]) < 60
    depth_m = capture.depth_m[rows, columns]
    assert 0.25 < np.median(depth_m) < 0.7
    assert world.describe().show_base_m == SHOW_BASE_M


def test_it_is_turned_about_the_vertical(world: World) -> None:
    name = fetch_the_object(world)
    world.act(Show(0.0), "first")
    before = world._data.body(name).xmat.reshape(3, 3).copy()
    world.act(Show(math.pi / 2), "second")
    after = world._data.body(name).xmat.reshape(3, 3)
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert np.allclose(after, quarter @ before, atol=1e-6)


def test_it_stays_shown_while_the_robot_looks_and_ends_with_a_motion(world: World) -> None:
    name = fetch_the_object(world)
    world.act(Show(0.5), "show")
    world.act(Tilt(0.4), "tilt")
    world.act(Observe(), "look")
    shown = seen_as(world, name)
    assert shown is not None
    assert shown.turn_rad == pytest.approx(0.5)
    world.act(Turn(0.3), "turn")
    assert seen_as(world, name) is None
    assert world.held_name == name
