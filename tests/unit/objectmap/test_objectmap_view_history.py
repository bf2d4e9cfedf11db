"""Hindsight: earlier views of a place count for objects that are detected there later."""

from dataclasses import replace

import numpy as np
import pytest
from helios_core.types import SearchContext
from helios_objectmap.camera import View
from helios_objectmap.fusion.label_image import read
from helios_objectmap.fusion.view_history import AGREES_M, AGREES_SHARE, NEAREST_M, PastViews
from helios_objectmap.object_map import ObjectMap
from helios_objectmap.settings import ObjectMapSettings
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.unit.objectmap.objectmap_scene import (
    CONTEXT,
    COUNTER,
    MUG,
    ROOM,
    TABLE,
    looking_at,
    mug_at,
    observe,
)

BY_SIDES = ObjectMapSettings(stride_px=1, evidence="sides", named_from=0.2)
LOOKING_BACK = BY_SIDES.model_copy(update={"evidence": "hindsight"})
HOME = (*ROOM, mug_at(1.4, 0.0))
MUG_AT = (1.4, 0.0, 0.8)
NOTHING: dict[int, str] = {}  # the detector finds nothing
MUG_NAMED = {3: "mug"}
EYES = [(0.2, 0.0), (0.3, -0.8), (0.3, 0.8), (0.9, -1.2)]


def map_after_views(
    named: list[dict[int, str]],
    settings: ObjectMapSettings,
    contexts: list[SearchContext],
    eyes: list[tuple[float, float]] = EYES,
) -> ObjectMap:
    """A map after one view of the mug from each of the first eyes."""
    object_map = ObjectMap(settings)
    for k, (eye, names, context) in enumerate(zip(eyes, named, contexts, strict=False)):
        seen = observe(HOME, looking_at(*eye, MUG_AT), context=context, seq=k, called=names)
        object_map.update(seen, context)
    return object_map


def mugs(object_map: ObjectMap) -> list[float]:
    return [o.score for o in object_map.objects() if o.class_name == "mug"]


def test_views_before_the_first_detection_count_like_those_after_it() -> None:
    named, contexts = [MUG_NAMED, NOTHING, NOTHING, NOTHING], [CONTEXT] * 4
    after = map_after_views(named, LOOKING_BACK, contexts)
    before = map_after_views(named[::-1], LOOKING_BACK, contexts, EYES[::-1])
    forgetful = map_after_views(named[::-1], BY_SIDES, contexts, EYES[::-1])
    assert mugs(before) == pytest.approx(mugs(after), abs=0.03)
    assert mugs(forgetful)[0] > mugs(after)[0] + 0.05  # the purpose of hindsight


def test_past_views_that_did_not_show_the_place_do_not_count() -> None:
    object_map = ObjectMap(LOOKING_BACK)
    shut = ("door", (0.6, -3.0, 0.0), (0.65, 3.0, 2.5))
    for k, T in enumerate([looking_at(0.2, 0.0, MUG_AT), looking_at(0.2, 0.0, (-2.0, 0.0, 0.5))]):
        boxes = (*HOME, shut) if k == 0 else HOME
        object_map.update(observe(boxes, T, seq=k, called=NOTHING), CONTEXT)
    object_map.update(observe(HOME, looking_at(0.3, 0.8, MUG_AT), seq=2, called=MUG_NAMED), CONTEXT)
    alone = ObjectMap(LOOKING_BACK)
    alone.update(observe(HOME, looking_at(0.3, 0.8, MUG_AT), seq=2, called=MUG_NAMED), CONTEXT)
    assert mugs(object_map) == mugs(alone)


def test_past_views_without_a_class_in_their_context_do_not_count_for_that_class() -> None:
    others = SearchContext("c0", (TABLE, COUNTER))
    asked_late = map_after_views(
        [NOTHING, NOTHING, MUG_NAMED], LOOKING_BACK, [others, others, CONTEXT]
    )
    asked_early = map_after_views([NOTHING, NOTHING, MUG_NAMED], LOOKING_BACK, [CONTEXT] * 3)
    assert mugs(asked_late)[0] > mugs(asked_early)[0] + 0.05


def test_views_from_spots_of_an_earlier_search_count_for_a_class_that_is_new() -> None:
    """The mug of the first search was not sought any more when the second one began."""
    mug_sought = SearchContext("c1", (MUG, TABLE))
    cup_sought = SearchContext("c2", (replace(MUG, name="cup"), TABLE))
    around, found = EYES[:3], [EYES[3]]
    named = [NOTHING] * 3 + [{3: "cup"}]
    twice = map_after_views(
        [NOTHING] * 3 + named,
        LOOKING_BACK,
        [mug_sought] * 3 + [cup_sought] * 4,
        [*around, *around, *found],
    )
    once = map_after_views(named, LOOKING_BACK, [cup_sought] * 4, [*around, *found])
    (cup,) = (o.score for o in twice.objects() if o.class_name == "cup")
    assert [cup] == [o.score for o in once.objects() if o.class_name == "cup"]
    repeated = [past.weights.tolist() for past in list(twice._past._views)[3:6]]
    assert repeated == [[1.0, 0.0]] * 3  # the table was sought before: no view counts twice


