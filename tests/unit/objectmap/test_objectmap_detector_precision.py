"""Trust in detections: learnt from what became of earlier ones, and used only if set so."""

from __future__ import annotations

import json

import numpy as np
import pytest
from helios_core.types import Role, SearchClass, SearchContext
from helios_objectmap import persistence
from helios_objectmap.camera import View
from helios_objectmap.instances.detector_precision import (
    N_BANDS,
    FormerDetections,
    bands,
    mean_share,
    true_share,
)
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
    looking_at,
    mug_at,
    observe,
    pose,
)

BY_CLASS = SETTINGS.model_copy(update={"detector_trust": "class"})
MUG_CENTER, ELSEWHERE = (1.2, 0.0, 0.8), (1.4, 0.4, 0.8)
SCENE = (*ROOM, mug_at(1.2, 0.0), mug_at(1.4, 0.4))
FROM = [(0.0, 0.0), (0.1, 0.3), (0.2, -0.3), (0.3, 0.5), (0.4, -0.5)]


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_the_true_detection_share_is_a_beta_mean_over_present_and_ended_instances(seed):
    rng = np.random.default_rng(seed)
    things = [(rng.uniform(0, 4, N_BANDS), rng.random()) for _ in range(rng.integers(0, 6))]
    ended = FormerDetections()
    for _ in range(3):
        ended.add(rng.uniform(0, 2, N_BANDS), 0.25)
    for by_distance in (False, True):
        share = true_share(things, ended, by_distance)
        for band in range(N_BANDS):
            chosen = slice(band, band + 1) if by_distance else slice(None)
            true = sum(rate * d[chosen].sum() for d, rate in things)
            everything = sum(d[chosen].sum() for d, _ in things) + ended.all[chosen].sum()
            true += 0.25 * ended.all[chosen].sum()
            assert share[band] == pytest.approx((1 + true) / (2 + everything))


def test_the_trust_in_an_instance_is_the_mean_over_its_detection_distances():
    share = np.array([1.0, 0.5, 0.1])
    assert mean_share(share, np.array([3.0, 1.0, 0.0])) == pytest.approx(0.875)
    assert mean_share(share, np.zeros(N_BANDS)) == pytest.approx(share.mean())
    assert bands(np.array([1.4, 1.5, 2.9, 3.0])).tolist() == [0, 1, 1, 2]


def built(chosen, calls) -> ObjectMap:
    """A map after views of the table from FROM; calls: the classes of the boxes in each view."""
    objects = ObjectMap(chosen)
    for seq, ((x, y), called) in enumerate(zip(FROM, calls, strict=False)):
        o = observe(SCENE, looking_at(x, y, MUG_CENTER), seq=seq, called={2: "table"} | called)
        objects.update(o, CONTEXT)
    return objects


def mug_near(objects: ObjectMap, place):
    mugs = [o for o in objects.objects() if o.class_name == "mug"]
    return next((o for o in mugs if np.linalg.norm(o.center_m - place) < 0.1), None)


def trust_in(objects: ObjectMap, label: int) -> float:
    return objects.content().registry.true_detection_share(label, False)


def test_repeated_detections_raise_the_trust_in_a_class_and_unrepeated_ones_lower_it():
    repeated = built(BY_CLASS, [{3: "mug"}] * 5)
    doubtful = built(BY_CLASS, [{3: "mug"}, {4: "mug"}, {}, {}, {4: "mug"}])
    sure, unsure = mug_near(repeated, MUG_CENTER), mug_near(doubtful, ELSEWHERE)
    assert sure is not None
    assert unsure is not None
    assert trust_in(repeated, sure.id) > 0.8
    assert trust_in(doubtful, unsure.id) < 0.5


