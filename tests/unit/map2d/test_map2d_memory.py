"""View memory: past views can be searched later."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from helios_core import proto as pb
from helios_core.codec import embedding_to_proto
from helios_core.errors import InvalidInput, Unavailable
from helios_core.geometry import lift_pixels
from helios_core.map_snapshot import decode_snapshot
from helios_core.topics import EMBED_TEXT, RECALL
from helios_core.types import Detection, Embedding, FrameId, Observation
from helios_map2d.epoch_map import EpochMap
from helios_map2d.layers.parameters import MapRules
from helios_map2d.layers.value_layers import Cone
from helios_map2d.view_memory.detected_names import DetectedClass
from helios_map2d.view_memory.ranking import Question, questions, scored
from helios_map2d.view_memory.stored_views import SeenView, ViewMemory, read_view
from helios_map2d.view_search import MOST_LATE_LAYERS
from map2d_rig import Rig
from map2d_scene import CAMERA, Walk, room
from numpy.typing import NDArray

PROMPTS = {"pick": "a blue mug", "place": "a wooden counter"}


def look_around_at(rig: Rig, context_id: str, prompts: dict[str, str], places: list[float]) -> None:
    """Look around at some places, with observations of a scorer that embeds images."""
    for x in places:
        for frame in rig.walk.look_around(x, 1.4):
            rig.keyframe(frame)
            scores = {name: rig.scorer.score(frame, p) for name, p in prompts.items()}
            rig.observe(frame, context_id, scores)


def rig_with_prompts_from_the_start() -> Rig:
    rig = Rig()
    rig.scorer.serve(rig.bus)
    rig.search("search", PROMPTS)
    look_around_at(rig, "search", PROMPTS, [1.2, 2.0, 2.8])
    return rig


def layers(rig: Rig) -> dict[str, NDArray[np.float32]]:
    return dict(decode_snapshot(rig.snapshot()).values)


def test_a_value_layer_requested_afterwards_equals_one_from_the_start() -> None:
    start, later = rig_with_prompts_from_the_start(), Rig()
    later.scorer.serve(later.bus)
    later.search("idle", {"other": "a plant"})
    look_around_at(later, "idle", {"other": "a plant"}, [1.2, 2.0, 2.8])
    later.search("search", PROMPTS)  # the same walk; the prompts come at its end
    one, two = layers(start), layers(later)
    assert set(one) == set(two) == set(PROMPTS)
    for name, layer in one.items():
        assert (layer > 0).sum() > 5000
        # Image and text travel as float16.
        np.testing.assert_allclose(two[name], layer, atol=2e-3)


def test_later_views_update_a_layer_that_was_made_from_past_views() -> None:
    start, later = rig_with_prompts_from_the_start(), Rig()
    later.scorer.serve(later.bus)
    later.search("idle", {})
    look_around_at(later, "idle", {}, [1.2, 2.0])
    later.search("search", PROMPTS)
    look_around_at(later, "search", PROMPTS, [2.8])
    for name, layer in layers(start).items():
        np.testing.assert_allclose(layers(later)[name], layer, atol=2e-3)


def test_view_search_returns_places_with_images_best_first() -> None:
    rig = rig_with_prompts_from_the_start()
    reply = rig.bus.call(RECALL, pb.RecallRequest(prompt="a teapot", most_places=4), 5)
    assert reply.views == 36
    assert 1 < len(reply.places) <= 4
    scores = [p.score for p in reply.places]
    assert scores == sorted(scores, reverse=True)
    best = reply.places[0]
    assert best.id.robot_boot_id == "boot"
    picture = cv2.imdecode(np.frombuffer(best.jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    assert picture.shape == (120, 160, 3)
    ahead = math.atan2(best.y_m - best.camera.y_m, best.x_m - best.camera.x_m)
    assert abs(math.remainder(ahead - best.camera.yaw_rad, math.tau)) < 0.6
    assert set(layers(rig)) == set(PROMPTS)  # no layer was requested


def test_a_recalled_layer_is_kept_under_its_name() -> None:
    rig = rig_with_prompts_from_the_start()
    before = rig.snapshot().version
    reply = rig.bus.call(RECALL, pb.RecallRequest(prompt="a teapot", layer="tea"), 5)
    assert reply.version > before
    assert layers(rig)["tea"].max() > 0
    frontier_values = [dict(f.values) for f in rig.snapshot().frontiers]
    assert all("tea" in values for values in frontier_values)


@pytest.mark.parametrize("layer", ["occupancy", "pick", "a/b", "a b", "x" * 41, ".." * 30])
def test_a_recalled_layer_with_a_used_or_invalid_name_is_refused(layer: str) -> None:
    rig = rig_with_prompts_from_the_start()
    before = rig.snapshot().version
    with pytest.raises(InvalidInput, match="layer"):
        rig.bus.call(RECALL, pb.RecallRequest(prompt="a teapot", layer=layer), 5)
    assert rig.snapshot().version == before


def test_the_number_of_recalled_layers_per_search_is_limited_but_one_may_be_renewed() -> None:
    rig = rig_with_prompts_from_the_start()

    def ask(layer: str) -> int:
        request = pb.RecallRequest(prompt="a teapot", layer=layer)
        return rig.bus.call(RECALL, request, 5).version

    for k in range(MOST_LATE_LAYERS):
        ask(f"late-{k}")
    with pytest.raises(InvalidInput, match=r"8 layers .*late-0, late-1.*begin another search"):
        ask("one-more")
    version = rig.snapshot().version
    assert ask("late-3") > version
    rig.search("another", PROMPTS)
    ask("one-more")


def test_view_search_without_views_or_a_text_model_says_what_is_missing() -> None:
    rig = Rig()
    with pytest.raises(Unavailable, match="no keyframe"):
        rig.bus.call(RECALL, pb.RecallRequest(prompt="a mug"), 5)
    rig.settle()  # with a scorer that does not embed images
    with pytest.raises(Unavailable, match="does not embed"):
        rig.bus.call(RECALL, pb.RecallRequest(prompt="a mug"), 5)
    with pytest.raises(InvalidInput, match="empty prompt"):
        rig.bus.call(RECALL, pb.RecallRequest(prompt=" "), 5)
    look_around_at(rig, "first", {}, [2.0])  # with a scorer that does, and then disconnects
    reply = rig.bus.call(RECALL, pb.RecallRequest(prompt="a mug"), 5)
    assert (len(reply.places), reply.views) == (0, 0)
    assert "names alone" in reply.note
    with pytest.raises(Unavailable, match="no value layer can be made of 'a mug'"):
        rig.bus.call(RECALL, pb.RecallRequest(prompt="a mug", layer="mug-2"), 5)
    other = pb.EmbedTextReply(embeddings=[embedding_to_proto(replace(SEEN, model="another"))])
    rig.bus.serve(EMBED_TEXT, lambda _: other)
    with pytest.raises(Unavailable, match=r"seen by the model test-clip, .* is another now"):
        rig.bus.call(RECALL, pb.RecallRequest(prompt="a mug", layer="mug-2"), 5)
    rig.search("second", PROMPTS)  # a search still starts
    assert rig.snapshot().context_id == "second"


def box_detection(class_name: str, score: float, box: tuple[int, int, int, int]) -> Detection:
    mask = np.zeros((CAMERA.height, CAMERA.width), bool)
    mask[box[1] : box[3], box[0] : box[2]] = True
    return Detection(class_name, score, box, mask)


def test_without_image_embeddings_the_view_memory_stores_views_with_detected_classes() -> None:
    rig = Rig()
    rig.search("search")
    near, far = (rig.walk.frame(x, 2.4, 0.0) for x in (1.0, 0.5))  # the table's edge: x 2.1 m
    on_it = (75, 40, 85, 50)  # pixels
    for frame, score in ((far, 0.5), (near, 0.75)):
        rig.keyframe(frame)
        found = box_detection("coffee table", score, on_it), box_detection("mug", 0.9, (0, 0, 2, 2))
        rig.observe(frame, "search", detections=found)
    nothing = rig.walk.frame(1.0, 2.4, math.pi)
    rig.keyframe(nothing)
    rig.observe(nothing, "search")
    reply = rig.bus.call(RECALL, pb.RecallRequest(prompt="my coffee-table"), 5)
    assert "names alone: the detector's scorer does not embed images" in reply.note
    assert reply.views == 2, "nothing is kept of a view in which nothing is named"
    (best,) = reply.places[:1]
    assert (best.class_name, best.score, best.id.seq) == ("coffee table", 0.75, near.id.seq)
    seen = lift_pixels(near.depth_m, near.camera, near.T_world_cam)[40:50, 75:85, :2]
    np.testing.assert_allclose([best.x_m, best.y_m], np.median(seen.reshape(-1, 2), 0), atol=0.02)
    assert best.jpeg.startswith(b"\xff\xd8")
    assert not rig.bus.call(RECALL, pb.RecallRequest(prompt="a piano"), 5).places


SEEN = Embedding("model", np.array([[1.0, 0.0]], np.float32))


def view(seq: int, x: float, y: float, yaw: float, *named: DetectedClass) -> SeenView:
    reach = np.zeros(400, np.float32)
    reach[180:220] = 3.0
    cone = Cone(x, y, (math.cos(yaw), math.sin(yaw)), 0.4, reach)
    return SeenView(FrameId("boot", 0, seq), seq, cone, SEEN, b"jpeg", named)


def test_a_full_view_memory_drops_the_view_that_others_cover_best() -> None:
    memory = ViewMemory(4)
    memory.add(view(1, 0.0, 0.0, 0.0))
    memory.add(view(2, 10.0, 0.0, 0.0))
    memory.add(view(3, 10.1, 0.0, 0.02))
    memory.add(view(4, 0.0, 0.0, math.pi))  # the same place in the opposite direction
    memory.add(view(5, 20.0, 5.0, 1.0))
    assert {v.id.seq for v in memory.snapshot()} in ({1, 3, 4, 5}, {1, 2, 4, 5})


def test_the_oldest_of_identical_views_is_dropped() -> None:
    memory = ViewMemory(2)
    for seq in (1, 2, 3):
        memory.add(view(seq, 0.0, 0.0, 0.0))
    assert [v.id.seq for v in memory.snapshot()] == [2, 3]


def test_a_second_view_of_the_same_frame_replaces_the_first() -> None:
    memory = ViewMemory(5)
    memory.add(view(1, 0.0, 0.0, 0.0))
    memory.add(view(1, 9.0, 0.0, 0.0))
    assert [v.cone.x_m for v in memory.snapshot()] == [9.0]
    assert set(memory._seen_by) == set(view(1, 9.0, 0.0, 0.0).patches)


def test_views_of_the_same_floor_from_opposite_sides_are_distinct() -> None:
    there, back = view(1, 0.0, 0.0, 0.0), view(2, 3.0, 0.0, math.pi)
    assert len({p[:2] for p in there.patches} & {p[:2] for p in back.patches}) > 3
    assert not there.patches & back.patches


def test_views_of_another_model_are_left_out_of_an_answer() -> None:
    ours, other = view(1, 0.0, 0.0, 0.0), view(2, 0.0, 0.0, 0.0)
    other = replace(other, embedding=replace(SEEN, model="another"))
    asked = Question("a mug", SEEN, 1.0, 0.0)
    assert scored([other, ours, replace(ours, embedding=None)], asked) == [(ours, 1.0)]


def test_a_scorer_with_non_finite_numbers_is_refused() -> None:
    text = embedding_to_proto(SEEN)
    reply = pb.EmbedTextReply(embeddings=[text], scale=math.nan, offset=0.5)
    with pytest.raises(Unavailable, match="scale nan"):
        questions(["a mug"], reply)


def test_a_rebuilt_layer_grows_the_grid_and_keeps_nothing_of_the_old_layer() -> None:
    walk, state = Walk(room()[:3]), EpochMap(MapRules(size_cells=64), (1.0, 1.5), 0.2)
    for frame in walk.look_around(1.0, 1.5):
        state.integrate_frame(frame)
        state.integrate_values(Observation(frame, "", (), {"pick": 0.9}, "test"))
    assert any(f.values["pick"] > 0 for f in state.published.frontiers)
    state.set_layer("pick", [])
    assert [f.values["pick"] for f in state.published.frontiers] == [0.0] * len(
        state.published.frontiers
    )
    state.set_layer("pick", [(view(1, 40.0, 0.0, 0.0).cone, 0.5)])
    there = state.published.grid.cell_of(41.0, 0.0)
    assert state.published.values["pick"][there] == pytest.approx(0.5)
    before = state.published
    with pytest.raises(InvalidInput, match="a larger HELIOS_MAP2D_MOST_CELLS"):
        state.set_layer("pick", [(view(2, 1e5, 0.0, 0.0).cone, 0.5)])
    assert state.published is before
    assert state.stack.values.layers["pick"].value.any()


def test_view_memory_stays_within_its_limit_and_keeps_the_distant_view() -> None:
    memory = ViewMemory(20)
    memory.add(view(0, 50.0, 50.0, 0.0))
    rng = np.random.default_rng(1)
    for seq in range(1, 200):
        memory.add(view(seq, rng.uniform(0, 1), rng.uniform(0, 1), rng.uniform(-3, 3)))
    assert len(memory) == 20
    assert any(v.id.seq == 0 for v in memory.snapshot())
    assert sum(memory._seen_by.values()) == sum(len(v.patches) for v in memory.snapshot())


def test_a_stored_view_round_trips_and_a_damaged_one_is_refused() -> None:
    one = view(7, 1.0, 2.0, 0.5, DetectedClass("mug", 0.5, 3.0, 4.0))
    message = pb.KeptMap.FromString(one.kept).views[0]
    again = read_view(message)
    np.testing.assert_array_equal(again.cone.reach_m, one.cone.reach_m)
    assert (again.id, again.cone.heading, again.jpeg) == (one.id, one.cone.heading, one.jpeg)
    assert again.named == one.named
    bare = replace(one, embedding=None)
    assert read_view(pb.KeptMap.FromString(bare.kept).views[0]).embedding is None
    message.first_bin = 390
    with pytest.raises(InvalidInput, match="kept view"):
        read_view(message)
