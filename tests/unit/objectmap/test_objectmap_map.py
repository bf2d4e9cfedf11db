"""The whole object map, on a synthetic table with mugs."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from helios_core.types import ObjectInstance, Role, SearchClass, SearchContext
from helios_objectmap.camera import View
from helios_objectmap.object_map import ObjectMap
from hypothesis import given, settings
from hypothesis import strategies as st
from objectmap_scene import (
    CAMERA,
    CONTEXT,
    COUNTER,
    MUG,
    ROOM,
    SETTINGS,
    TABLE,
    looking_at,
    mug_at,
    observe,
    pose,
)

MUG_CENTER = (1.2, 0.0, 0.8)
SCENE = (*ROOM, mug_at(1.2, 0.0))
AROUND = [(0.0, 0.0), (0.1, 0.3), (0.2, -0.3), (0.3, 0.5), (0.4, -0.5)]


def seen_from(places, boxes=SCENE, start=0, **kw):
    return [
        observe(boxes, looking_at(x, y, MUG_CENTER), seq=start + i, **kw)
        for i, (x, y) in enumerate(places)
    ]


def built(observations, context=CONTEXT, settings=SETTINGS) -> ObjectMap:
    objects = ObjectMap(settings)
    for o in observations:
        objects.update(o, context)
    return objects


def of_class(objects: ObjectMap, name: str) -> list[ObjectInstance]:
    return [o for o in objects.objects() if o.class_name == name]


def view(T) -> View:
    c = CAMERA
    return View(c.fx, c.fy, c.cx, c.cy, c.width, c.height, T)


def test_a_mug_seen_from_several_places_is_one_likely_object_at_its_position():
    objects = built(seen_from(AROUND))
    (mug,) = of_class(objects, "mug")
    assert np.linalg.norm(mug.center_m - MUG_CENTER) < 0.03
    assert np.abs(mug.size_m - [0.09, 0.09, 0.10]).max() < 0.04
    assert mug.top_m == pytest.approx(0.85, abs=0.02)
    assert mug.score > 0.6
    assert mug.score == pytest.approx(mug.class_score - mug.uncertainty)
    assert mug.views == len(AROUND)
    assert mug.detection_rate == 1.0
    assert sum(mug.probabilities.values()) == pytest.approx(1.0, abs=1e-5)
    (table,) = of_class(objects, "table")
    assert table.score > 0.7
    assert len(table.outline_m) >= 3


def test_a_class_that_is_start_and_goal_receptacle_scores_like_one_with_a_single_role():
    """For example: "Move the mug from a table to another table"."""
    another = SearchClass("table", Role.GOAL_RECEPTACLE, 0.5)
    once = of_class(built(seen_from(AROUND)), "table")
    twice = of_class(
        built(seen_from(AROUND), SearchContext(CONTEXT.id, (*CONTEXT.classes, another))), "table"
    )
    assert [t.score for t in twice] == pytest.approx([t.score for t in once])


def test_two_mugs_0_3_m_apart_are_two_objects():
    objects = built(seen_from(AROUND, (*ROOM, mug_at(1.2, -0.15), mug_at(1.2, 0.15))))
    centers = sorted(m.center_m[1] for m in of_class(objects, "mug"))
    assert centers == pytest.approx([-0.15, 0.15], abs=0.03)


def test_with_the_printed_voxels_two_mugs_0_3_m_apart_are_one_object():
    printed = SETTINGS.model_copy(update={"object_voxel_m": 0.5})
    mugs = (mug_at(1.2, -0.15), mug_at(1.2, 0.15))
    objects = built(seen_from(AROUND, (*ROOM, *mugs)), settings=printed)
    (mug,) = of_class(objects, "mug")
    assert mug.center_m[1] == pytest.approx(0.0, abs=0.05)


def test_a_new_gaussian_is_a_pixel_wide_and_almost_opaque():
    objects = built(seen_from(AROUND[:1]))
    store = objects.content().store
    (first,) = seen_from(AROUND[:1])
    depth_m = np.linalg.inv(first.frame.T_world_cam)[2] @ np.c_[store.means, store.radius_m**0].T
    np.testing.assert_allclose(store.radius_m, depth_m / first.frame.camera.fx, rtol=1e-3)
    np.testing.assert_allclose(store.opacity, 0.99, rtol=1e-6)


def test_by_the_printed_rule_views_from_one_place_add_evidence():
    """By ours, standing still changes no score."""
    views = seen_from(2 * AROUND[:1])
    for rule, count in (("full", 2), ("by-difference", 1)):
        objects = built(views, settings=SETTINGS.model_copy(update={"view_weights": rule}))
        assert [mug.views for mug in of_class(objects, "mug")] == [count]


def test_standing_still_changes_no_score_and_adds_no_gaussians():
    objects = built(seen_from(AROUND[:2]))
    last = looking_at(*AROUND[1], MUG_CENTER)
    before, size = objects.objects(), len(objects)
    for seq in range(10):
        report = objects.update(observe(SCENE, last, seq=10 + seq), CONTEXT)
        assert report.fused == 0
    after = objects.objects()
    assert len(objects) == size
    assert [(o.id, o.score, o.views) for o in after] == [(o.id, o.score, o.views) for o in before]


def test_standing_still_with_a_noisy_camera_hardly_changes_scores_and_adds_no_gaussians():
    objects = built(seen_from(AROUND[:2], noise_m=0.01))
    (before,), size = of_class(objects, "mug"), len(objects)
    last = looking_at(*AROUND[1], MUG_CENTER)
    for seq in range(60):  # a keyframe a second for a minute
        objects.update(observe(SCENE, last, seq=10 + seq, noise_m=0.01), CONTEXT)
    (after,) = of_class(objects, "mug")
    assert after.score == pytest.approx(before.score, abs=0.02)
    assert len(objects) == size


@pytest.mark.parametrize(("speed_m_s", "turning"), [(0.3, False), (0.2, True)])
def test_replays_of_one_path_at_5_10_and_30_hz_agree(speed_m_s, turning):
    scores = []
    for hz in (5, 10, 30):
        path = np.linspace(-0.3, 0.3, 1 + round(0.6 * hz / speed_m_s))
        poses = [looking_at(0.0, y, MUG_CENTER) if turning else pose(y=y) for y in path]
        (mug,) = of_class(built(observe(SCENE, T, seq=i) for i, T in enumerate(poses)), "mug")
        scores.append(mug.score)
    assert max(scores) - min(scores) < 0.02


def test_a_false_detection_fades_with_views_that_do_not_repeat_it():
    wrong = {3: "mug"}
    boxes = (*ROOM, mug_at(1.2, 0.0))
    objects = built(seen_from(AROUND[:1], boxes, called=wrong))
    (once,) = of_class(objects, "mug")
    for o in seen_from(AROUND[1:], boxes, start=1, called={}):
        objects.update(o, CONTEXT)
    assert all(m.score < min(0.3, once.score) for m in of_class(objects, "mug"))


def test_a_moved_object_fades_over_distinct_views_and_appears_at_its_new_position():
    objects = built(seen_from(AROUND[:2]))
    (mug,) = of_class(objects, "mug")
    now = (*ROOM, mug_at(1.5, 0.4))
    first = objects.update(seen_from(AROUND[2:3], now, start=2)[0], CONTEXT)
    assert first.carved == 0  # one view may err
    again = objects.update(seen_from(AROUND[2:3], now, start=3)[0], CONTEXT)
    assert again.carved == 0  # the same view again adds no evidence
    (fading,) = [m for m in of_class(objects, "mug") if m.id == mug.id]
    assert fading.score < mug.score
    second = objects.update(seen_from(AROUND[3:4], now, start=4)[0], CONTEXT)
    assert second.carved > 0.7 * mug.gaussians  # edges may need one more view
    for o in seen_from(AROUND[:2] + AROUND[4:], now, start=5):
        objects.update(o, CONTEXT)
    here = [m for m in of_class(objects, "mug") if m.score >= 0.5]
    assert len(here) == 1
    assert np.linalg.norm(here[0].center_m[:2] - [1.5, 0.4]) < 0.05
    assert all(m.score < 0.3 for m in of_class(objects, "mug") if m.id != here[0].id)
    (table,) = of_class(objects, "table")
    assert table.score > 0.6


def test_without_carving_no_gaussian_of_a_moved_object_leaves():
    now = (*ROOM, mug_at(1.5, 0.4))
    for carves in (True, False):
        objects = ObjectMap(SETTINGS.model_copy(update={"carving": carves}))
        for o in seen_from(AROUND[:2]):
            objects.update(o, CONTEXT)
        later = [objects.update(o, CONTEXT) for o in seen_from(AROUND[2:], now, start=2)]
        assert (sum(report.carved for report in later) > 0) is carves


def test_gaussians_seen_through_by_mistake_are_restored_by_the_next_view():
    objects = built(seen_from(AROUND[:2]))
    (before,) = of_class(objects, "mug")
    objects.update(seen_from(AROUND[2:3], ROOM, start=2)[0], CONTEXT)
    for o in seen_from(AROUND[3:4], start=3) + seen_from(AROUND[4:], ROOM, start=4):
        assert objects.update(o, CONTEXT).carved < 0.1 * before.gaussians
    assert of_class(objects, "mug")[0].id == before.id


def test_retire_removes_the_object_and_leaves_the_table():
    objects = built(seen_from(AROUND))
    (mug,), (table,) = of_class(objects, "mug"), of_class(objects, "table")
    assert objects.nearest_object(np.array(MUG_CENTER), 0.1) == mug.id
    assert objects.nearest_object(np.array([9.0, 9.0, 0.0]), 0.1) is None
    assert objects.retire(mug.id) >= mug.gaussians
    assert not of_class(objects, "mug")
    (still,) = of_class(objects, "table")
    assert still.id == table.id
    assert still.gaussians > 0.9 * table.gaussians
    assert objects.retire(mug.id) == 0


def test_depth_below_the_minimum_and_the_held_object_create_no_gaussians():
    held = (*ROOM, ("mug", (0.15, -0.03, 1.1), (0.20, 0.03, 1.2)))
    assert not of_class(built([observe(held, pose())]), "mug")
    objects = ObjectMap(SETTINGS)
    near = (*ROOM, ("mug", (0.5, -0.1, 0.9), (0.6, 0.1, 1.1)))
    objects.update(observe(near, pose()), CONTEXT, held="mug")
    assert not of_class(objects, "mug")
    mistaken = SearchContext("c", (MUG, SearchClass("bowl", Role.OBJECT, 0.3), TABLE))
    o = observe(near, pose(), context=mistaken, called={2: "table", 3: "bowl"})
    objects.update(o, mistaken, held="mug")
    assert {x.class_name for x in objects.objects()} == {"table"}
    objects.reset()
    objects.update(observe(near, pose()), CONTEXT)
    assert of_class(objects, "mug")


@pytest.mark.parametrize("taken_for_a_mug_every", [None, 3])
def test_the_robots_arm_in_view_never_becomes_a_likely_object(taken_for_a_mug_every):
    """The arm moves with the camera, so the next views see through its former place."""
    objects, highest = ObjectMap(SETTINGS), 0.0
    for seq, y in enumerate(np.linspace(-0.3, 0.3, 13)):
        arm = ("arm", (0.35, y - 0.04, 1.0), (0.60, y + 0.04, 1.1))
        boxes = (*SCENE, arm)
        called = {i: box[0] for i, box in enumerate(boxes)}
        if taken_for_a_mug_every and seq % taken_for_a_mug_every == 0:
            called[len(boxes) - 1] = "mug"
        objects.update(observe(boxes, pose(y=y), seq=seq, called=called), CONTEXT)
        at_arm = [o.score for o in objects.objects() if o.center_m[0] < 0.8]
        highest = max([highest, *at_arm])
        assert taken_for_a_mug_every or not at_arm
    assert highest < 0.5
    assert len([m for m in of_class(objects, "mug") if m.score >= 0.5]) == 1


def test_detections_below_the_threshold_or_of_other_classes_are_ignored():
    o = seen_from(AROUND[:1])[0]
    weak = tuple(dataclasses.replace(d, score=0.2) for d in o.detections)
    strange = tuple(dataclasses.replace(d, class_name="cat") for d in o.detections)
    for detections in (weak, strange):
        assert not built([dataclasses.replace(o, detections=detections)]).objects()


def test_a_table_mask_that_covers_a_mug_does_not_hide_the_mug():
    o = seen_from(AROUND[:1])[0]
    mug, table = sorted(o.detections, key=lambda d: d.mask.sum())
    covering = dataclasses.replace(table, mask=table.mask | mug.mask)
    for order in ((mug, covering), (covering, mug)):
        assert of_class(built([dataclasses.replace(o, detections=order)]), "mug")


def test_a_shared_class_keeps_its_evidence_in_a_new_context_and_new_classes_start_afresh():
    objects = built(seen_from(AROUND))
    (mug,) = of_class(objects, "mug")
    objects.set_context(SearchContext("c2", (MUG, COUNTER)))
    (same,) = of_class(objects, "mug")
    assert same.id == mug.id
    assert same.score == pytest.approx(mug.score, abs=0.05)
    assert same.probabilities["counter"] == pytest.approx(1 / 4, abs=0.01)
    assert of_class(objects, "table")  # an earlier task's table keeps its class


def test_what_the_present_search_names_no_more_is_no_object_of_an_earlier_search():
    """Without evidence every class has the probability of the prior, which is above 0.15."""
    objects = ObjectMap(SETTINGS.model_copy(update={"named_from": 0.15}))
    objects.set_context(SearchContext("c1", (MUG,)))
    counter = SearchContext("c2", (COUNTER,))
    around = [(0.0, y) for y in np.linspace(-0.6, 0.6, 9)]
    (once,) = seen_from(around[:1], ROOM, context=counter, called={2: "counter"})
    objects.update(once, counter)
    assert of_class(objects, "counter")
    for o in seen_from(around[1:], ROOM, start=1, context=counter, called={}):
        objects.update(o, counter)
    assert not of_class(objects, "mug")


def test_views_of_a_context_without_a_class_do_not_count_against_that_class():
    only_table = SearchContext("c0", (TABLE,))
    objects = ObjectMap(SETTINGS)
    for o in seen_from(AROUND, context=only_table, called={2: "table", 3: "table"}):
        objects.update(o, only_table)
    for o in seen_from(AROUND, start=9):
        objects.update(o, CONTEXT)
    (mug,) = of_class(objects, "mug")
    assert mug.score > 0.5


def test_what_if_raises_the_score_and_gains_information():
    objects = built(seen_from(AROUND[:2]))
    (mug,) = of_class(objects, "mug")
    towards = view(looking_at(0.5, 0.1, MUG_CENTER))
    away = view(pose(yaw=np.pi))
    answer = objects.what_if(mug.id, "mug", [towards, away])
    assert answer is not None
    (near, nothing), together = answer
    assert near.psi > mug.score + 0.03
    assert near.information_gain > 0
    assert nothing.psi == pytest.approx(mug.score, abs=1e-6)
    assert nothing.information_gain == pytest.approx(0, abs=1e-6)
    assert together.psi == pytest.approx(near.psi)
    assert objects.what_if(999, "mug", [towards]) is None
    assert objects.what_if(mug.id, "cat", [towards]) is None


def test_the_50_50_assumption_expects_a_lower_score():
    expected = []
    for assumption in ("optimistic", "50-50"):
        objects = ObjectMap(SETTINGS.model_copy(update={"assumption": assumption}))
        for o in seen_from(AROUND[:2]):
            objects.update(o, CONTEXT)
        (mug,) = of_class(objects, "mug")
        answer = objects.what_if(mug.id, "mug", [view(looking_at(0.5, 0.1, MUG_CENTER))])
        assert answer is not None
        expected.append(answer[1].psi)
    assert expected[1] < expected[0]


def test_the_history_of_an_object_ends_with_its_present_score():
    objects = built(seen_from(AROUND))
    (mug,) = of_class(objects, "mug")
    history = objects.history(mug.id)
    assert [m.stamp_ns for m in history] == list(range(len(AROUND)))
    assert [m.views for m in history] == [1, 2, 3, 4, 5]
    assert history[-1].score == pytest.approx(mug.score)
    assert history[0].score < history[-1].score
    assert objects.history(99) == ()


def test_a_what_if_changes_nothing():
    objects = built(seen_from(AROUND[:2]))
    before = objects.objects()
    for o in before:
        objects.what_if(o.id, o.class_name, [view(pose())])
    assert [(o.id, o.score) for o in objects.objects()] == [(o.id, o.score) for o in before]


def test_a_what_if_predicts_a_real_view_that_sees_the_class():
    objects = built(seen_from(AROUND[:2]))
    (mug,) = of_class(objects, "mug")
    there = looking_at(0.15, 0.2, MUG_CENTER)
    answer = objects.what_if(mug.id, "mug", [view(there)])
    assert answer is not None
    objects.update(observe(SCENE, there, seq=5), CONTEXT)
    (after,) = of_class(objects, "mug")
    # Optimistic: the real view also occludes and creates Gaussians that have been seen once.
    assert after.score == pytest.approx(answer[0][0].psi, abs=0.08)


@settings(max_examples=4, deadline=None)
@given(st.permutations(range(3)))
def test_instances_do_not_depend_on_the_order_of_views(order):
    objects = built([seen_from(AROUND)[i] for i in order])
    (mug,) = of_class(objects, "mug")
    assert np.linalg.norm(mug.center_m - MUG_CENTER) < 0.05  # only the front is seen
    assert len(of_class(objects, "table")) == 1


def test_the_number_of_gaussians_stays_below_the_limit():
    objects = ObjectMap(SETTINGS.model_copy(update={"max_gaussians": 2000}))
    for o in seen_from(AROUND):
        assert objects.update(o, CONTEXT).total <= 2000
    assert of_class(objects, "table")


def test_the_longest_unused_class_is_dropped_and_the_others_keep_their_evidence():
    few = ObjectMap(SETTINGS.model_copy(update={"max_classes": 2}))
    many = ObjectMap(SETTINGS)
    only_mug = SearchContext("c2", (MUG, COUNTER))
    for objects in (few, many):
        for o in seen_from(AROUND):
            objects.update(o, CONTEXT)
        objects.set_context(only_mug)
    assert few.gaussians().class_names == ("other", "mug", "counter")
    assert not of_class(few, "table")
    assert of_class(many, "table")
    ((mine,), (theirs,)) = (of_class(objects, "mug") for objects in (few, many))
    assert mine.score == theirs.score
    for o in seen_from(AROUND[:1], start=9, context=only_mug):
        few.update(o, only_mug)


def test_an_empty_map_answers_every_query():
    objects = ObjectMap(SETTINGS)
    assert objects.objects() == ()
    assert len(objects.gaussians().means) == 0
    assert objects.what_if(1, "mug", []) is None


def test_gaussians_come_with_their_concentrations():
    objects = built(seen_from(AROUND))
    (mug,) = of_class(objects, "mug")
    gaussians = objects.gaussians(mug.id)
    assert gaussians.class_names == ("other", "mug", "table")
    expected = gaussians.concentration / gaussians.concentration.sum(axis=1, keepdims=True)
    assert expected[:, 1].mean() == pytest.approx(mug.class_score, abs=1e-4)
    assert set(gaussians.instance) == {mug.id}


def test_the_class_of_an_object_is_the_most_frequent_class_of_its_gaussians():
    objects = built(seen_from(AROUND))
    found = [o for o in objects.objects() if o.class_name in {"mug", "table"}]
    assert {o.class_name for o in found} == {"mug", "table"}
    for o in found:
        gaussians = objects.gaussians(o.id)
        mean = gaussians.concentration / gaussians.concentration.sum(axis=1, keepdims=True)
        names = [gaussians.class_names[k] for k in mean.argmax(axis=1)]
        assert max(set(names), key=names.count) == o.class_name


def test_a_rendered_label_expects_less_than_a_one_hot_label():
    gains = {}
    for label in ("one-hot", "rendered"):
        objects = ObjectMap(SETTINGS.model_copy(update={"expected_label": label}))
        objects.update(observe((*ROOM, mug_at(1.3, 0.0)), pose()), CONTEXT)
        mug = next(o for o in objects.objects() if o.class_name == "mug")
        answer = objects.what_if(mug.id, "mug", [view(pose(0.3, 0.4))])
        assert answer is not None
        gains[label] = answer[1].information_gain
    assert 0 < gains["rendered"] < gains["one-hot"]
