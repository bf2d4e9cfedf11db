"""Views, not frames: what a frame weighs."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helios_objectmap import viewpoint_weights as module
from helios_objectmap.viewpoint_weights import NEVER, Viewpoints
from hypothesis import given, settings
from hypothesis import strategies as st
from objectmap_scene import looking_at, pose

BORN = np.array([0])


def made() -> Viewpoints:
    return Viewpoints(moved_m=0.1, turned_rad=math.radians(5))


def weigh(points: Viewpoints, T_world_cam, update: int = 1, born=BORN) -> list[float]:
    look = points.locate(T_world_cam)
    out = points.weights(look, ["mug"], born)[:, 0].tolist()
    points.mark(look, ["mug"], update)
    return out


def test_the_first_view_and_one_a_step_or_a_turn_away_weigh_all():
    for other in (
        pose(x=0.1001),
        pose(yaw=math.radians(5.01)),
        pose(tilt=0.45 + math.radians(5.01)),
    ):
        points = made()
        assert weigh(points, pose()) == [1.0]
        assert weigh(points, other) == [1.0]


def test_the_same_view_again_weighs_nothing_nor_does_trembling():
    points = made()
    weigh(points, pose())
    rng = np.random.default_rng(0)
    for dx, dyaw in rng.uniform(-1, 1, (200, 2)) * (0.006, math.radians(0.3)):
        assert weigh(points, pose(x=dx, yaw=dyaw)) == [0.0]
    assert len(points) == 1


def test_half_a_step_weighs_half_and_half_a_turn_adds_to_it():
    points = made()
    weigh(points, pose())
    assert weigh(points, pose(x=0.05)) == pytest.approx([0.5])
    points = made()
    weigh(points, pose())
    assert weigh(points, pose(x=0.04, yaw=math.radians(1.5))) == pytest.approx([0.7])


def test_coming_back_weighs_nothing():
    points = made()
    for i in range(40):
        weigh(points, looking_at(0.3 * i, 0, (5, 0, 0.8)))
    assert weigh(points, looking_at(0.3, 0, (5, 0, 0.8))) == [0.0]


@settings(max_examples=30, deadline=None)
@given(st.floats(0.005, 0.1), st.floats(0, math.pi))
def test_weights_along_a_path_add_up_to_its_length_at_any_rate(step_m, heading):
    points = made()
    steps = np.arange(0.0, 1.0, step_m)
    total = sum(weigh(points, pose(s * np.cos(heading), s * np.sin(heading)))[0] for s in steps)
    # The first view weighs 1; what was walked since the last one that counted is still to come.
    assert total == pytest.approx(1 + steps[-1] / 0.1, abs=module.SAME + 1e-6)


def test_a_view_counts_once_per_class_and_anew_for_gaussians_made_later():
    points = made()
    assert weigh(points, pose(), update=3, born=np.array([0, 7])) == [1.0, 1.0]
    look = points.locate(pose())
    weights = points.weights(look, ["mug", "bowl"], np.array([0, 3, 4]))
    assert weights.tolist() == [[0, 1], [0, 1], [1, 1]]


def test_only_viewpoints_that_counted_since_a_gaussian_was_made_take_weight():
    points = made()
    weigh(points, pose(), update=1)
    weigh(points, pose(x=0.06), update=5)
    # 2 cm from the second one and 8 cm from the first.
    look = points.locate(pose(x=0.08))
    got = points.weights(look, ["mug"], np.array([0, 3, 6]))[:, 0]
    assert got == pytest.approx([0.0, 0.0, 1.0])
    look = points.locate(pose(x=-0.04))
    assert points.weights(look, ["mug"], np.array([0, 3, 6]))[:, 0] == pytest.approx([0.4, 1, 1])


def test_differences_between_a_look_and_former_viewpoints():
    points = made()
    first = points.locate(pose()).viewpoint
    here = points.locate(pose(x=0.07))
    got = points.difference_from(here, np.array([first, here.viewpoint, NEVER]))
    assert got == pytest.approx([0.7, 0.0, 1.0])


def test_the_oldest_viewpoints_are_forgotten_and_the_number_stays(monkeypatch):
    monkeypatch.setattr(module, "MOST", 32)
    points = made()
    for i in range(100):
        weigh(points, pose(x=0.2 * i), update=i)
    assert len(points) == 32
    assert weigh(points, pose(x=0.2 * 99)) == [0.0]
    assert weigh(points, pose(x=0.0)) == [1.0]
