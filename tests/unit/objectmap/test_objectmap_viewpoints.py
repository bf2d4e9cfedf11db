"""The weight of a frame: distinct viewpoints count, not frames."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helios_objectmap import viewpoint_weights as module
from helios_objectmap.viewpoint_weights import FIRST_UPDATE, NEVER, Viewpoints
from hypothesis import given, settings
from hypothesis import strategies as st
from objectmap_scene import looking_at, pose

BORN = np.array([0])


def new_viewpoints() -> Viewpoints:
    return Viewpoints(moved_m=0.1, turned_rad=math.radians(5))


def weigh(points: Viewpoints, T_world_cam, update: int = 1, born=BORN) -> list[float]:
    look = points.locate(T_world_cam)
    out = points.weights(look, ["mug"], born)[:, 0].tolist()
    points.mark(look, ["mug"], update)
    return out


def test_the_first_view_and_a_view_a_step_or_turn_away_have_full_weight():
    for other in (
        pose(x=0.1001),
        pose(yaw=math.radians(5.01)),
        pose(tilt=0.45 + math.radians(5.01)),
    ):
        points = new_viewpoints()
        assert weigh(points, pose()) == [1.0]
        assert weigh(points, other) == [1.0]


def test_by_the_printed_rule_every_view_counts_in_full():
    points = Viewpoints(moved_m=0.1, turned_rad=math.radians(5), all_in_full=True)
    assert [weigh(points, pose()) for _ in range(3)] == [[1.0]] * 3


def test_a_repeated_view_has_no_weight_even_with_camera_jitter():
    points = new_viewpoints()
    weigh(points, pose())
    rng = np.random.default_rng(0)
    for dx, dyaw in rng.uniform(-1, 1, (200, 2)) * (0.006, math.radians(0.3)):
        assert weigh(points, pose(x=dx, yaw=dyaw)) == [0.0]
    assert len(points) == 1


def test_half_a_step_has_half_weight_and_a_turn_adds_to_the_weight():
    points = new_viewpoints()
    weigh(points, pose())
    assert weigh(points, pose(x=0.05)) == pytest.approx([0.5])
    points = new_viewpoints()
    weigh(points, pose())
    assert weigh(points, pose(x=0.04, yaw=math.radians(1.5))) == pytest.approx([0.7])


def test_a_return_to_a_former_viewpoint_has_no_weight():
    points = new_viewpoints()
    for i in range(40):
        weigh(points, looking_at(0.3 * i, 0, (5, 0, 0.8)))
    assert weigh(points, looking_at(0.3, 0, (5, 0, 0.8))) == [0.0]


@settings(max_examples=30, deadline=None)
@given(st.floats(0.005, 0.1), st.floats(0, math.pi))
def test_weights_along_a_path_add_up_to_its_length_at_any_frame_rate(step_m, heading):
    points = new_viewpoints()
    steps = np.arange(0.0, 1.0, step_m)
    total = sum(weigh(points, pose(s * np.cos(heading), s * np.sin(heading)))[0] for s in steps)
    # The first view weighs 1; the distance since the last view that counted is not in the sum yet.
    assert total == pytest.approx(1 + steps[-1] / 0.1, abs=module.SAME + 1e-6)


def test_a_view_counts_once_per_class_and_again_for_gaussians_created_later():
    points = new_viewpoints()
    assert weigh(points, pose(), update=3, born=np.array([0, 7])) == [1.0, 1.0]
    look = points.locate(pose())
    weights = points.weights(look, ["mug", "bowl"], np.array([0, 3, 4]))
    assert weights.tolist() == [[0, 1], [0, 1], [1, 1]]


def test_a_view_that_counted_at_the_first_update_counts_again_for_a_new_class_alone():
    points = new_viewpoints()
    points.mark(points.locate(pose()), ["mug"], FIRST_UPDATE)
    look = points.locate(pose())
    assert points.weights_of_view(look, ["mug", "cup"]).tolist() == [0, 1]


def test_only_viewpoints_since_a_gaussians_creation_reduce_its_weight():
    points = new_viewpoints()
    weigh(points, pose(), update=1)
    weigh(points, pose(x=0.06), update=5)
    # 2 cm from the second viewpoint and 8 cm from the first.
    look = points.locate(pose(x=0.08))
    got = points.weights(look, ["mug"], np.array([0, 3, 6]))[:, 0]
    assert got == pytest.approx([0.0, 0.0, 1.0])
    look = points.locate(pose(x=-0.04))
    assert points.weights(look, ["mug"], np.array([0, 3, 6]))[:, 0] == pytest.approx([0.4, 1, 1])


def test_the_difference_from_a_former_viewpoint_grows_with_the_distance_up_to_1():
    points = new_viewpoints()
    first = points.locate(pose()).viewpoint
    here = points.locate(pose(x=0.07))
    got = points.difference_from(here, np.array([first, here.viewpoint, NEVER]))
    assert got == pytest.approx([0.7, 0.0, 1.0])


def test_the_oldest_viewpoints_are_forgotten_so_that_their_number_is_limited(monkeypatch):
    monkeypatch.setattr(module, "MOST", 32)
    points = new_viewpoints()
    for i in range(100):
        weigh(points, pose(x=0.2 * i), update=i)
    assert len(points) == 32
    assert weigh(points, pose(x=0.2 * 99)) == [0.0]
    assert weigh(points, pose(x=0.0)) == [1.0]
