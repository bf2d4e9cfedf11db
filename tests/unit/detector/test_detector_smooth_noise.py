"""Smooth draws of side and view (table ovmm-v1-smooth): same rates as ovmm-v1, no grid."""

import math

import numpy as np
import pytest
from helios_detector.simulation.frame_noise import load_noise
from helios_detector.simulation.smooth_view_noise import SmoothViews
from helios_detector.simulation.view_noise import (
    SectorViews,
    Shares,
    key_of,
    keys_of,
    normal_draws,
)
from helios_detector.simulation.view_noise_detector import verdicts
from helios_detector.simulation.view_noise_table import ViewNoiseTable
from hypothesis import given, settings
from hypothesis import strategies as st
from test_detector_view_noise import visible_object

KEYS = np.array([key_of(f"thing {n}") for n in range(3000)], np.uint64)
PURPOSES = keys_of([f"purpose {n}" for n in range(10)])
SIDE, VIEW = Shares(0, 1, 0, 0), Shares(0, 0, 1, 0)
BOTH = Shares(0, 2 / 3, 1 / 3, 0)


def loaded(name: str) -> ViewNoiseTable:
    table = load_noise(name)
    assert isinstance(table, ViewNoiseTable)
    return table


TABLES = {name: loaded(name) for name in ("ovmm-v1", "ovmm-v1-smooth")}
SMOOTH = TABLES["ovmm-v1-smooth"]


def draws(
    shares: Shares, angle_deg, distance_m=2.5, keys=KEYS, purposes=PURPOSES, table=SMOOTH
) -> np.ndarray:
    """Draws [n, purposes] of objects seen from these angles and distances, each [n] or one."""
    turn, far = np.broadcast_arrays(np.radians(angle_deg), distance_m, np.zeros(len(keys)))[:2]
    offset_m = np.stack([far * np.cos(turn), far * np.sin(turn), 0 * far], -1)
    views, _ = table.views(keys, np.zeros(3), -offset_m, np.full(len(keys), 400))
    return normal_draws(views, purposes, shares, 1)


def correlation(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.corrcoef(a.ravel(), b.ravel())[0, 1])


def directions() -> np.ndarray:
    """An angle for each key, in degrees, evenly spread round the circle."""
    return np.arange(len(KEYS)) * 360 / len(KEYS)


@settings(max_examples=30, deadline=None)
@given(
    angle=st.floats(-360, 360),
    distance=st.floats(0.0, 20),
    shares=st.sampled_from([SIDE, VIEW, BOTH]),
)
def test_side_and_view_are_standard_normal_at_any_angle_and_distance(angle, distance, shares):
    z = draws(shares, angle, distance)
    assert abs(z.mean()) < 5 / math.sqrt(z.size)
    assert abs(z.var() - 1) < 5 * math.sqrt(2 / z.size)
    tail = (z < -1.2816).mean()  # a tenth of a standard normal distribution
    assert abs(tail - 0.1) < 5 * math.sqrt(0.09 / z.size)


@pytest.mark.parametrize(
    ("apart_deg", "expected"), [(0, 1.0), (30, 0.88), (60, 0.61), (90, 0.32), (120, 0.11), (180, 0)]
)
def test_the_side_fades_with_the_angle_as_in_ovmm_v1(apart_deg, expected):
    got = {
        name: correlation(*(draws(SIDE, directions() + a, table=t) for a in (0, apart_deg)))
        for name, t in TABLES.items()
    }
    assert abs(got["ovmm-v1-smooth"] - expected) < 0.03
    assert abs(got["ovmm-v1-smooth"] - got["ovmm-v1"]) < 0.05


@pytest.mark.parametrize(
    ("apart_deg", "ratio", "expected"),
    [
        (10, 1, 0.70), (18, 1, 0.32), (36, 1, 0), (90, 1, 0), (180, 1, 0),
        (0, 1.1, 0.80), (0, 1.25, 0.31), (0, 1.55, 0), (0, 3, 0), (10, 1.1, 0.56),
    ],
)  # fmt: skip
def test_the_view_fades_within_36_degrees_and_half_as_far_again(apart_deg, ratio, expected):
    got = correlation(*(draws(VIEW, directions() + apart_deg * k, 2.0 * ratio**k) for k in (0, 1)))
    assert abs(got - expected) < 0.03


def test_over_all_levels_two_views_are_as_alike_as_in_ovmm_v1():
    for apart_deg in (5, 15, 30, 45, 60, 90, 135, 180):
        old, new = (
            correlation(*(draws(t.shares, directions() + a, table=t) for a in (0, apart_deg)))
            for t in TABLES.values()
        )
        assert abs(old - new) < 0.04, apart_deg


def largest_step(table: ViewNoiseTable, places: list[tuple[float, float]]) -> float:
    """The largest change of side and view together between successive views of 300 objects."""
    s = table.shares
    z = [
        draws(Shares(0, s.side, s.view, 0), angle, distance, KEYS[:300], PURPOSES[:2], table)
        for angle, distance in places
    ]
    return float(np.abs(np.diff(z, axis=0)).max())


