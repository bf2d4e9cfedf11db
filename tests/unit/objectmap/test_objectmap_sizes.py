"""Agreement of size with the class: usual sizes, and the cost of unusual ones."""

from __future__ import annotations

import math
import tomllib
from importlib import resources

import numpy as np
import pytest
from helios_core.types import Role, SearchClass, SearchContext
from helios_core.usual_sizes import (
    BOX_ERROR_M,
    EDGE_SIGMA,
    HALF_WHOLE_VIEWS,
    JOINED,
    agreement,
    extents_of,
    usual_extents,
)
from helios_objectmap.camera import View
from helios_objectmap.object_map import ObjectMap
from hypothesis import given, settings
from hypothesis import strategies as st
from objectmap_scene import (
    CAMERA,
    CONTEXT,
    ROOM,
    SETTINGS,
    TABLE,
    looking_at,
    mug_at,
    observe,
    pose,
)

TABLE_M = [(0.75, 2.60), (0.65, 1.20), (0.68, 0.80)]  # a dining table, as sizes.toml has it
BOTTLE_M = np.array([0.08, 0.08, 0.30])
EVER = 1e9  # views

metres = st.floats(0.01, 5.0)


def test_synonyms_of_the_detector_have_the_same_usual_size():
    text = resources.files("helios_detector").joinpath("synonyms.toml").read_text()
    for row in tomllib.loads(text)["equal"]:
        known = [(name, usual) for name in row if (usual := usual_extents(name)) is not None]
        assert len(known) in (0, len(row)), f"of {row} only {[n for n, _ in known]} have a size"
        ranges = {(tuple(usual.least_m), tuple(usual.most_m)) for _, usual in known}
        assert len(ranges) <= 1, f"{row} differ"


def test_size_ranges_are_valid_and_the_longer_side_comes_first():
    text = resources.files("helios_core").joinpath("sizes.toml").read_text()
    names = [n for rows in tomllib.loads(text).values() for key in rows for n in key.split(", ")]
    assert len(names) == len(set(names)), "a name stands twice"
    for name in names:
        usual = usual_extents(name)
        assert usual is not None, f"{name!r} is not found as it is written"
        assert (usual.least_m > 0).all()
        assert (usual.least_m < usual.most_m).all()
        assert usual.least_m[0] >= usual.least_m[1]
        assert usual.most_m[0] >= usual.most_m[1]


@settings(max_examples=50, deadline=None)
@given(metres, metres, metres, st.floats(0, 100))
def test_agreement_equals_the_documented_formula(long, short, high, views):
    measured = (long, short, high)
    small = max(0.0, math.log(TABLE_M[0][0] / (long + BOX_ERROR_M)) / EDGE_SIGMA) ** 2
    large = 0.0
    for e, (_, most) in zip(measured, TABLE_M, strict=True):
        if e > BOX_ERROR_M + 1e-3:
            large += max(0.0, math.log((e - BOX_ERROR_M) / most) / EDGE_SIGMA) ** 2
    w = views / (views + HALF_WHOLE_VIEWS)
    expected = (1 - w + w * math.exp(-small / 2)) * (JOINED + (1 - JOINED) * math.exp(-large / 2))
    assert agreement("dining table", np.array(measured), views) == pytest.approx(expected)


@settings(max_examples=50, deadline=None)
@given(st.tuples(*(st.floats(*side) for side in TABLE_M)), st.floats(0, 1000))
def test_a_usual_size_or_an_unknown_class_costs_nothing(measured, views):
    assert agreement("Dining_Table", np.array(measured), views) == 1.0
    assert agreement("gizmo", np.array(measured), views) == 1.0


def test_too_small_a_size_costs_more_with_every_view_and_too_large_a_size_costs_at_once():
    corner, hall = np.array([0.3, 0.2, 0.1]), np.array([5.0, 4.0, 3.0])
    costs = [agreement("dining table", corner, views) for views in (0, 2, 10, 40)]
    assert costs[0] == 1.0
    assert costs == sorted(costs, reverse=True)
    assert costs[2] == pytest.approx(0.5, abs=0.01)  # by then half are seen completely
    assert agreement("dining table", hall, 0) == pytest.approx(JOINED, abs=1e-3)


def test_a_table_without_its_legs_and_a_chair_back_above_a_table_agree():
    assert agreement("dining table", np.array([2.0, 0.85, 0.05]), EVER) == 1.0
    assert agreement("chair", np.array([0.45, 0.04, 0.10]), EVER) == 1.0


