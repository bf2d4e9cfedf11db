"""`box_to_mask`: the mask holds the object, not its support surface or its background."""

import numpy as np
import pytest
from detector_scene import BOWL, CAMERA, MUG, ROOM, TABLE, box_of, looking, render
from helios_core.geometry import Pinhole, lift_pixels
from helios_detector.box_to_mask import Box, box_to_mask, clip_box
from hypothesis import given, settings
from hypothesis import strategies as st

SHAPE = (CAMERA.height, CAMERA.width)


def grown(box: Box, by_px: int) -> Box:
    out = clip_box((box[0] - by_px, box[1] - by_px, box[2] + by_px, box[3] + by_px), *SHAPE)
    assert out is not None
    return out


@pytest.mark.parametrize("thing", [MUG, BOWL], ids=lambda b: b.class_name)
@pytest.mark.parametrize("x_m", [0.2, 0.5, 0.9])
def test_the_mask_of_an_object_on_a_table_covers_the_object_and_not_the_table(thing, x_m):
    T = looking(x_m)
    depth_m, ids = render(ROOM, T)
    truth = ids == thing.id
    mask = box_to_mask(depth_m, grown(box_of(truth), 2), CAMERA, T)
    assert (mask & truth).sum() / mask.sum() > 0.95
    assert (mask & truth).sum() / truth.sum() > 0.7


def test_the_mask_stays_on_the_object_with_noise_and_holes_in_the_depth_image():
    T = looking()
    clean, ids = render(ROOM, T)
    rng = np.random.default_rng(0)
    depth_m = (clean + rng.normal(0, 0.006, clean.shape)).astype(np.float32)
    depth_m[rng.random(clean.shape) < 0.2] = 0
    truth = ids == MUG.id
    mask = box_to_mask(depth_m, grown(box_of(truth), 2), CAMERA, T)
    assert (mask & truth).sum() / mask.sum() > 0.9
    assert abs(np.median(depth_m[mask]) - np.median(clean[truth])) < 0.02


def test_the_mask_of_an_object_excludes_a_far_background():
    T = looking()
    depth_m, ids = render(ROOM[1:], T)  # no table: mug and bowl float before floor and wall
    truth = ids == MUG.id
    mask = box_to_mask(depth_m, grown(box_of(truth), 5), CAMERA, T)
    assert (mask & truth).sum() / mask.sum() > 0.95


def test_mask_of_a_table_has_its_surface_and_no_floor():
    T = looking()
    depth_m, ids = render(ROOM, T)
    surface = ids == TABLE.id
    mask = box_to_mask(depth_m, box_of(surface), CAMERA, T, keep_surface=True)
    assert (mask & surface).sum() / surface.sum() > 0.95
    assert not (mask & (ids == 0)).any()


def test_a_flat_object_is_not_removed_with_the_table_below():
    book = TABLE.__class__(9, "book", (1.7, 0.0, 0.75), (1.9, 0.15, 0.752), True)
    T = looking()
    depth_m, ids = render((TABLE, book), T)
    truth = ids == book.id
    mask = box_to_mask(depth_m, box_of(truth), CAMERA, T)
    assert (mask & truth).sum() / truth.sum() > 0.7


def test_box_without_valid_depth_gives_an_empty_mask():
    mask = box_to_mask(np.zeros(SHAPE, np.float32), (10, 10, 40, 40), CAMERA, looking())
    assert not mask.any()


@settings(max_examples=60, deadline=None)
@given(
    box=st.tuples(*(st.floats(-500, 900) for _ in range(4))),
    keep_surface=st.booleans(),
    seed=st.integers(0, 100),
)
def test_a_mask_stays_within_its_box_and_within_valid_depth(box, keep_surface, seed):
    clipped = clip_box(box, *SHAPE)
    if clipped is None:
        return
    rng = np.random.default_rng(seed)
    depth_m = rng.uniform(0, 10, SHAPE).astype(np.float32)
    depth_m[rng.random(SHAPE) < rng.random()] = 0
    mask = box_to_mask(depth_m, clipped, CAMERA, looking(), keep_surface=keep_surface)
    x0, y0, x1, y1 = clipped
    outside = mask.copy()
    outside[y0:y1, x0:x1] = False
    assert mask.shape == SHAPE
    assert not outside.any()
    assert not (mask & (depth_m == 0)).any()


def test_heights_agree_with_lifted_pixels():
    from helios_detector.box_to_mask import _heights

    T = looking(0.3, 0.4, 0.5)
    depth_m, _ = render(ROOM, T)
    part = depth_m[30:90, 50:120]
    shifted = Pinhole(CAMERA.fx, CAMERA.fy, CAMERA.cx - 50, CAMERA.cy - 30, 70, 60)
    wanted = lift_pixels(part, shifted, T)[..., 2]
    valid = part > 0
    np.testing.assert_allclose(_heights(part, (50, 30), CAMERA, T)[valid], wanted[valid], atol=1e-4)
