"""Pixels on the floor belong to no furniture."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helios_core.types import Detection, Role, SearchClass, SearchContext
from helios_objectmap.fusion.floor import below, without_labels_below
from helios_objectmap.fusion.label_image import read
from helios_objectmap.instances.furniture import is_flat
from helios_objectmap.object_map import ObjectMap
from helios_objectmap.searched_classes import SearchedClasses
from hypothesis import given
from hypothesis import strategies as st
from objectmap_scene import (
    CONTEXT,
    FLOOR,
    SETTINGS,
    TABLE_BOX,
    WALL,
    Box,
    looking_at,
    mug_at,
    observe,
    pose,
)

ABOVE = SETTINGS.model_copy(update={"furniture_above_m": 0.05, "receptacle_voxel_m": 0.2})
ANYWHERE = ABOVE.model_copy(update={"furniture_above_m": 0.0})
LOW: Box = ("table", (1.0, -0.6, 0.0), (1.8, 0.6, 0.5))
OTHER: Box = ("table", (1.0, 1.3, 0.0), (1.8, 2.5, 0.5))
EYES = ((-0.6, 0.8), (-0.4, 0.2), (-0.4, 1.4))


def built(settings, *, floor_is: str) -> ObjectMap:
    """Map of two tables that a detector sees rightly, and the floor beside them as `floor_is`."""
    objects = ObjectMap(settings)
    scene = (FLOOR, WALL, LOW, OTHER)
    for seq, eye in enumerate(EYES):
        named = {0: floor_is, 2: "table", 3: "table"}
        seen = observe(scene, looking_at(*eye, (1.4, 0.95, 0.3)), seq=seq, called=named)
        objects.update(seen, CONTEXT)
    return objects


def tables(objects: ObjectMap) -> list[tuple[float, float]]:
    """Centre and width of each table along y, m."""
    found = [o for o in objects.objects() if o.class_name == "table" and o.gaussians > 100]
    return sorted((float(o.center_m[1]), float(o.size_m[1])) for o in found)


def test_floor_that_is_taken_for_a_table_joins_no_tables() -> None:
    (first, first_wide), (second, second_wide) = tables(built(ABOVE, floor_is="table"))
    assert (first, second) == (pytest.approx(0.0, abs=0.2), pytest.approx(1.9, abs=0.2))
    assert max(first_wide, second_wide) < 1.4
    joined = tables(built(ANYWHERE, floor_is="table"))
    assert len(joined) == 1
    assert joined[0][1] > 3


def test_without_such_floor_the_tables_are_the_same_above_it() -> None:
    high, anywhere = tables(built(ABOVE, floor_is="floor")), tables(built(ANYWHERE, floor_is="x"))
    assert np.array(high) == pytest.approx(np.array(anywhere), abs=0.1)


def test_a_small_object_on_the_floor_stays() -> None:
    mug: Box = ("mug", (2.0, 0.0, 0.0), (2.1, 0.1, 0.04))
    objects = ObjectMap(ABOVE)
    for seq in range(3):
        objects.update(observe((FLOOR, mug), pose(0.3 * seq, 0.0), seq=seq), CONTEXT)
    assert [o.class_name for o in objects.objects()] == ["mug"]


def test_a_rug_is_flat_and_stays() -> None:
    rug: Box = ("rug", (1.0, -0.5, 0.0), (2.0, 0.5, 0.01))
    context = SearchContext("r", (SearchClass("rug", Role.GOAL_RECEPTACLE, 0.3),))
    objects = ObjectMap(ABOVE)
    for seq in range(3):
        seen = observe((FLOOR, rug), pose(0.3 * seq), seq=seq, context=context)
        objects.update(seen, context)
    assert [o.class_name for o in objects.objects()] == ["rug"]
    assert is_flat("rug", 0.05)
    assert not is_flat("table", 0.05)
    assert not is_flat("thing without an entry", 0.05)


def test_unknown_floor_height_leaves_every_pixel() -> None:
    assert ABOVE.furniture_from_m == 0.05
    assert ABOVE.model_copy(update={"floor_m": 1.0}).furniture_from_m == 1.05
    assert ABOVE.model_copy(update={"floor_m": None}).furniture_from_m is None
    assert ANYWHERE.furniture_from_m is None


@given(
    st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1), st.floats(0.0, 1.2), st.floats(0.0, 2.0)
)
def test_heights_are_those_of_the_lifted_points(
    x: float, y: float, yaw: float, tilt: float, height_m: float
) -> None:
    seen = observe((FLOOR, WALL, TABLE_BOX, mug_at(1.2, 0.0)), pose(x, y, yaw, tilt))
    reading = read(seen, CONTEXT, 1, 0.1, 8.0)
    measured = reading.depth_m > 0
    z = reading.view.lift(reading.depth_m, measured)[:, 2]
    low = below(reading, height_m)
    assert not low[~measured].any()
    sure = np.abs(z - height_m) > 1e-4
    assert (low[measured] == (z < height_m))[sure].all()


def test_detections_keep_their_masks() -> None:
    seen = observe((FLOOR, LOW), pose())
    whole = np.ones_like(seen.detections[0].mask)
    wide = replace(seen, detections=(Detection("table", 0.9, (0, 0, 160, 120), whole),))
    reading = read(wide, CONTEXT, 1, 0.1, 8.0)
    classes = SearchedClasses(ABOVE)
    classes.search(CONTEXT)
    assert classes.labels_off_floor() == [2]  # the table, not the mug
    labels = without_labels_below(reading, [2], 0.05).labels
    low = below(reading, 0.05)
    assert (labels[low] == 0).all()
    assert (labels[~low] == reading.labels[~low]).all()