def test_no_draw_jumps_when_the_camera_moves_half_a_degree_or_half_a_percent():
    circle = [(0.5 * k, 2.5) for k in range(721)]
    away = [(17.0, 0.3 * 1.005**k) for k in range(700)]
    assert largest_step(SMOOTH, circle) < 0.2
    assert largest_step(SMOOTH, away) < 0.2
    assert largest_step(TABLES["ovmm-v1"], circle) > 1.5  # the same measure finds the sectors
    assert largest_step(TABLES["ovmm-v1"], away) > 1.0


def kink_deg(key: np.uint64, purpose: np.ndarray) -> float:
    """Place of the knots of a side term, 0 to 90 degrees: there its slope jumps."""
    angles = np.arange(0, 90, 0.1)
    keys = np.full(len(angles) + 2, key, np.uint64)
    z = draws(SIDE, np.arange(-0.1, 90.05, 0.1), keys=keys, purposes=purpose)[:, 0]
    return float(angles[np.abs(np.diff(z, 2)).argmax()])


def test_each_object_and_purpose_has_its_own_phase():
    by_object = [kink_deg(key, PURPOSES[:1]) for key in KEYS[:60]]
    by_purpose = [kink_deg(KEYS[0], keys_of((f"purpose {n}",))) for n in range(60)]
    for places in (by_object, by_purpose):
        assert len({round(p) for p in places}) > 25  # of 91; 44 are expected
        assert np.histogram(places, 3, (0, 90))[0].min() > 6
    assert by_object[0] != by_object[1]


def test_no_direction_of_the_world_is_special():
    """Views on both sides of a boundary of the agent's sectors are as alike as in its middle."""
    at_boundaries, in_middles = (
        np.mean([correlation(*(draws(BOTH, s + 30 * k + by) for by in (-2, 2))) for k in range(12)])
        for s in (0, 15)
    )
    assert abs(at_boundaries - in_middles) < 0.005


@pytest.mark.parametrize("place", [(10.0, 2.5), (29.9, 1.4), (200.0, 4.5)])
@pytest.mark.parametrize("level", [0.5, 1.0])
def test_misses_confusions_and_second_names_occur_as_often_as_with_ovmm_v1(place, level):
    angle_deg, distance_m = place
    turn = math.radians(angle_deg)
    eye_m = distance_m * np.array([math.cos(turn), math.sin(turn), 0.0])
    thing, keys = visible_object("mug", 1000), KEYS.tolist()
    counts, expected = {}, {}
    for name, table in TABLES.items():
        table = table.scaled(level)
        found = verdicts([thing] * len(keys), table, keys, eye_m, 1)
        reported = [v.names for v in found if v.names]
        counts[name] = np.array(
            [
                len(found) - len(reported),
                sum(n[0][0] != "mug" for n in reported),
                sum(len(n) == 2 for n in reported),
                len(reported),
            ]
        )
        miss = float(table.miss(["mug"], np.array([1000]), np.array([distance_m]))[0])
        expected[name] = miss, table.confuse("mug"), table.second("mug")
    old, new = counts.values()
    assert expected["ovmm-v1"] == expected["ovmm-v1-smooth"]
    for k, rate in enumerate(expected["ovmm-v1"]):
        of = [len(keys) if k == 0 else c[3] for c in (old, new)]
        spread = math.sqrt(rate * (1 - rate))
        assert abs(new[k] / of[1] - rate) <= 4.5 * spread / math.sqrt(of[1]), k
        assert abs(new[k] / of[1] - old[k] / of[0]) <= 4.5 * spread * math.sqrt(
            1 / of[0] + 1 / of[1]
        ), k


def test_a_draw_does_not_depend_on_the_other_objects_in_view():
    for table, kind in ((SMOOTH, SmoothViews), (TABLES["ovmm-v1"], SectorViews)):
        centers_m = np.random.default_rng(3).uniform(-3, 3, (50, 3))
        views, _ = table.views(KEYS[:50], np.array([0.1, 0.2, 1.0]), centers_m, None)
        assert isinstance(views, kind)
        everything = normal_draws(views, PURPOSES, table.shares, 7)
        one = views.part(slice(20, 21))
        assert len(one) == 1
        np.testing.assert_array_equal(
            normal_draws(one, PURPOSES[3:5], table.shares, 7), everything[20:21, 3:5]
        )


def test_smooth_draws_are_the_same_on_every_machine():
    views = SmoothViews(keys_of(("a", "b")), np.array([0.3, 5.9]), np.array([1.7, 0.4]))
    z = normal_draws(views, keys_of(("miss", "score")), Shares(0.3, 0.4, 0.2, 0.1), 123456789)
    expected = [1.4751844717429061, 0.018391631335273106, 2.1494013478764065, 1.2728227856000487]
    assert z.ravel() == pytest.approx(expected, abs=1e-9)


def test_ovmm_v1_smooth_differs_from_ovmm_v1_only_in_its_name_and_its_sides():
    old, new = (t.file.model_dump() for t in TABLES.values())
    assert new["persistence"] == old["persistence"] | {"sides": "smooth"}
    same = {"name": "", "persistence": {}}
    assert new | same == old | same


def test_at_correlation_1_two_frames_of_one_view_are_equal():
    table = SMOOTH.scaled(1, 1.0)
    views, _ = table.views(KEYS, np.array([1.0, 2.0, 0.0]), np.zeros((len(KEYS), 3)), None)
    first, later = (normal_draws(views, PURPOSES, table.shares, stamp) for stamp in (1, 2))
    np.testing.assert_array_equal(first, later)
