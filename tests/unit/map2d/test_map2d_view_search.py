"""View search after a scripted walk: objects at known positions are found there."""

from __future__ import annotations

import functools
import math
from dataclasses import replace

import numpy as np
import pytest
from helios_core import proto as pb
from helios_core.topics import RECALL
from helios_core.types import Detection, Embedding, Frame, FrameId, Observation
from helios_map2d.layers.value_layers import Cone
from helios_map2d.view_memory.detected_names import sighted
from helios_map2d.view_memory.localization import CELL_M, MOST_CELLS, Localization
from helios_map2d.view_memory.ranking import Answer, best_places
from helios_map2d.view_memory.stored_views import SeenView
from map2d_rig import MODEL, Rig, Scorer
from map2d_scene import Block, Walk, cast, room
from numpy.typing import NDArray

THINGS_M = {"mug": (0.3, 5.6), "vase": (7.6, 5.5), "book": (7.7, 0.4), "ball": (3.0, 3.2)}
STOPS_M = ((1.5, 1.5), (2.0, 4.3), (6.5, 1.5), (6.0, 4.3))
SIDE_M = 0.25


def block(x: float, y: float) -> Block:
    half = SIDE_M / 2
    return Block((x - half, y - half, 0.4), (x + half, y + half, 0.4 + SIDE_M))


class IdealScorer(Scorer):
    """A scorer that recognises the objects in an image, larger ones better, with a little noise
    in everything."""

    def __init__(self) -> None:
        self.rng = np.random.default_rng(0)

    def text(self, prompt: str) -> Embedding:
        vector = np.array([[0.0, *(float(name == prompt) for name in THINGS_M)]], np.float32)
        return Embedding(MODEL, vector)

    def image(self, frame: Frame) -> Embedding:
        shares = [mask.mean() for mask in masks(frame).values()]
        vector = np.array([[0.15, *np.sqrt(shares)]]) + np.abs(self.rng.normal(0, 0.02, (1, 5)))
        return Embedding(MODEL, (vector / np.linalg.norm(vector)).astype(np.float32))


def masks(frame: Frame) -> dict[str, NDArray[np.bool_]]:
    """The pixels of each object."""
    floor = cast([], frame.T_world_cam)
    alone = {name: cast([block(*at)], frame.T_world_cam) for name, at in THINGS_M.items()}
    return {
        name: (depth != floor) & (np.abs(depth - frame.depth_m) < 1e-4)
        for name, depth in alone.items()
    }


@functools.cache
def rig_after_walk(*, embeds: bool) -> Rig:
    """A rig after a walk through two rooms, with image embeddings or with detections."""
    rig = Rig()
    rig.scorer = IdealScorer()
    if embeds:
        rig.scorer.serve(rig.bus)
    walls = [Block((3.9, 0, 0), (4.1, 2.0, 2.5)), Block((3.9, 4.0, 0), (4.1, 6.0, 2.5))]
    rig.walk = Walk([*room(8.0, 6.0), *walls, *(block(*at) for at in THINGS_M.values())])
    rig.search("idle", {} if embeds else {"pick": "a mug", "place": "a table"})
    for x, y in STOPS_M:
        for frame in rig.walk.look_around(x, y)[::2]:
            rig.keyframe(frame)
            named = () if embeds else detections(frame)
            rig.observe(frame, "idle", {} if embeds else None, detections=named)
    return rig


def detections(frame: Frame) -> tuple[Detection, ...]:
    out = []
    for name, mask in masks(frame).items():
        if mask.sum() >= 20:
            rows, columns = np.nonzero(mask)
            lo_v, lo_u, hi_v, hi_u = (
                int(v) for v in (rows.min(), columns.min(), rows.max() + 1, columns.max() + 1)
            )
            score = 0.5 + min(0.4, mask.mean())
            out.append(Detection(name, score, (lo_u, lo_v, hi_u, hi_v), mask))
    return tuple(out)


def error_m(place: pb.SeenPlace, name: str) -> float:
    return math.dist((place.x_m, place.y_m), THINGS_M[name])


