"""Image-text scores of the views that show an instance move its score."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from helios_core.types import SearchContext
from helios_objectmap.camera import View
from helios_objectmap.fusion.label_image import read
from helios_objectmap.fusion.semantics import score_from
from helios_objectmap.fusion.viewing_sectors import SECTORS
from helios_objectmap.instances import image_text
from helios_objectmap.instances.image_text import (
    USUAL_RISE,
    ImageTextScores,
    in_odds,
    sum_kernel,
    with_evidence,
)
from helios_objectmap.instances.voxel_numbers import NO_VOXEL
from helios_objectmap.object_map import ObjectMap
from hypothesis import given, settings
from hypothesis import strategies as st
from objectmap_scene import (
    CAMERA,
    CONTEXT,
    MUG,
    ROOM,
    SETTINGS,
    TABLE,
    Box,
    looking_at,
    mug_at,
    observe,
    pose,
)

COMPARED = SETTINGS.model_copy(update={"image_text": "compared"})
SCENE = (*ROOM, mug_at(1.2, 0.0))
EYES = ((0.0, 0.0), (0.4, -1.2), (0.4, 1.2), (2.6, -0.8), (2.6, 0.8), (1.4, 1.6))
SECOND = (*SCENE, ("table", (-4.4, -0.6, 0.7), (-3.6, 0.6, 0.75)))
AWAY = tuple(pose(-2.0, 0.3 * k, yaw=math.pi + 0.2 * k) for k in range(24))  # table behind them

TOP = np.array([(x, y, 0.74) for x in (1.1, 1.4, 1.7) for y in (-0.4, 0.0, 0.4)], np.float32)
ROWS = np.arange(len(TOP))

Rating = Callable[[bool, int], float]  # (True if the view shows the table, its number) -> score


def built(settings, rating: Rating, scene: Sequence[Box] = SCENE) -> ObjectMap:
    """Map after views of the table from six sides, and after views away from it."""
    objects = ObjectMap(settings)
    views = [(True, looking_at(*eye, (1.4, 0.0, 0.7))) for eye in EYES]
    views += [(False, T) for T in AWAY]
    for seq, (shows, T_world_cam) in enumerate(views):
        seen = observe(scene, T_world_cam, seq=seq)
        objects.update(replace(seen, class_scores={"table": rating(shows, seq)}), CONTEXT)
    return objects


def table_score(settings, rating: Rating) -> float:
    return max(o.score for o in built(settings, rating).objects() if o.class_name == "table")


def noisy(level: float, seq: int) -> float:
    return level + 0.1 * math.sin(7.0 * seq)


def test_an_instance_gains_if_its_views_score_higher_than_others() -> None:
    without = table_score(SETTINGS, lambda shows, seq: noisy(0.4, seq))
    high = table_score(COMPARED, lambda shows, seq: noisy(0.8 if shows else 0.3, seq))
    like_others = table_score(COMPARED, lambda shows, seq: noisy(0.3, seq))
    assert without < high
    assert like_others < (without + high) / 2


def test_a_second_search_from_the_same_spots_rates_its_new_class_alone() -> None:
    objects = ObjectMap(COMPARED)
    cup_sought = SearchContext("c2", (replace(MUG, name="cup"), TABLE))
    for context, new in ((CONTEXT, "mug"), (cup_sought, "cup")):
        for seq, eye in enumerate(EYES):
            seen = observe(SCENE, looking_at(*eye, (1.4, 0.0, 0.7)), context=context, seq=seq)
            objects.update(replace(seen, class_scores={new: 0.3, "table": 0.6}), context)
    views = {name: scores.views for name, scores in objects._image_text._scores.items()}
    assert views == dict.fromkeys(("mug", "cup", "table"), len(EYES))


def test_of_two_instances_the_one_with_the_higher_views_gains() -> None:
    def scores(settings) -> list[float]:
        objects = built(settings, lambda shows, seq: noisy(0.8 if shows else 0.3, seq), SECOND)
        tables = [o for o in objects.objects() if o.class_name == "table"]
        return [o.score for o in sorted(tables, key=lambda o: -o.center_m[0])]

    (first, second), (first_without, second_without) = scores(COMPARED), scores(SETTINGS)
    assert first > first_without
    assert second < second_without


def test_an_instance_whose_views_score_lower_than_others_loses() -> None:
    low = table_score(COMPARED, lambda shows, seq: noisy(0.2 if shows else 0.5, seq))
    assert low < 0.2 * table_score(SETTINGS, lambda *_: 0.0)


@pytest.mark.parametrize("value", [0.0, 0.5, 1.0])
def test_a_scorer_that_tells_nothing_apart_changes_nothing(value: float) -> None:
    assert table_score(COMPARED, lambda *_: value) == table_score(SETTINGS, lambda *_: value)


def test_the_other_class_and_the_ignored_scores_stay_as_they_are() -> None:
    def rating(shows: bool, seq: int) -> float:
        return noisy(0.8 if shows else 0.3, seq)

    mug = [
        next(o.score for o in built(s, rating).objects() if o.class_name == "mug")
        for s in (SETTINGS, COMPARED)
    ]
    assert mug[0] == mug[1]


def test_an_instance_keeps_score_uncertainty_and_probabilities_consistent() -> None:
    objects = built(COMPARED, lambda shows, seq: noisy(0.8 if shows else 0.3, seq))
    table = next(o for o in objects.objects() if o.class_name == "table")
    assert table.score == pytest.approx(table.class_score - table.uncertainty)  # eq. 7
    assert table.probabilities["table"] == table.class_score
    assert objects.history(table.id)[-1].score == pytest.approx(table.score, abs=0.2)


def test_an_expected_view_raises_the_same_score_that_is_reported() -> None:
    objects = built(COMPARED, lambda shows, seq: noisy(0.3, seq))
    table = next(o for o in objects.objects() if o.class_name == "table")
    eye = looking_at(1.4, -1.6, (1.4, 0.0, 0.7))
    view = View(CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy, CAMERA.width, CAMERA.height, eye)
    told = objects.what_if(table.id, "table", [view])
    assert told is not None
    assert table.score <= told[1].psi < 0.9


def sums(order: Sequence[int], scores: Sequence[float]) -> tuple[float, np.ndarray]:
    """(L of the table, share by sector) after the views in this order."""
    noted = ImageTextScores()
    for k in order:
        T_world_cam = looking_at(*EYES[k % len(EYES)], (1.4, 0.0, 0.7)) if k < 6 else AWAY[k - 6]
        reading = read(observe(SCENE, T_world_cam), CONTEXT, 1, 0.1, 8.0)
        noted.note(reading, {"table": scores[k]})
    seen = noted.of(TOP, ROWS, "table")
    assert seen is not None
    return noted.log_likelihood_ratio(seen, "table", 1.5), seen.share


@settings(max_examples=20)
@given(st.permutations(range(12)), st.lists(st.floats(0, 1), min_size=12, max_size=12))
def test_the_order_of_views_does_not_matter(order: list[int], scores: list[float]) -> None:
    nats, share = sums(order, scores)
    as_listed, share_as_listed = sums(range(12), scores)
    assert share == pytest.approx(share_as_listed)
    assert nats == pytest.approx(as_listed, abs=1e-3)


def test_views_from_one_side_count_as_one_side() -> None:
    def nats(eyes: Sequence[int]) -> float:
        noted = ImageTextScores()
        for k, T_world_cam in enumerate(AWAY):
            noted.note(
                read(observe(SCENE, T_world_cam), CONTEXT, 1, 0.1, 8.0), {"table": noisy(0.3, k)}
            )
        for k in eyes:
            T_world_cam = looking_at(*EYES[k], (1.4, 0.0, 0.7))
            noted.note(read(observe(SCENE, T_world_cam), CONTEXT, 1, 0.1, 8.0), {"table": 0.45})
        seen = noted.of(TOP, ROWS, "table")
        assert seen is not None
        return noted.log_likelihood_ratio(seen, "table", 1.5)

    assert nats([0] * 4) < nats([0, 1, 3, 4])


def test_the_rise_is_learned_from_what_the_detector_believes() -> None:
    def rise(level: float, psi: float) -> float:
        noted = ImageTextScores()
        views = [(noisy(0.3, k), T) for k, T in enumerate(AWAY)]
        views += [(level, looking_at(*eye, (1.4, 0.0, 0.7))) for eye in EYES]
        for score, T_world_cam in views:
            noted.note(read(observe(SCENE, T_world_cam), CONTEXT, 1, 0.1, 8.0), {"table": score})
        seen = noted.of(TOP, ROWS, "table")
        assert seen is not None
        return noted.rise("table", [(psi, seen)])

    assert rise(0.3, 0.9) < 0.8 < USUAL_RISE < rise(0.9, 0.9)
    assert rise(0.0, 0.9) == 0.0  # it never counts the other way round
    assert rise(0.3, 0.0) == pytest.approx(USUAL_RISE, abs=0.01)


def test_what_was_never_shown_has_no_scores() -> None:
    noted = ImageTextScores()
    noted.note(read(observe(SCENE, AWAY[0]), CONTEXT, 1, 0.1, 8.0), {"table": 0.5})
    assert noted.of(TOP, ROWS, "table") is None
    assert noted.of(TOP, ROWS, "mug") is None


def test_what_was_taken_away_takes_its_scores_along() -> None:
    noted = ImageTextScores()
    noted.note(read(observe(SCENE, AWAY[0]), CONTEXT, 1, 0.1, 8.0), {"table": 0.2})
    near = looking_at(*EYES[0], (1.4, 0.0, 0.7))
    noted.note(read(observe(SCENE, near), CONTEXT, 1, 0.1, 8.0), {"table": 0.5})
    assert noted.of(TOP, ROWS, "table") is not None
    noted.forget_at(TOP)
    assert noted.of(TOP, ROWS, "table") is None


def test_the_sums_of_an_instance_count_each_of_its_voxels_once() -> None:
    rng = np.random.default_rng(7)
    sums = rng.random((30, SECTORS, 2)).astype(np.float32)
    voxels = rng.integers(NO_VOXEL, 40, 200).astype(np.int32)
    total = np.zeros((SECTORS, 2))
    n = sum_kernel(voxels, sums, np.zeros(len(sums), bool), total)
    known = np.unique(voxels[(voxels != NO_VOXEL) & (voxels < len(sums))])
    assert n == len(known)
    assert total == pytest.approx(sums[known].sum(axis=0, dtype=np.float64))


def test_the_log_tells_once_that_full_scores_take_no_new_voxels(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    noted = ImageTextScores()
    readings = [read(observe(SCENE, T), CONTEXT, 1, 0.1, 8.0) for T in AWAY[:4]]
    noted.note(readings[0], {"table": 0.5})
    assert not caplog.messages
    monkeypatch.setattr(image_text, "MOST_SUMS", len(noted._voxels))
    for reading in readings:
        noted.note(reading, {"table": 0.5})
    assert noted._scores["table"].views == 2  # the first view shows no new voxel
    (told,) = caplog.messages
    assert f"fill {len(noted._voxels)} voxels of 1 class:" in told


def test_of_a_small_thing_a_view_shows_a_small_share() -> None:
    noted = ImageTextScores()
    near = looking_at(0.4, 0.0, (1.4, 0.0, 0.7))
    noted.note(read(observe(SCENE, near), CONTEXT, 1, 0.1, 8.0), {"table": 0.5, "mug": 0.5})
    mug = np.array([(x, y, z) for x in (1.16, 1.24) for y in (-0.04, 0.04) for z in (0.76, 0.84)])
    table = noted.of(TOP, ROWS, "table")
    small = noted.of(mug.astype(np.float32), np.arange(len(mug)), "mug")
    assert table is not None
    assert small is not None
    assert small.share.sum() < 0.01 < 0.05 < table.share.sum()


@given(st.floats(0, 1), st.floats(-50, 50), st.floats(-50, 50))
def test_nats_add_up_in_the_odds(probability: float, first: float, second: float) -> None:
    moved_once = in_odds(probability, first)
    assert 0 <= moved_once <= 1
    assert in_odds(probability, max(first, second)) >= in_odds(probability, min(first, second))
    if 0.01 < probability < 0.99 and max(abs(first), abs(second), abs(first + second)) < 4:
        assert in_odds(moved_once, second) == pytest.approx(in_odds(probability, first + second))


def test_no_evidence_leaves_a_score_bit_for_bit() -> None:
    score = score_from(0.00001, 0.3, 1.0)
    assert with_evidence(score, 0.0) is score