def test_trust_changes_scores_and_neither_evidence_nor_instances():
    calls = [{3: "mug"}, {4: "mug"}, {}, {}, {4: "mug"}]
    full, by_class = built(SETTINGS, calls), built(BY_CLASS, calls)
    mine, theirs = full.gaussians(), by_class.gaussians()
    assert np.array_equal(mine.concentration, theirs.concentration)
    assert np.array_equal(mine.instance, theirs.instance)
    for a, b in zip(full.objects(), by_class.objects(), strict=True):
        assert np.array_equal(a.center_m, b.center_m)
        assert b.class_score < a.class_score
    mug = mug_near(by_class, ELSEWHERE)
    assert mug is not None
    c = CAMERA
    away = View(c.fx, c.fy, c.cx, c.cy, c.width, c.height, pose(yaw=np.pi))
    answer = by_class.what_if(mug.id, "mug", [away])
    assert answer is not None
    assert answer[1].psi == pytest.approx(mug.score, abs=1e-5)  # what-ifs start from the score


def test_a_retired_object_does_not_count_as_a_false_detection():
    objects = built(BY_CLASS, [{3: "mug"}] * 4)
    mug = mug_near(objects, MUG_CENTER)
    assert mug is not None
    before = trust_in(objects, mug.id)
    objects.retire(mug.id)
    o = observe(SCENE, looking_at(*FROM[4], MUG_CENTER), seq=9, called={2: "table", 4: "mug"})
    objects.update(o, CONTEXT)
    other = mug_near(objects, ELSEWHERE)
    assert other is not None
    assert trust_in(objects, other.id) > before  # one more, detected in all its views


def test_a_map_file_keeps_the_learnt_precision():
    objects = built(BY_CLASS, [{3: "mug"}, {}, {}, {4: "mug"}, {}])
    data = persistence.to_bytes(persistence.arrays_of(objects.content(), None))
    again = ObjectMap(BY_CLASS)
    again.load_content(persistence.read(data, again.empty_viewpoints()).content)
    registries = objects.content().registry, again.content().registry
    for by_distance in (False, True):
        known, kept = (
            [r.true_detection_share(label, by_distance) for label in r.records] for r in registries
        )
        assert kept == known


def test_detections_in_a_file_of_an_earlier_build_count_at_a_middle_distance():
    objects = built(BY_CLASS, [{3: "mug"}] * 3)
    arrays = persistence.arrays_of(objects.content(), None)
    header = json.loads(arrays["header"].tobytes())
    del header["ended"]
    header["records"] = {k: r[:4] for k, r in header["records"].items()}
    arrays["header"] = np.frombuffer(json.dumps(header).encode(), np.uint8)
    read = persistence.read(
        persistence.to_bytes(arrays), objects.empty_viewpoints()
    ).content.registry
    for label, record in objects.content().registry.records.items():
        assert read.records[label].detected_at.tolist() == [0, record.detected, 0]
        assert read.records[label].history == record.history


def test_a_prior_for_more_classes_gives_the_scores_of_a_search_for_all_of_them():
    """The other classes of a Dirichlet prior are part of "other", whether they are named or not."""
    named = SearchContext(
        "c1", (MUG, TABLE, *(SearchClass(n, Role.OBJECT, 0.3) for n in ("bowl", "book")))
    )
    few, many = ObjectMap(SETTINGS.model_copy(update={"prior_classes": 5})), ObjectMap(SETTINGS)
    for seq, (x, y) in enumerate(FROM[:3]):
        o = observe(SCENE, looking_at(x, y, MUG_CENTER), seq=seq)
        few.update(o, CONTEXT)
        many.update(o, named)
    for a, b in zip(few.objects(), many.objects(), strict=True):
        assert (a.id, a.class_name) == (b.id, b.class_name)
        assert (a.score, a.class_score) == pytest.approx((b.score, b.class_score))
    fewer = built(SETTINGS, [{3: "mug"}] * 3)
    mugs = [mug_near(m, MUG_CENTER) for m in (few, fewer)]
    assert mugs[0] is not None
    assert mugs[1] is not None
    assert mugs[0].score < mugs[1].score
