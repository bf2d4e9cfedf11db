"""Evidence by viewing sectors: plain Python reference, bounds, what-ifs and map files."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helios_core.errors import InvalidInput
from helios_objectmap import persistence
from helios_objectmap.camera import View
from helios_objectmap.fusion.viewing_sectors import (
    MOST_VOTES,
    SECTORS,
    UNIT,
    WHOLE_KAPPA,
    add_votes,
    expected_new_votes,
    sector_of,
)
from helios_objectmap.gaussians import GaussianStore
from helios_objectmap.object_map import ObjectMap
from hypothesis import given, settings
from hypothesis import strategies as st
from objectmap_scene import CAMERA, CONTEXT, ROOM, SETTINGS, looking_at, mug_at, observe

SIDES = SETTINGS.model_copy(update={"evidence": "sides"})
FULL, ALPHA = 4.0, 6.0  # side_views and alpha_side in the tests of the pure functions
SEEDS = st.integers(0, 2**32 - 1)


def store_of(means, classes=1) -> GaussianStore:
    store = GaussianStore(SECTORS)
    for c in range(classes):
        store.column(f"c{c}")
    store.append(
        np.asarray(means, np.float32),
        np.full(len(means), 0.01, np.float32),
        0.9,
        np.zeros((len(means), 3), np.uint8),
        0,
    )
    return store


def views_of(rng, n, classes, count, spread_rad=math.pi):
    """Views as (kappa, weights, eye), from all around or from within one sector."""
    for _ in range(count):
        turn = rng.uniform(-spread_rad, spread_rad) + math.pi / SECTORS
        kappa = rng.choice([0, 0.1, 1, 40], (n, 1)) * rng.dirichlet(np.ones(classes + 1), n)
        weights = rng.choice([0, 0.25, 1], (n, classes))
        eye_m = 50 * np.array([math.cos(turn), math.sin(turn), 0.0])
        yield kappa.astype(np.float32), weights.astype(np.float32), eye_m


def take(store, view) -> None:
    kappa, weights, eye_m = view
    columns = list(range(weights.shape[1]))
    add_votes(store, np.arange(len(store)), kappa, columns, weights, eye_m, FULL, ALPHA)


def reference(means, views, classes):
    """(positive, total_evidence) [n, classes] of eq. 3 by viewing sectors, in plain Python."""
    positive, total_evidence = np.zeros((len(means), classes)), np.zeros((len(means), classes))
    for i, place in enumerate(means):
        for c in range(classes):
            own, everything = [0.0] * SECTORS, [0.0] * SECTORS
            for kappa, weights, eye_m in views:
                away = eye_m - place
                side = int(math.degrees(math.atan2(away[1], away[0])) % 360 // 30)
                vote = kappa[i] / max(kappa[i].sum(), WHOLE_KAPPA)  # at most one in total
                own[side] += weights[i, c] * vote[1 + c]
                everything[side] += weights[i, c] * vote.sum()
            for v_c, v in zip(own, everything, strict=True):
                positive[i, c] += ALPHA * v_c / max(v, FULL)
                total_evidence[i, c] += ALPHA * v / max(v, FULL)
    return positive, total_evidence


@settings(max_examples=20, deadline=None)
@given(SEEDS, st.integers(1, 3), st.integers(1, 15))
def test_evidence_equals_the_reference(seed, classes, count):
    rng = np.random.default_rng(seed)
    means = rng.uniform(-1, 1, (4, 3)).astype(np.float32)
    store, views = store_of(means, classes), list(views_of(rng, 4, classes, count))
    for view in views:
        take(store, view)
    positive, total_evidence = reference(means, views, classes)
    rounding = ALPHA / FULL * count / UNIT  # of a vote to a whole number of UNIT
    assert np.allclose(store.class_evidence, positive, atol=rounding)
    assert np.allclose(store.total_evidence, total_evidence, atol=rounding)


def test_viewing_sectors_span_30_degrees_around_a_gaussian_at_any_height():
    means = np.zeros((1, 3), np.float32)
    turns = np.radians([1, 29, 31, 179, 181, 359])
    eyes_m = [(math.cos(t), math.sin(t), z) for t, z in zip(turns, [0, 9, 0, 1, 2, 3], strict=True)]
    assert [int(sector_of(means, np.array(e))[0]) for e in eyes_m] == [0, 0, 1, 5, 6, 11]


@settings(max_examples=20, deadline=None)
@given(SEEDS, st.integers(1, 60))
def test_evidence_is_at_most_alpha_side_per_viewing_sector(seed, count):
    rng = np.random.default_rng(seed)
    for spread_rad, sides in ((math.pi / SECTORS * 0.9, 1), (math.pi, SECTORS)):
        store = store_of(np.zeros((5, 3)), 2)
        for view in views_of(rng, 5, 2, count, spread_rad):
            before = store.total_evidence.copy()
            take(store, view)
            assert (store.total_evidence >= before - 1e-4).all()
            assert (store.total_evidence <= ALPHA * sides + 1e-3).all()
            assert (store.class_evidence >= -1e-3).all()
            assert (
                store.class_evidence.sum(axis=1) <= store.total_evidence.max(axis=1) * 2 + 1e-3
            ).all()
            assert (store.class_evidence <= store.total_evidence + 1e-3).all()


@settings(max_examples=20, deadline=None)
@given(SEEDS, st.integers(1, 30))
def test_the_order_of_views_does_not_matter(seed, count):
    rng = np.random.default_rng(seed)
    views = list(views_of(rng, 5, 2, count))
    one, other = store_of(np.zeros((5, 3)), 2), store_of(np.zeros((5, 3)), 2)
    for k in range(count):
        take(one, views[k])
    for k in rng.permutation(count):
        take(other, views[k])
    assert np.array_equal(one.votes, other.votes)
    assert np.allclose(one.class_evidence, other.class_evidence, atol=1e-4)
    assert np.allclose(one.total_evidence, other.total_evidence, atol=1e-4)


def test_a_view_is_at_most_one_vote_and_less_at_a_low_blending_weight():
    store = store_of(np.zeros((4, 3)))
    kappa = np.array([[0, 1000], [0, WHOLE_KAPPA], [0, WHOLE_KAPPA / 2], [0, 0]], np.float32)
    took = add_votes(
        store, np.arange(4), kappa, [0], np.ones((4, 1), np.float32), np.ones(3), FULL, ALPHA
    )
    assert store.votes.sum(axis=(1, 2, 3)).tolist() == [2 * UNIT, 2 * UNIT, UNIT, 0]
    assert took.tolist() == [0, 1, 2]


def test_a_sector_seen_for_hours_still_counts_in_full_by_its_mean():
    store, eye_m = store_of(np.zeros((1, 3))), np.ones(3)
    for k in range(3 * MOST_VOTES):
        kappa = np.array([[1, 3] if k % 2 else [3, 1]], np.float32)
        take(store, (kappa, np.ones((1, 1), np.float32), eye_m))
    assert store.total_evidence[0, 0] == pytest.approx(ALPHA, abs=1e-3)
    assert store.class_evidence[0, 0] == pytest.approx(ALPHA / 2, rel=0.01)


# What-ifs ---------------------------------------------------------------------------------------


@settings(max_examples=30, deadline=None)
@given(SEEDS, st.integers(0, 30))
def test_a_prediction_equals_a_view_that_shows_the_class_in_the_open_share_of_its_sector(
    seed, count
):
    """In the share that was seen before, the view repeats the mean of the earlier votes."""
    rng = np.random.default_rng(seed)
    n = 6
    store = store_of(rng.uniform(-1, 1, (n, 3)))
    for view in views_of(rng, n, 1, count, rng.choice([0.2, math.pi])):
        take(store, view)
    ((_, _, eye_m),) = views_of(rng, n, 1, 1)
    seen = rng.choice([0, 0.1, 5], n).astype(np.float32)
    (alone,), together = expected_new_votes(
        store.votes[:, 0, :, 1], store.means, [seen], [eye_m], FULL
    )
    assert np.allclose(alone, together, atol=1e-6)

    side = sector_of(store.means, eye_m)
    own, reported = store.votes[np.arange(n), 0, side].T.astype(float) / UNIT
    vote = np.minimum(seen / WHOLE_KAPPA, 1)
    new = np.clip(FULL - reported, 0, vote)
    mean = (own + new) / np.maximum(reported + new, 1e-9)
    shown = new + (vote - new) * mean
    kappa = np.stack([vote - shown, shown], axis=1) * np.maximum(seen, WHOLE_KAPPA)[:, None]
    before = store.class_evidence.copy(), store.total_evidence.copy()
    take(store, (kappa.astype(np.float32), np.ones((n, 1), np.float32), eye_m))
    rounding = 2 * ALPHA / FULL / UNIT
    assert np.allclose(store.class_evidence - before[0], ALPHA * alone[:, None], atol=rounding)
    assert np.allclose(store.total_evidence - before[1], ALPHA * alone[:, None], atol=rounding)


@settings(max_examples=20, deadline=None)
@given(SEEDS, st.integers(0, 20), st.integers(1, 10))
def test_a_joint_prediction_equals_the_real_views_and_is_at_most_the_sum_of_single_ones(
    seed, reported, count
):
    rng = np.random.default_rng(seed)
    n = 4
    store = store_of(rng.uniform(-1, 1, (n, 3)))
    for view in views_of(rng, n, 1, reported):
        take(store, view)
    views = [(k, np.ones((n, 1), np.float32), e) for k, _, e in views_of(rng, n, 1, count, 0.5)]
    before = store.total_evidence[:, 0].copy()
    alone, together = expected_new_votes(
        store.votes[:, 0, :, 1],
        store.means,
        [k.sum(axis=1) for k, _, _ in views],
        [e for _, _, e in views],
        FULL,
    )
    for view in views:
        take(store, view)
    assert np.allclose(
        store.total_evidence[:, 0] - before, ALPHA * together, atol=2 * ALPHA * count / UNIT
    )
    assert (together <= np.sum(alone, axis=0) + 1e-5).all()


# The map ----------------------------------------------------------------------------------------

MUG_CENTER = (1.2, 0.0, 0.8)
SCENE = (*ROOM, mug_at(1.2, 0.0))
ONE_SIDE = [(0.0, 0.02 * k) for k in range(10)]  # all within 30 degrees around the mug


def built(chosen, places=ONE_SIDE, objects: ObjectMap | None = None, start=0) -> ObjectMap:
    objects = objects or ObjectMap(chosen)
    for seq, (x, y) in enumerate(places, start):
        objects.update(observe(SCENE, looking_at(x, y, MUG_CENTER), seq=seq), CONTEXT)
    return objects


def mug_of(objects: ObjectMap):
    (mug,) = (o for o in objects.objects() if o.class_name == "mug")
    return mug


def view_from(x, y) -> View:
    c = CAMERA
    T_world_cam = looking_at(x, y, MUG_CENTER)
    return View(c.fx, c.fy, c.cx, c.cy, c.width, c.height, T_world_cam)


def reloaded(objects: ObjectMap, chosen) -> ObjectMap:
    """The map after saving, loaded into a map with other settings."""
    again = ObjectMap(chosen)
    data = persistence.to_bytes(persistence.arrays_of(objects.content(), None))
    again.load_content(persistence.read(data, again.empty_viewpoints()).content)
    again.set_context(CONTEXT)
    return again


@pytest.fixture(scope="module")
def reported() -> ObjectMap:
    """A map of a mug that was seen from one side; tests must not change it."""
    return built(SIDES.model_copy(update={"side_views": 3.0}))


def test_a_view_from_a_seen_sector_promises_little_information(reported):
    mug = mug_of(reported)
    answer = reported.what_if(mug.id, "mug", [view_from(0.0, 0.06), view_from(1.2, -1.2)])
    assert answer is not None
    (same, new), together = answer
    # More than nothing: Gaussians in the corners were hidden so far.
    assert same.information_gain < 0.2 * new.information_gain
    assert same.psi - mug.score < 0.2 * (new.psi - mug.score)
    assert together.psi == pytest.approx(new.psi, abs=0.02)


def test_more_new_sides_promise_more(reported):
    """As in measured looks: the same place is worth nothing, one new side something, three sides
    more, and eleven the most."""
    mug = mug_of(reported)
    x, y, _ = MUG_CENTER

    def rise(*turns_deg: float) -> float:
        turns = [math.radians(turn) for turn in turns_deg]
        views = [view_from(x + 1.2 * math.cos(t), y + 1.2 * math.sin(t)) for t in turns]
        answer = reported.what_if(mug.id, "mug", views)
        assert answer is not None
        return answer[1].psi - mug.score

    seen_deg = math.degrees(math.atan2(0.06 - y, 0.0 - x))
    same = rise(seen_deg)
    one, three, eleven = (
        rise(*(seen_deg + 360 * k / (n + 1) for k in range(1, n + 1))) for n in (1, 3, 11)
    )
    assert same < 0.2 * one
    assert one < three < eleven


def test_a_what_if_predicts_a_real_view_from_a_new_sector(reported):
    objects = reloaded(reported, SIDES.model_copy(update={"side_views": 3.0}))
    built(SIDES, [(0.8, 0.9)], objects, start=20)  # creates Gaussians of the surface there
    before = mug_of(objects)
    answer = objects.what_if(before.id, "mug", [view_from(0.7, 1.0)])
    assert answer is not None
    after = mug_of(built(SIDES, [(0.7, 1.0)], objects, start=21))
    assert after.score > before.score + 0.02
    # The real view also creates Gaussians that have been seen once.
    assert after.score == pytest.approx(answer[0][0].psi, abs=0.05)


def test_evidence_by_views_stores_no_votes_and_ignores_the_sector_settings():
    plain = built(SETTINGS)
    other = built(SETTINGS.model_copy(update={"side_views": 1.0, "alpha_side": 1.0}))
    assert plain.content().store.votes.nbytes == 0
    mine, theirs = (persistence.arrays_of(m.content(), None) for m in (plain, other))
    assert "store.votes" not in mine
    assert mine.keys() == theirs.keys()
    assert all(np.array_equal(mine[name], theirs[name]) for name in mine)


def test_a_map_file_keeps_the_votes_and_the_loaded_map_continues_identically(reported):
    chosen = SIDES.model_copy(update={"side_views": 3.0})
    one, other = reloaded(reported, chosen), reloaded(reported, chosen)
    assert np.array_equal(one.content().store.votes, reported.content().store.votes)
    other = reloaded(other, chosen)
    more = [(0.1, 0.3), (0.3, 0.5)]
    for objects in (one, other):
        built(chosen, more, objects, 20)
    mine, theirs = (persistence.arrays_of(m.content(), None) for m in (one, other))
    assert mine["store.votes"].any()
    assert all(np.array_equal(mine[name], theirs[name]) for name in mine)


def test_a_file_of_the_other_evidence_rule_keeps_its_evidence_and_follows_the_new_rule(reported):
    by_views = reloaded(reported, SETTINGS)
    assert [o.score for o in by_views.objects()] == [o.score for o in reported.objects()]
    assert by_views.content().store.votes.nbytes == 0
    by_sides = reloaded(built(SETTINGS), SIDES)
    assert not by_sides.content().store.votes.any()
    for objects, chosen in ((by_views, SETTINGS), (by_sides, SIDES)):
        store = objects.content().store
        before = store.total_evidence.copy()
        built(chosen, [(0.5, 0.5)], objects, start=20)
        grown = store.total_evidence[: len(before)] - before
        assert grown.min() >= -1e-4
        one_vote = SIDES.alpha_side / SIDES.side_views
        assert (grown.max() > 3 * one_vote) == (chosen is SETTINGS)
    assert by_sides.content().store.votes.any()


def test_a_file_with_invalid_votes_is_refused(reported):
    arrays = persistence.arrays_of(reported.content(), None)
    wrong = {
        "more for a class than in all": arrays["store.votes"][..., ::-1] + np.uint16(1),
        "other sectors": arrays["store.votes"][:, :, :6],
        "other numbers": arrays["store.votes"].astype(np.float32),
    }
    for votes in wrong.values():
        with pytest.raises(InvalidInput):
            persistence.read(
                persistence.to_bytes(arrays | {"store.votes": np.ascontiguousarray(votes)}),
                reported.empty_viewpoints(),
            )


def test_retiring_an_object_or_dropping_a_class_removes_only_its_own_votes(reported):
    objects = reloaded(reported, SIDES.model_copy(update={"max_classes": 2}))
    store = objects.content().store

    def votes_by_place() -> dict[bytes, bytes]:
        table = store.votes[:, store.class_names.index("table")]
        return {p.tobytes(): v.tobytes() for p, v in zip(store.means, table, strict=True)}

    before = votes_by_place()
    assert objects.retire(mug_of(objects).id)
    left = votes_by_place()
    assert 0 < len(left) < len(before)
    assert left.items() <= before.items()
    column = store.column("a new class")
    assert not store.votes[:, column].any()
    store.class_column[store.class_column == store.class_names.index("mug")] = -1
    store.drop_columns(["mug"])
    assert votes_by_place() == left
    store.append(
        store.means[:3] + 9, store.radius_m[:3], 0.9, np.zeros((3, 3), np.uint8), 99
    )  # in rows of removed Gaussians
    assert not store.votes[-3:].any()


def test_the_box_of_two_joined_objects_is_that_of_the_likelier_one() -> None:
    """Masks that run over join adjacent objects; a gripper goes to the middle of the box."""
    object_map = ObjectMap(SIDES.model_copy(update={"named_from": 0.2}))
    home = (*ROOM, mug_at(1.4, 0.0), mug_at(1.4, 0.12))
    for k, y in enumerate(np.linspace(-1.2, 1.2, 9)):
        called = {3: "mug", 4: "mug"} if k % 3 == 1 else {3: "mug"}
        seen = observe(home, looking_at(0.4, y, (1.4, 0.0, 0.8)), seq=k, called=called)
        object_map.update(seen, CONTEXT)
    (joined,) = (o for o in object_map.objects() if o.class_name == "mug")
    assert abs(joined.center_m[1]) < 0.03  # 0.06 is between the mugs
    grasp = object_map.grasp(joined.id)
    assert grasp is not None
    assert abs(grasp.center_m[1]) < 0.03  # 0.06 is between the mugs
