"""Names and image-text scores of past views are part of a map file, and move with a stored map."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from helios_core.errors import InvalidInput
from helios_core.geometry import se2_to_se3
from helios_core.types import Detection
from helios_objectmap import persistence
from helios_objectmap.instances import image_text
from helios_objectmap.instances.image_text import _Distribution
from helios_objectmap.instances.name_sightings import NameSightings
from helios_objectmap.instances.voxel_entries import VoxelEntries
from helios_objectmap.instances.voxel_numbers import NO_VOXEL
from helios_objectmap.object_map import ObjectMap
from hypothesis import given
from hypothesis import strategies as st
from objectmap_scene import CONTEXT, ROOM, SETTINGS, looking_at, mug_at, observe, pose

COMPARED = SETTINGS.model_copy(update={"image_text": "compared", "look_alikes": "compared"})
SCENE = (*ROOM, mug_at(1.2, 0.0))
EYES = ((0.0, 0.0), (0.4, -1.2), (0.4, 1.2), (2.6, -0.8), (2.6, 0.8), (1.4, 1.6))
AWAY = tuple(pose(-2.0, 0.3 * k, yaw=math.pi + 0.2 * k) for k in range(24))  # table behind them


@pytest.fixture(scope="module")
def seen() -> ObjectMap:
    """Map of a table that the scorer confirms, and of a mug that was also called a glass."""
    objects = ObjectMap(COMPARED)
    views = [(True, looking_at(*eye, (1.3, 0.0, 0.7))) for eye in EYES]
    for seq, (shows, T) in enumerate([*views, *((False, T) for T in AWAY)]):
        view = observe(SCENE, T, seq=seq)
        mugs = [d for d in view.detections if d.class_name == "mug"]
        also = tuple(Detection("glass", 0.6, d.box_xyxy, d.mask) for d in mugs[: seq % 2])
        rating = {"table": (0.8 if shows else 0.3) + 0.1 * math.sin(7.0 * seq)}
        objects.update(replace(view, class_scores=rating, others=also), CONTEXT)
    return objects


def saved(objects: ObjectMap) -> dict[str, np.ndarray]:
    return persistence.arrays_of(objects.content(), None)


def loaded(arrays: dict[str, np.ndarray]) -> persistence.MapContent:
    data = persistence.to_bytes(arrays)
    return persistence.read(data, ObjectMap(COMPARED).empty_viewpoints()).content


def test_a_loaded_map_believes_what_the_saved_one_did(seen: ObjectMap) -> None:
    again = ObjectMap(COMPARED)
    again.load_content(loaded(saved(seen)))
    before, after = ({o.class_name: o for o in m.objects()} for m in (seen, again))
    assert before["table"].image_text_nats != 0
    assert before.keys() == after.keys()
    for name, thing in before.items():
        assert after[name].score == pytest.approx(thing.score)
        assert after[name].image_text_nats == pytest.approx(thing.image_text_nats)


@pytest.mark.parametrize("turn_rad", [0.0, math.pi / 2, 1.0])
def test_a_stored_map_keeps_its_beliefs_in_another_frame(seen: ObjectMap, turn_rad: float) -> None:
    present = ObjectMap(COMPARED)
    present.add_stored(loaded(saved(seen)), se2_to_se3(3.0, -2.0, turn_rad))
    present.set_context(CONTEXT)
    before, after = ({o.class_name: o for o in m.objects()} for m in (seen, present))
    for name in ("table", "mug"):
        assert after[name].score == pytest.approx(before[name].score, abs=0.06)
    assert after["table"].image_text_nats == pytest.approx(before["table"].image_text_nats, abs=0.5)


def test_a_file_without_past_names_and_scores_is_read(seen: ObjectMap) -> None:
    old = {k: a for k, a in saved(seen).items() if not k.startswith(("sightings", "image_text"))}
    again = ObjectMap(COMPARED)
    again.load_content(loaded(old))
    assert {o.class_name for o in again.objects()} == {o.class_name for o in seen.objects()}
    assert all(o.image_text_nats is None for o in again.objects())


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("sightings.name", 99), ("sightings.view", -1), ("sightings.size", 0),
        ("sightings.view", 3), ("sightings.detection", 10**6),
        ("sightings.voxel", 10**6), ("sightings.keys", -5), ("sightings.eye_m", math.nan),
        ("image_text.voxel", 10**6), ("image_text.sums", math.inf), ("image_text.keys", -1),
        ("image_text.sector", 12), ("image_text.class", 9), ("image_text.scores", -1),
    ],
)  # fmt: skip
def test_a_file_with_an_impossible_reference_is_refused(
    seen: ObjectMap, name: str, value: float
) -> None:
    arrays = saved(seen)
    arrays[name] = arrays[name].copy()
    arrays[name].flat[0] = value
    with pytest.raises(InvalidInput, match="no whole object map"):
        loaded(arrays)


@pytest.mark.parametrize("name", ["sightings.voxel", "image_text.sector", "image_text.scores"])
def test_a_file_with_a_shortened_column_is_refused(seen: ObjectMap, name: str) -> None:
    arrays = saved(seen)
    arrays[name] = arrays[name][:-1]
    with pytest.raises(InvalidInput, match="no whole object map"):
        loaded(arrays)


def test_ignored_scores_of_a_file_change_nothing(seen: ObjectMap) -> None:
    ignoring = ObjectMap(SETTINGS)
    ignoring.load_content(loaded(saved(seen)))
    bare = ObjectMap(SETTINGS)
    bare.load_content(
        loaded({k: a for k, a in saved(seen).items() if not k.startswith("image_text")})
    )
    assert [o.score for o in ignoring.objects()] == [o.score for o in bare.objects()]
    assert all(o.image_text_nats is None for o in ignoring.objects())


@pytest.mark.parametrize("turn_rad", [0.0, math.pi / 2])
def test_views_of_a_stored_map_count_beside_the_present_ones(
    seen: ObjectMap, turn_rad: float
) -> None:
    """The same table was seen in both sessions: as often called, and twice as many views."""
    T = se2_to_se3(3.0, -2.0, turn_rad)
    present = ObjectMap(COMPARED)
    present.add_stored(loaded(saved(seen)), T)
    once, scores = present.content(), present.content().image_text
    present.add_stored(loaded(saved(seen)), T)
    content = present.content()
    assert len(content.sightings) == 2 * len(seen.content().sightings)
    rows = np.flatnonzero(content.store.column("mug") == content.store.class_column)
    points = content.store.means
    twice = content.sightings.rates(points, rows, "mug", 1.0)
    single = seen.content()
    rows = np.flatnonzero(single.store.column("mug") == single.store.class_column)
    before = single.sightings.rates(single.store.means, rows, "mug", 1.0)
    assert twice is not None
    assert before is not None
    assert twice.names == before.names
    np.testing.assert_allclose(twice.rate.mean(axis=0), before.rate.mean(axis=0), atol=0.15)
    assert once.image_text is scores
    arrays, own = scores.arrays(), single.image_text.arrays()
    np.testing.assert_allclose(arrays["scores"][:, 0], 2 * own["scores"][:, 0])
    np.testing.assert_allclose(arrays["scores"][:, 1], own["scores"][:, 1])
    np.testing.assert_allclose(arrays["scores"][:, 2], 2 * own["scores"][:, 2])
    np.testing.assert_allclose(arrays["sums"].sum(axis=0), 2 * own["sums"].sum(axis=0), rtol=1e-4)
    turned = round(turn_rad / (2 * math.pi) * 12)
    share = np.bincount(arrays["sector"], arrays["sums"][:, 0], 12)
    own_share = np.bincount(own["sector"], own["sums"][:, 0], 12)
    np.testing.assert_allclose(share, 2 * np.roll(own_share, turned), rtol=1e-4)


def test_scores_of_two_sessions_have_the_mean_and_deviation_of_all() -> None:
    one, other, both = _Distribution(), _Distribution(), _Distribution()
    for score in (0.1, 0.5, 0.3):
        one.add(score)
        both.add(score)
    for score in (0.9, 0.8):
        other.add(score)
        both.add(score)
    one.add_views(other.views, other.mean, other.squares)
    assert (one.views, one.mean, one.deviation) == pytest.approx(
        (both.views, both.mean, both.deviation)
    )


@pytest.mark.parametrize("present_views", [1, 3])
def test_the_views_of_today_outlast_those_of_a_stored_map(
    seen: ObjectMap, present_views: int
) -> None:
    stored = seen.content().sightings.arrays()
    today = NameSightings(most_views=6)
    own = NameSightings()
    own.add_arrays(stored)
    own._forget_views(len(own) - present_views)
    today.add_arrays(own.arrays())
    today.add_earlier(stored, None)
    assert len(today) == 6
    kept = today.arrays()["eye_m"]
    np.testing.assert_array_equal(kept[-present_views:], own.arrays()["eye_m"])


def test_a_file_that_would_fill_the_memory_is_refused(
    seen: ObjectMap, monkeypatch: pytest.MonkeyPatch
) -> None:
    arrays = saved(seen)
    used = len(np.unique(arrays["image_text.voxel"]))
    monkeypatch.setattr(image_text, "MOST_SUMS", used)
    loaded(arrays)
    monkeypatch.setattr(image_text, "MOST_SUMS", used - 1)
    with pytest.raises(InvalidInput, match=f"{used} voxels"):
        loaded(arrays)


def test_a_map_that_reaches_the_limit_leaves_out_scores_and_can_be_saved_and_joined(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def grown() -> ObjectMap:
        objects = ObjectMap(COMPARED)
        for seq, eye in enumerate(EYES):
            view = observe(SCENE, looking_at(*eye, (1.3, 0.0, 0.7)), seq=seq)
            objects.update(replace(view, class_scores={"table": 0.8}), CONTEXT)
        return objects

    whole = len(grown().content().image_text.arrays()["keys"])
    limit = whole * 2 // 3
    monkeypatch.setattr(image_text, "MOST_SUMS", limit)
    objects = grown()
    assert 0 < len(objects.content().image_text.arrays()["keys"]) <= limit
    again = ObjectMap(COMPARED)
    again.load_content(loaded(saved(objects)))
    gaussians = len(again)
    added = again.add_stored(loaded(saved(objects)), se2_to_se3(9.0, 0.0, 0.0))
    assert len(again) == gaussians + added == 2 * gaussians
    assert len(again.content().image_text.arrays()["keys"]) <= limit


def test_objects_of_a_stored_map_are_known_as_such_after_a_restart(seen: ObjectMap) -> None:
    present = ObjectMap(COMPARED)
    present.add_stored(loaded(saved(seen)), se2_to_se3(3.0, -2.0, 0.0))
    again = ObjectMap(COMPARED)
    again.load_content(loaded(saved(present)))
    assert again.added_objects() == present.added_objects() != frozenset()


def test_a_forgotten_class_has_no_scores_in_the_file(seen: ObjectMap) -> None:
    content = loaded(saved(seen))
    content.image_text.forget(["table"])
    assert not content.image_text.arrays()["names"].size
    assert not content.image_text.rates("table")


Entry = st.tuples(st.integers(0, 5), st.integers(0, 3), st.integers(1, 9))  # voxel, owner, pixels


@given(st.lists(Entry, max_size=30), st.integers(0, 3))
def test_entries_survive_storage_turns_and_the_loss_of_old_owners(entries, gone: int) -> None:
    points = np.array([(0.2 * v + 0.1, 0.1, 0.1) for v, _, _ in entries], np.float32).reshape(-1, 3)
    owner, pixels = (np.array([e[k] for e in entries], np.int32) for k in (1, 2))
    one = VoxelEntries(0.2, ["view", "pixels"])
    one.add(one.numbers(points), owner, pixels)

    def total(of: VoxelEntries, place: np.ndarray) -> dict[tuple[int, int], int]:
        found: dict[tuple[int, int], int] = {}
        for v in range(6):
            at = of.numbers(place[v : v + 1])[0]
            rows = np.flatnonzero(of.voxel.values == at)
            for row in rows:
                key = (v, int(of.columns["view"].values[row]))
                found[key] = found.get(key, 0) + int(of.columns["pixels"].values[row])
        return found

    places = np.array([(0.2 * v + 0.1, 0.1, 0.1) for v in range(6)], np.float32)
    wanted = total(one, places)
    T = se2_to_se3(1.0, 2.0, math.pi / 2)
    turned = VoxelEntries(0.2, ["view", "pixels"])
    turned.add_arrays(one.arrays(), 0, T)
    assert total(turned, (places @ T[:3, :3].T + T[:3, 3]).astype(np.float32)) == wanted
    rest = one.without(gone)
    assert total(rest, places) == {(v, o - gone): n for (v, o), n in wanted.items() if o >= gone}
    one.forget_at(places[:1])
    assert total(one, places) == {k: n for k, n in wanted.items() if k[0] != 0}
    assert (one.voxel.values == NO_VOXEL).sum() == sum(v == 0 for v, _, _ in entries)
