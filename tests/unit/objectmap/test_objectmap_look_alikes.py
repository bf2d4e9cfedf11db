"""Detections under other names at an instance lower its score."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from helios_core.types import Detection, SearchContext
from helios_objectmap.fusion.label_image import read
from helios_objectmap.instances import beliefs
from helios_objectmap.instances.name_sightings import (
    SURE_NAME,
    NameRates,
    NameSightings,
    evidence_share,
)
from helios_objectmap.object_map import ObjectMap
from hypothesis import given
from hypothesis import strategies as st
from objectmap_scene import CONTEXT, MUG, ROOM, SETTINGS, TABLE, looking_at, mug_at, observe

COMPARED = SETTINGS.model_copy(update={"look_alikes": "compared", "side_views": 1.0})
SCENE = (*ROOM, mug_at(1.2, 0.0))
EYES = ((0.0, 0.0), (0.4, -1.2), (0.4, 1.2), (2.6, -0.8), (2.6, 0.8), (1.4, 1.6))


def mug_score(settings, others: dict[str, int], own_views: int = 6) -> float:
    """Score of the mug after six views; others: name -> number of views that give it as well."""
    objects = ObjectMap(settings)
    for seq, eye in enumerate(EYES):
        seen = observe(SCENE, looking_at(*eye, (1.2, 0.0, 0.8)), seq=seq)
        mug = next(d for d in seen.detections if d.class_name == "mug")
        also = [Detection(n, 0.6, mug.box_xyxy, mug.mask) for n, k in others.items() if seq < k]
        own = tuple(d for d in seen.detections if d is not mug or seq < own_views)
        objects.update(replace(seen, detections=own, others=tuple(also)), CONTEXT)
    return max((o.score for o in objects.objects() if o.class_name == "mug"), default=0.0)


def test_a_thing_called_glass_more_often_than_mug_loses_its_score() -> None:
    as_seen = mug_score(COMPARED, {}, own_views=3)
    assert mug_score(COMPARED, {"glass": 6}, own_views=3) < 0.5 * as_seen
    assert mug_score(COMPARED, {"glass": 1}, own_views=3) == pytest.approx(as_seen, rel=0.1)


def test_different_other_names_count_less_than_one_that_repeats() -> None:
    scattered = {"glass": 2, "candle": 2, "vase": 2}
    assert mug_score(COMPARED, scattered, 3) > mug_score(COMPARED, {"glass": 6}, 3)


def test_a_name_that_no_other_contests_keeps_all_evidence() -> None:
    assert mug_score(COMPARED, {}) == mug_score(SETTINGS, {})


def test_another_name_that_the_size_does_not_fit_counts_less(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    sized = COMPARED.model_copy(update={"look_alikes": "sized"})
    fitting = mug_score(sized, {"glass": 6}, 3)
    assert fitting == mug_score(COMPARED, {"glass": 6}, 3)
    fits = {"glass": 0.05}
    monkeypatch.setattr(beliefs, "agreement", lambda name, *_: fits.get(name, 1.0))
    assert mug_score(sized, {"glass": 6}, 3) > fitting


@pytest.mark.parametrize("name", ["bookcase", "cabinet"])
def test_furniture_is_no_look_alike_of_a_mug(name: str) -> None:
    assert mug_score(COMPARED, {name: 6}) == mug_score(COMPARED, {})


def test_by_default_other_names_change_nothing() -> None:
    assert mug_score(SETTINGS, {"glass": 6}) == mug_score(SETTINGS, {})


def rates(own: list[float], other: list[float], weight: float = 1.0) -> NameRates:
    return NameRates(("mug", "glass"), np.array([own, other]).T, np.full(len(own), weight))


def test_the_probability_compares_the_names_side_by_side() -> None:
    assert rates([1.0], [0.0]).probability("mug") > 0.99
    assert rates([0.2, 0.2], [1.0, 1.0]).probability("mug") < 0.5
    one, three = rates([0.3], [0.9]), rates([0.3] * 3, [0.9] * 3)
    assert three.probability("mug") < one.probability("mug")  # more sides say more
    assert rates([0.3], [0.9], 0.1).probability("mug") > one.probability("mug")
    assert NameRates((), np.zeros((0, 0)), np.zeros(0)).probability("mug") == 1.0


@given(st.lists(st.tuples(st.floats(0, 1), st.floats(0, 1)), min_size=1, max_size=12))
def test_the_probability_falls_as_the_other_name_gets_more_frequent(sides) -> None:
    own, other = [a for a, _ in sides], [b for _, b in sides]
    value = rates(own, other).probability("mug")
    assert 0 < value <= 1
    more = rates(own, [min(1.0, b + 0.1) for b in other]).probability("mug")
    assert more <= value + 1e-12


def test_a_name_that_was_never_given_is_less_likely_than_any_given_one() -> None:
    seen = NameRates(("glass",), np.array([[0.8]]), np.ones(1))
    assert seen.probability("mug") < rates([0.5], [0.8]).probability("mug")


@given(st.floats(0, 1), st.floats(0, 1))
def test_the_share_of_the_evidence_rises_with_the_probability_of_the_name(one, other) -> None:
    less, more = (evidence_share(name) for name in sorted((one, other)))
    assert 0 <= less <= more <= 1


def test_all_evidence_counts_for_a_sure_name_and_a_ninth_for_an_even_one() -> None:
    assert evidence_share(1.0) == evidence_share(SURE_NAME) == 1.0
    assert evidence_share(0.5) == pytest.approx(1 / 9)
    assert evidence_share(0.0) == 0.0


def views_of_mug(
    objects: ObjectMap, eyes: Sequence[tuple[float, float]], name: str = "glass"
) -> None:
    for seq, eye in enumerate(eyes):
        seen = observe(SCENE, looking_at(*eye, (1.2, 0.0, 0.8)), seq=seq)
        mug = next(d for d in seen.detections if d.class_name == "mug")
        other = Detection(name, 0.6, mug.box_xyxy, mug.mask)
        objects.update(replace(seen, others=(other,)), CONTEXT)


def test_a_camera_at_rest_repeats_no_name() -> None:
    once, often = ObjectMap(COMPARED), ObjectMap(COMPARED)
    views_of_mug(once, EYES[:2])
    views_of_mug(often, (EYES[0],) * 5 + (EYES[1],) * 5)
    assert len(once._sightings) == len(often._sightings) == 2


def test_a_search_for_a_new_class_counts_the_names_of_its_views_from_known_spots() -> None:
    objects = ObjectMap(COMPARED)
    cup_sought = SearchContext("c2", (replace(MUG, name="cup"), TABLE))
    for context, views in ((CONTEXT, 2), (cup_sought, 4), (cup_sought, 4)):
        for eye in EYES[:2]:
            seen = observe(SCENE, looking_at(*eye, (1.2, 0.0, 0.8)), context=context)
            objects.update(seen, context)
        assert len(objects._sightings) == views


def test_names_at_the_place_of_a_picked_object_are_forgotten() -> None:
    objects = ObjectMap(COMPARED)
    views_of_mug(objects, EYES)
    (mug,) = (o for o in objects.objects() if o.class_name == "mug")
    points = objects.gaussians(mug.id).means
    assert objects._sightings.rates(points, np.arange(len(points)), "mug", 1.0) is not None
    objects.retire(mug.id)
    assert objects._sightings.rates(points, np.arange(len(points)), "mug", 1.0) is None


def test_names_around_the_point_of_an_unknown_picked_thing_are_forgotten() -> None:
    objects = ObjectMap(COMPARED)
    views_of_mug(objects, EYES)
    box = np.array([1.2, 0.0, 0.8]), np.full(3, 0.1)
    beside = np.array([1.6, 0.4, 0.73]), np.full(3, 0.1)
    before = [objects.probability_in(name, b) for name, b in (("mug", box), ("table", beside))]
    objects.forget_place(box[0])
    assert objects.probability_in("mug", box) == 0.5 != before[0]
    assert objects.probability_in("table", beside) == before[1] != 0.5


@pytest.mark.parametrize("most_views", [2, 4, 6])
def test_only_the_latest_views_are_kept(most_views: int) -> None:
    sightings = NameSightings(most_views)
    mug = np.full((1, 3), np.nan, np.float32)
    for seq, eye in enumerate(EYES):
        seen = observe(SCENE, looking_at(*eye, (1.2, 0.0, 0.8)), seq=seq)
        mug_seen = next(d for d in seen.detections if d.class_name == "mug")
        reading = read(seen, CONTEXT, 1, 0.2, 8.0)
        mug = reading.view.lift(reading.depth_m, mug_seen.mask)
        named = Detection(f"name {seq}", 0.9, mug_seen.box_xyxy, mug_seen.mask)
        sightings.note(reading, 1, (named,))
        assert len(sightings) <= most_views
    rates = sightings.rates(mug, np.arange(len(mug)), "mug", 1.0)
    assert rates is not None
    kept = {f"name {seq}" for seq in range(len(EYES) - len(sightings), len(EYES))}
    assert set(rates.names) <= kept
    assert f"name {len(EYES) - 1}" in rates.names
