"""A search for one, two or three classes: scores do not depend on their number, and furniture that
is sought as the object is one instance."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import objectmap_scene
import pytest
from helios_core.geometry import Pinhole
from helios_core.types import ObjectInstance, Role, SearchClass, SearchContext
from helios_objectmap import persistence
from helios_objectmap.camera import View
from helios_objectmap.fusion import semantics
from helios_objectmap.instances.furniture import is_furniture
from helios_objectmap.object_map import ObjectMap
from helios_objectmap.settings import ObjectMapSettings
from helios_sim.home.catalog import DEMO
from helios_sim.home.catalog_ovmm import OVMM
from objectmap_scene import FLOOR, TABLE_BOX, looking_at, observe

CAMERA = Pinhole(fx=300.0, fy=300.0, cx=159.5, cy=119.5, width=320, height=240)
SETTINGS = ObjectMapSettings()
TOP = (1.4, 0.0, 0.72)
TAU_G = 0.5  # of the paper
CLASSES = (
    SearchClass("table", Role.OBJECT, 0.3),
    SearchClass("mug", Role.START_RECEPTACLE, 0.3),
    SearchClass("counter", Role.GOAL_RECEPTACLE, 0.3),
)


@pytest.fixture(autouse=True)
def camera(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(objectmap_scene, "CAMERA", CAMERA)


def sought(n_classes: int) -> SearchContext:
    return SearchContext("c1", CLASSES[:n_classes])


def map_of_table(
    *distances_m: float,
    context: SearchContext | None = None,
    settings: ObjectMapSettings = SETTINGS,
    name: str = "table",
    noise: float = 0.0,
) -> ObjectMap:
    """Map after one view of a table from each distance. name: what the detector calls it; noise:
    of the depth, a standard deviation of noise × distance² metres."""
    objects = ObjectMap(settings)
    for seq, away_m in enumerate(distances_m):
        update(objects, away_m, context or sought(1), name, noise, seq)
    return objects


def update(
    objects: ObjectMap, away_m: float, context: SearchContext, name: str, noise: float, seq: int
) -> None:
    boxes = (FLOOR, TABLE_BOX)
    T = looking_at(TOP[0] - away_m, 0.0, TOP)
    noise_m = noise * away_m**2
    o = observe(boxes, T, context=context, seq=seq, called={1: name}, noise_m=noise_m)
    objects.update(o, context)


# --- furniture -----------------------------------------------------------------------------------
@pytest.mark.parametrize("noise", [0.0, 0.003])
@pytest.mark.parametrize("away_m", [1.5, 3.0, 5.0, 7.0])
def test_a_table_that_is_sought_as_the_object_is_one_instance(away_m: float, noise: float) -> None:
    (one,) = map_of_table(away_m, noise=noise).objects()
    receptacle = SearchContext("c1", (SearchClass("table", Role.GOAL_RECEPTACLE, 0.3),))
    (other,) = map_of_table(away_m, noise=noise, context=receptacle).objects()
    assert one.gaussians == other.gaussians
    assert one.score == other.score


def test_a_table_that_is_seen_from_far_and_then_from_near_stays_one_instance() -> None:
    (table,) = map_of_table(7.0, 5.0, 3.0, 1.5).objects()
    assert table.size_m[1] == pytest.approx(1.2, abs=0.1)


def test_something_as_large_with_the_voxels_of_small_objects_is_several_instances() -> None:
    """Without the rule for furniture the tests above would fail."""
    context = SearchContext("c1", (SearchClass("mug", Role.OBJECT, 0.3),))
    counts = [
        len(map_of_table(away_m, context=context, name="mug").objects())
        for away_m in (1.5, 3.0, 5.0, 7.0)
    ]
    assert counts[0] == 1
    assert min(counts[1:]) > 1


def test_all_furniture_of_the_simulator_is_furniture_and_no_small_object_is() -> None:
    homes = (DEMO, OVMM)
    furniture = {name for home in homes for name in (*home.receptacles, *home.ovmm_class.values())}
    assert {name for name in furniture if not is_furniture(name)} == set()
    small = {name for home in homes for name in home.objects}
    assert len(small) > 40
    assert {name for name in small if is_furniture(name)} == set()


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("white kitchen table", True),
        ("Dining_Table", True),
        ("table", True),
        ("tv stand", True),
        ("window", True),
        ("shower curtain", True),
        ("table lamp", False),
        ("toilet paper", False),
        ("mug", False),
        ("", False),
    ],
)
def test_the_last_words_of_a_name_decide_whether_it_is_furniture(name: str, expected: bool) -> None:
    assert is_furniture(name) is expected


def test_a_map_file_with_a_table_in_pieces_is_one_table_after_loading() -> None:
    small = SETTINGS.model_copy(update={"receptacle_voxel_m": SETTINGS.object_voxel_m})
    pieces = map_of_table(3.0, settings=small)
    assert len(pieces.objects()) > 1
    again = reloaded(pieces)
    (table,) = again.objects()
    assert table.gaussians == sum(o.gaussians for o in pieces.objects())
    update(again, 2.5, sought(1), "table", 0.0, 1)
    assert [o.id for o in again.objects()] == [table.id]


def test_a_map_file_with_the_same_voxels_keeps_its_instances() -> None:
    whole = map_of_table(3.0, 2.5)
    again = reloaded(whole)
    (before,), (after,) = whole.objects(), again.objects()
    assert (before.id, before.score, before.views) == (after.id, after.score, after.views)
    assert again.history(after.id) == whole.history(before.id)


def reloaded(objects: ObjectMap) -> ObjectMap:
    data = persistence.to_bytes(persistence.arrays_of(objects.content(), None))
    again = ObjectMap(SETTINGS)
    again.load_content(persistence.read(data, again.empty_viewpoints()).content)
    again.set_context(sought(1))
    return again


# --- number of classes ---------------------------------------------------------------------------
def table_in(
    n_classes: int, away_m: float, settings: ObjectMapSettings = SETTINGS
) -> ObjectInstance:
    """The largest instance after one view."""
    found = map_of_table(away_m, context=sought(n_classes), settings=settings).objects()
    return max(found, key=lambda o: o.gaussians)


@pytest.mark.parametrize("away_m", [1.5, 3.0])
def test_the_score_after_one_view_does_not_depend_on_the_number_of_classes(away_m: float) -> None:
    scores = [table_in(n, away_m).score for n in (1, 2, 3)]
    assert scores[1:] == scores[:-1]
    assert 0.3 < scores[0] < 0.4 < TAU_G
    two = SETTINGS.model_copy(update={"prior_classes": 2})
    before = [table_in(n, away_m, two).score for n in (1, 2, 3)]
    assert before[0] > TAU_G > before[1] > before[2] == scores[2]


def expectations(settings: ObjectMapSettings, n_classes: int) -> list[tuple[float, float]]:
    """Expected score and gain of a view and of all views, of a table that was seen once."""
    objects = map_of_table(3.0, context=sought(n_classes), settings=settings)
    (table,) = objects.objects()
    c = CAMERA
    views = [
        View(c.fx, c.fy, c.cx, c.cy, c.width, c.height, looking_at(x, y, TOP))
        for x, y in ((0.0, 1.0), (0.0, -1.0))
    ]
    asked = objects.what_if(table.id, "table", views)
    assert asked is not None
    return [(e.psi, e.information_gain) for e in (*asked[0], asked[1])]


def test_expected_scores_and_gains_do_not_depend_on_the_number_of_classes() -> None:
    one, two, three = (np.array(expectations(SETTINGS, n)) for n in (1, 2, 3))
    assert one == pytest.approx(three, rel=1e-9)
    assert two == pytest.approx(three, rel=1e-9)
    old = np.array(expectations(SETTINGS.model_copy(update={"prior_classes": 2}), 1))
    assert (np.abs(old / three - 1) > 0.02).all()


def test_a_search_for_three_classes_gives_the_same_bits_with_a_prior_of_two_and_of_four() -> None:
    two, four = (SETTINGS.model_copy(update={"prior_classes": n}) for n in (2, 4))
    assert SETTINGS.prior_classes == 4
    assert expectations(two, 3) == expectations(four, 3)
    maps = [map_of_table(3.0, 1.5, context=sought(3), settings=s) for s in (two, four)]
    for a, b in zip(maps[0].objects(), maps[1].objects(), strict=True):
        assert (a.id, a.score, a.class_score, a.uncertainty) == (
            b.id,
            b.score,
            b.class_score,
            b.uncertainty,
        )
        assert a.probabilities == b.probabilities
    parts = [m.gaussians().concentration for m in maps]
    assert np.array_equal(parts[0], parts[1])


def moments(f: Callable, concentration: np.ndarray) -> np.ndarray:
    return f(concentration)[:, 1]


def test_merging_classes_keeps_mean_and_variance_of_a_listed_class_and_changes_the_entropy() -> (
    None
):
    positive, asked = np.array([[0.0], [3.0], [9.0]]), np.array([0.0, 3.0, 12.0])
    all_four = semantics.concentration_of(positive, asked, 1.0, 4)
    assert all_four.tolist() == [[1, 1, 1, 1], [1, 4, 1, 1], [4, 10, 1, 1]]
    merged = semantics.merged_into_other(all_four, 1)
    assert merged.tolist() == [[3, 1], [3, 4], [6, 10]]
    for f in (semantics.expectation, semantics.variance):
        assert moments(f, merged) == pytest.approx(moments(f, all_four), rel=1e-12)
    mean, deviation = semantics.marginal(positive[:, 0], asked, 1.0, 4)
    assert mean == pytest.approx(moments(semantics.expectation, all_four), rel=1e-12)
    assert deviation**2 == pytest.approx(moments(semantics.variance, all_four), rel=1e-12)
    assert (np.abs(semantics.entropy(merged) - semantics.entropy(all_four)) > 0.1).all()