@pytest.mark.parametrize("embeds", [True, False])
@pytest.mark.parametrize("name", THINGS_M)
def test_an_object_is_found_at_its_position_with_an_image_that_shows_it(
    name: str, embeds: bool
) -> None:
    rig = rig_after_walk(embeds=embeds)
    best, *others = rig.bus.call(RECALL, pb.RecallRequest(prompt=name, most_places=3), 5).places
    # The ball is seen from three stops. The others are seen from one, so their distance is less
    # accurate.
    within_m = (0.6 if name == "ball" else 1.0) if embeds else 0.25
    assert error_m(best, name) < within_m
    x, y = THINGS_M[name]
    bearing = math.atan2(y - best.camera.y_m, x - best.camera.x_m) - best.camera.yaw_rad
    assert abs(math.remainder(bearing, math.tau)) < 0.6, "it is in the picture"
    for other in others:
        assert error_m(other, name) < within_m or other.score < 0.75 * best.score


def cone(x: float, y: float, yaw: float, reach_m: float = 4.0) -> Cone:
    reach = np.zeros(400, np.float32)
    reach[180:220] = reach_m
    return Cone(x, y, (math.cos(yaw), math.sin(yaw)), 0.4, reach)


def test_only_the_best_answer_per_class_place_and_viewing_direction_is_reported() -> None:
    def answer(score: float, x: float, yaw: float, class_name: str = "mug") -> Answer:
        view = SeenView(FrameId("boot", 0, 1), 0, cone(0, 0, yaw), None, b"")
        return Answer(view, score, (x, 1.0), class_name)

    best, alike = answer(0.9, 1.0, 0.0), answer(0.8, 1.2, 0.3)
    turned, other, apart = answer(0.7, 1.2, 3.0), answer(0.6, 1.2, 0.0, "cup"), answer(0.5, 2.1, 0)
    given = [alike, apart, other, turned, best]
    assert best_places(given, 9) == [best, turned, other, apart]
    assert best_places(given, 2) == [best, turned]


def test_the_best_detection_of_a_class_with_valid_depth_is_kept() -> None:
    frame = Walk(room()).frame(2.0, 1.5, 0.0)
    depth_m = np.full_like(frame.depth_m, 2.0)
    depth_m[:, 80:] = 8.0  # beyond the maximum depth

    def found(score: float, u: int) -> Detection:
        mask = np.zeros(depth_m.shape, bool)
        mask[50:60, u : u + 10] = True
        return Detection("mug" if u < 80 else "vase", score, (u, 50, u + 10, 60), mask)

    seen = Observation(
        replace(frame, depth_m=depth_m),
        "",
        (found(0.4, 10), found(0.9, 40), found(0.8, 90)),
        {},
        "",
    )
    (mug,) = sighted(seen, 0.1, 5.0)
    assert (mug.class_name, mug.score) == ("mug", 0.9)


def test_the_crossing_of_two_matching_views_is_likelier_than_the_rest_of_one_view() -> None:
    east, north, other = cone(0, 0, 0), cone(2.5, -2.5, math.pi / 2), cone(0, 0, math.pi)
    found = Localization([(east, 0.8), (north, 0.8), (other, 0.1)])
    assert found.within(east) == pytest.approx((2.5, 0.0), abs=0.4)
    assert found.within(north) == pytest.approx((2.5, 0.0), abs=0.4)


def test_floor_in_a_view_without_the_object_is_less_likely() -> None:
    far, near = cone(0, 0, 0), cone(0, 0, 0, reach_m=2.0)
    x, _ = Localization([(far, 0.8), (near, 0.1), (cone(9, 9, 0), 0.1)]).within(far)
    assert x > 2.0


def test_a_view_without_depth_is_localized_at_its_camera() -> None:
    blind = cone(1.0, 2.0, 0.3, reach_m=0.0)
    assert Localization([(blind, 0.9)]).within(blind) == (1.0, 2.0)
    assert Localization([]).within(blind) == (1.0, 2.0)


def test_a_very_large_area_is_searched_in_larger_cells() -> None:
    apart = [(cone(0, 0, 0), 0.9), (cone(600, 600, 0), 0.2)]
    found = Localization(apart)
    assert 600**2 / CELL_M**2 > MOST_CELLS >= found.fit.size
    x, y = found.within(apart[0][0])
    assert 0 < x < 4.2
    assert abs(y) < 1.5