def test_views_before_a_pick_do_not_count_for_objects() -> None:
    """An object that is detected there later may have arrived since."""
    context = SearchContext("c1", (MUG, TABLE))
    object_map = map_after_views([NOTHING, NOTHING, MUG_NAMED], LOOKING_BACK, [context] * 3)
    (mug,) = (o for o in object_map.objects() if o.class_name == "mug")
    object_map.retire(mug.id)
    object_map.update(observe(HOME, looking_at(*EYES[3], MUG_AT), seq=4, called=MUG_NAMED), context)
    fresh = ObjectMap(LOOKING_BACK)
    fresh.update(observe(HOME, looking_at(*EYES[3], MUG_AT), seq=4, called=MUG_NAMED), context)
    assert mugs(object_map) == pytest.approx(mugs(fresh), abs=0.02)
    assert (
        mugs(fresh)[0]
        > mugs(map_after_views([NOTHING] * 3 + [MUG_NAMED], LOOKING_BACK, [context] * 4))[0]
    )


def test_views_before_an_unknown_thing_was_picked_do_not_count_for_objects() -> None:
    context = SearchContext("c1", (MUG, TABLE))
    object_map = map_after_views([NOTHING] * 3, LOOKING_BACK, [context] * 3)
    object_map.forget_place(np.array(MUG_AT))
    seen = observe(HOME, looking_at(*EYES[3], MUG_AT), context=context, seq=4, called=MUG_NAMED)
    object_map.update(seen, context)
    fresh = ObjectMap(LOOKING_BACK)
    fresh.update(seen, context)
    assert mugs(object_map) == mugs(fresh)


def test_a_second_object_can_be_retired_after_the_first() -> None:
    context = SearchContext("c1", (MUG, TABLE))
    object_map = map_after_views([MUG_NAMED] * 3, LOOKING_BACK, [context] * 3)
    for seq in (4, 5):
        [mug] = [o for o in object_map.objects() if o.class_name == "mug"]
        assert object_map.retire(mug.id) > 0
        seen = observe(
            HOME, looking_at(*EYES[3], MUG_AT), context=context, seq=seq, called=MUG_NAMED
        )
        object_map.update(seen, context)


def test_an_object_can_be_retired_after_a_class_was_forgotten() -> None:
    few = LOOKING_BACK.model_copy(update={"max_classes": 2})
    cup = replace(MUG, name="cup")
    contexts = [SearchContext("c1", (MUG, TABLE)), *[SearchContext("c2", (cup, TABLE))] * 2]
    object_map = map_after_views([MUG_NAMED, {3: "cup"}, {3: "cup"}], few, contexts)
    [thing] = [o for o in object_map.objects() if o.class_name == "cup"]
    assert object_map.retire(thing.id) > 0


def test_standing_still_stores_one_past_view() -> None:
    object_map = ObjectMap(LOOKING_BACK)
    for k in range(5):
        object_map.update(
            observe(HOME, looking_at(*EYES[0], MUG_AT), seq=k, called=NOTHING), CONTEXT
        )
    assert len(object_map._past) == 1


def test_the_oldest_past_views_are_dropped() -> None:
    past = PastViews(most=2)
    for k, eye in enumerate(EYES[:3]):
        seen = observe(HOME, looking_at(*eye, MUG_AT), seq=k)
        past.note(read(seen, CONTEXT, 1, 0.25, 8.0), ["mug", "table"], np.ones(2, np.float32))
    point = np.array([[1.4, 0.0, 0.85]], np.float32)
    assert len(past) == 2
    eyes = [shown.past.view.T_world_cam[:2, 3] for shown in past.of(point)]
    np.testing.assert_allclose(eyes, EYES[1:3])


def visible_points_reference(
    points: NDArray[np.float32], view: View, depth_mm: NDArray
) -> list[int]:
    """Visible points by the rule of view_history.py, one point at a time."""
    out = []
    for k, point in enumerate(points.astype(float)):
        x, y, z = (view.T_cam_world @ [*point, 1.0])[:3]
        if z < NEAREST_M:
            continue
        u, v = round(x / z * view.fx + view.cx), round(y / z * view.fy + view.cy)
        if not (0 <= u < view.width and 0 <= v < view.height):
            continue
        measured_m = depth_mm[v, u] / 1000
        if measured_m and abs(measured_m - z) < max(AGREES_M, AGREES_SHARE * z):
            out.append(k)
    return out


@given(seed=st.integers(0, 10_000), x=st.floats(-1, 1), y=st.floats(-2, 2))
def test_the_kernel_equals_the_reference(seed: int, x: float, y: float) -> None:
    rng = np.random.default_rng(seed)
    seen = observe(HOME, looking_at(x, y, MUG_AT), seq=seed)
    past = PastViews(most=1)
    past.note(read(seen, CONTEXT, 1, 0.25, 8.0), ["mug", "table"], np.ones(2, np.float32))
    points = (np.array(MUG_AT) + rng.normal(0, 0.7, (60, 3))).astype(np.float32)
    kept = past._views[0]
    shown = list(past.of(points))
    found = shown[0].points.tolist() if shown else []
    assert found == visible_points_reference(points, kept.view, kept.depth_mm)
    if shown:
        assert len(shown[0].labels) == len(found)
