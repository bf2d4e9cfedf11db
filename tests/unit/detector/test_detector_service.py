"""The service on an in-memory bus answers every keyframe and shows every stream frame."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from detector_rig import CONTEXT_1, Faulty, Rig
from detector_scene import MUG, SceneTruth, context_of
from helios_core import proto as pb
from helios_core.codec import context_to_proto, frame_to_proto, observation_from_proto
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import CONTEXT, FRAME, KEYFRAME, OBSERVATION, VOCABULARY
from helios_core.types import SearchContext
from helios_detector.lexical_scorer import LexicalScorer
from helios_detector.service import DetectorService
from helios_detector.simulation.ground_truth_detector import GroundTruthDetector


def test_every_keyframe_is_answered_with_its_frame_context_masks_and_scores():
    rig = Rig()
    rig.look_for()
    for seq in (1, 2, 3):
        rig.bus.publish(KEYFRAME, rig.frame(seq))
    assert [o.frame.id.seq for o in rig.observations] == [1, 2, 3]
    observation = observation_from_proto(rig.observations[0])
    assert observation.context_id == "c1"
    assert (observation.detector, observation.scorer) == ("ground-truth", "lexical")
    assert sorted(d.class_name for d in observation.detections) == ["dining table", "mug"]
    mug = next(d for d in observation.detections if d.class_name == "mug")
    np.testing.assert_array_equal(mug.mask, rig.truth.ids[10**8] == MUG.id)
    assert observation.layer_scores.keys() == {"pick", "place"}
    assert observation.layer_scores["pick"] > observation.layer_scores["place"]
    assert rig.health.state == ("ready", "")


class Looking(LexicalScorer):
    """Scorer that says it looks at the image; keeps the prompts of its last call."""

    reads_names = False

    def score(self, frame, seen, prompts):
        self.prompts = dict(prompts)
        return super().score(frame, seen, prompts)


@pytest.mark.parametrize("looks", [True, False])
def test_a_scorer_that_looks_at_the_image_rates_each_class_once(looks: bool):
    scorer = Looking()
    scorer.reads_names = not looks
    rig = Rig(scorer=scorer)
    of_classes = {"mug": "a mug", "dining table": "a dining table"}
    rig.look_for(replace(CONTEXT_1, class_prompts=of_classes))
    rig.bus.publish(KEYFRAME, rig.frame())
    observation = observation_from_proto(rig.observations[0])
    assert observation.layer_scores.keys() == {"pick", "place"}
    assert observation.class_scores.keys() == (of_classes.keys() if looks else set())
    assert len(scorer.prompts) == (3 if looks else 2)  # the pick layer's prompt is the mug's
    if looks:
        assert observation.class_scores["mug"] == observation.layer_scores["pick"]


def test_detections_under_other_names_stand_apart_and_get_no_box():
    rig = Rig()
    rig.look_for(SearchContext("c1", context_of("mug").classes, also=("dining table", "sofa")))
    rig.bus.publish(KEYFRAME, rig.frame())
    observation = observation_from_proto(rig.observations[0])
    assert [d.class_name for d in observation.detections] == ["mug"]
    assert [d.class_name for d in observation.others] == ["dining table"]
    assert observation_from_proto(rig.observations[0], with_others=False).others == ()
    assert [d.class_name for d in rig.previews[0].detections] == ["mug"]
    assert rig.health.state == ("ready", "")


def test_the_newest_keyframe_is_held_until_a_context_is_known():
    rig = Rig()
    rig.bus.publish(KEYFRAME, rig.frame(1))
    rig.bus.publish(KEYFRAME, rig.frame(2))
    assert rig.observations == []
    assert "waits for a search context" in rig.health.state[1]
    rig.look_for()
    assert [o.frame.id.seq for o in rig.observations] == [2]
    assert rig.count("keyframes_replaced") == 1


def test_a_detector_that_starts_late_gets_the_retained_context():
    hub = MemoryHub()
    bus = MemoryBus(hub)
    bus.publish(CONTEXT, context_to_proto(CONTEXT_1))
    truth, seen = SceneTruth(), []
    bus.subscribe(OBSERVATION, seen.append)
    DetectorService(MemoryBus(hub), GroundTruthDetector(truth), LexicalScorer(), Health())
    bus.publish(KEYFRAME, frame_to_proto(truth.frame()))
    assert len(seen) == 1


def test_stream_frames_become_previews_with_boxes_and_no_observation():
    rig = Rig()
    rig.look_for()
    rig.bus.publish(FRAME, rig.frame())
    (preview,) = rig.previews
    assert rig.observations == []
    assert {d.class_name for d in preview.detections} == {"mug", "dining table"}
    assert all(not d.mask.bits and d.mask.width for d in preview.detections)
    pixels = cv2.imdecode(np.frombuffer(preview.jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert pixels is not None
    assert pixels.shape == (240, 320, 3)


def test_a_stream_frame_before_any_context_is_shown_without_boxes():
    rig = Rig()
    rig.bus.publish(FRAME, rig.frame())
    assert len(rig.previews) == 1
    assert not rig.previews[0].detections


def test_the_vocabulary_reply_holds_names_or_says_open():
    rig = Rig()
    reply = rig.bus.call(VOCABULARY, pb.Empty(), 1.0)
    assert (reply.open, list(reply.names), reply.detector) == (True, [], "ground-truth")
    reply = Rig(Faulty()).bus.call(VOCABULARY, pb.Empty(), 1.0)
    assert (reply.open, len(reply.names), reply.scorer) == (False, 80, "lexical")


def test_nan_and_negative_depth_count_as_no_depth():
    rig = Rig()
    rig.look_for()
    message = rig.frame()
    depth_m = rig.truth.frame().depth_m.copy()
    depth_m[:10], depth_m[10:20], depth_m[20:30] = np.nan, -1.0, np.inf
    message.raw_depth.encoding, message.raw_depth.step = "32FC1", 4 * depth_m.shape[1]
    message.raw_depth.data = depth_m.astype("<f4").tobytes()
    rig.bus.publish(KEYFRAME, message)
    frame = observation_from_proto(rig.observations[0]).frame
    assert (frame.depth_m[:30] == 0).all()


def test_memory_of_the_accelerator_is_reported_per_frame():
    class Big(GroundTruthDetector):
        def accelerator_mb(self) -> float:
            return 1234.0

    truth = SceneTruth()
    rig = Rig(Big(truth))
    rig.truth = truth
    rig.look_for()
    rig.bus.publish(KEYFRAME, rig.frame())
    assert rig.count("accelerator_mb_median") == 1234
    assert rig.count("memory_mb") > 10
    assert rig.observations[0].detect_ms > 0