def test_the_height_of_floor_standing_furniture_is_its_top_if_the_floor_is_known():
    rug, back = np.array([1.9, 1.2, 0.02]), np.array([0.45, 0.04, 0.10])
    assert agreement("bed", rug, 0, top_m=None) == 1.0
    assert agreement("bed", rug, 0, top_m=0.02) < 0.1
    assert agreement("bed", rug, 0, top_m=0.55) == 1.0
    assert agreement("chair", back, EVER, top_m=0.9) == 1.0
    assert agreement("chair", back, 0, top_m=2.5) < 0.1
    assert agreement("picture", np.array([0.5, 0.02, 0.5]), 0, top_m=2.0) == 1.0  # hangs


def test_a_small_object_may_lie_on_its_side_and_furniture_may_not():
    lying = BOTTLE_M[[2, 0, 1]]
    assert agreement("bottle", BOTTLE_M, EVER) == agreement("bottle", lying, EVER) == 1.0
    fridge = np.array([0.7, 0.6, 1.8])
    assert agreement("fridge", fridge, EVER) == 1.0
    assert agreement("fridge", fridge[[2, 1, 0]], EVER) < 0.2


@pytest.mark.parametrize("turned_rad", [0.0, 0.4, 1.2, 3.0])
def test_the_extents_of_a_box_do_not_depend_on_its_orientation(turned_rad):
    corners = np.array([[0, 0], [1.5, 0], [1.5, 0.7], [0, 0.7], [0.7, 0.3]])
    c, s = math.cos(turned_rad), math.sin(turned_rad)
    turned = corners @ np.array([[c, s], [-s, c]]) + [3, -2]
    assert extents_of(turned, 0.74) == pytest.approx([1.5, 0.7, 0.74], abs=1e-4)


def map_with_mug(chosen, called, context=CONTEXT) -> ObjectMap:
    """A map after views of a mug from five places; called: the classes of table and mug."""
    objects = ObjectMap(chosen)
    for seq, (x, y) in enumerate([(0.0, 0.0), (0.1, 0.3), (0.2, -0.3), (0.3, 0.5), (0.4, -0.5)]):
        T_world_cam = looking_at(x, y, (1.2, 0.0, 0.8))
        boxes = (*ROOM, mug_at(1.2, 0.0))
        o = observe(boxes, T_world_cam, seq=seq, called=called, context=context)
        objects.update(o, context)
    return objects


BY_SIZE = SETTINGS.model_copy(update={"size_agreement": "on"})
TOO_LARGE = SETTINGS.model_copy(update={"size_agreement": "large"})
FRIDGES = SearchContext("c2", (SearchClass("fridge", Role.OBJECT, 0.3), TABLE))


def test_a_mug_as_large_as_a_table_loses_score_and_a_real_mug_does_not():
    right = [map_with_mug(chosen, {3: "mug"}).objects() for chosen in (SETTINGS, BY_SIZE)]
    assert [o.score for o in right[0]] == [o.score for o in right[1]]
    (without,), (huge,) = (
        map_with_mug(chosen, {2: "mug"}).objects() for chosen in (SETTINGS, BY_SIZE)
    )
    assert without.score > 0.5
    assert huge.score < 0.2


def test_the_setting_large_penalises_only_too_large_objects():
    plain, large, on = (
        map_with_mug(chosen, {3: "fridge"}, FRIDGES).objects()[0]
        for chosen in (SETTINGS, TOO_LARGE, BY_SIZE)
    )
    assert plain.score == large.score  # the mug's top is as high as a small fridge's
    assert on.score < 0.9 * plain.score
    (huge,) = map_with_mug(TOO_LARGE, {2: "mug"}).objects()
    assert huge.score < 0.2


def test_size_agreement_changes_scores_and_what_ifs_but_neither_evidence_nor_instances():
    without, by_size = (map_with_mug(chosen, {2: "mug"}) for chosen in (SETTINGS, BY_SIZE))
    mine, theirs = without.gaussians(), by_size.gaussians()
    assert np.array_equal(mine.concentration, theirs.concentration)
    assert np.array_equal(mine.instance, theirs.instance)
    (plain,), (huge,) = without.objects(), by_size.objects()
    assert np.array_equal(plain.size_m, huge.size_m)
    c = CAMERA
    away = View(c.fx, c.fy, c.cx, c.cy, c.width, c.height, pose(yaw=np.pi))
    answer = by_size.what_if(huge.id, "mug", [away])
    assert answer is not None
    assert answer[1].psi == pytest.approx(huge.score, abs=1e-5)
    assert by_size.history(huge.id)[-1].score == pytest.approx(huge.score)
