"""The output of a back end is checked against its contract before it is sent."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from detector_scene import SceneTruth, context_of, frame_of
from helios_core.codec import (
    context_to_proto,
    frame_to_proto,
    observation_from_proto,
    observation_to_proto,
)
from helios_core.errors import InvalidInput
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import CONTEXT, KEYFRAME, OBSERVATION
from helios_core.types import Detection, Observation
from helios_detector.backend import Findings, Judgement, Seen
from helios_detector.detection_filtering import box_of, near_box
from helios_detector.lexical_scorer import LexicalScorer
from helios_detector.output_checks import checked_findings, checked_judgement
from helios_detector.service import DetectorService
from helios_detector.simulation.ground_truth_detector import GroundTruthDetector
from hypothesis import given, settings
from hypothesis import strategies as st

SHAPE = (40, 60)


def detection(score: float = 0.5, box: tuple[int, int, int, int] = (5, 5, 15, 15)) -> Detection:
    mask = np.zeros(SHAPE, bool)
    mask[8:12, 8:12] = True
    return Detection("mug", score, box, mask)


def test_valid_findings_pass_unchanged():
    good = Findings((detection(0.0), detection(1.0)), (Seen("mug", 0.3),))
    held, wrong = checked_findings(good, SHAPE)
    assert held == good
    assert not wrong


def test_a_detection_with_an_empty_mask_is_left_out_and_is_no_fault():
    empty = replace(detection(), mask=np.zeros(SHAPE, bool))
    held, wrong = checked_findings(Findings((empty, detection()), ()), SHAPE)
    assert len(held.detections) == 1
    assert held.detections[0].mask.any()
    assert not wrong


@pytest.mark.parametrize("sequence", [list, np.array])
def test_a_box_of_another_sequence_type_becomes_a_tuple(sequence: Callable[[Any], Any]):
    listed = replace(detection(), box_xyxy=sequence((5, 5, 15, 15)))
    held, wrong = checked_findings(Findings((listed,), ()), SHAPE)
    assert [d.box_xyxy for d in held.detections] == [(5, 5, 15, 15)]
    assert not wrong


@pytest.mark.parametrize(("score", "sent"), [(1.7, 1.0), (-0.2, 0.0), (float("inf"), 1.0)])
def test_a_score_outside_0_to_1_is_clipped_and_counted(score: float, sent: float):
    held, wrong = checked_findings(Findings((detection(score),), (Seen("mug", score),)), SHAPE)
    assert [d.score for d in held.detections] == [sent]
    assert [s.score for s in held.seen] == [sent]
    assert wrong.counts == {"scores_clipped": 2}


@pytest.mark.parametrize(
    "bad",
    [
        detection(float("nan")),
        detection(box=(5, 5, 5, 15)),
        detection(box=(-1, 5, 15, 15)),
        detection(box=(5, 5, 61, 15)),
        replace(detection(), mask=np.zeros((10, 10), bool)),
        replace(detection(), mask=np.zeros(SHAPE, np.uint8)),
    ],
)
def test_an_invalid_detection_is_dropped_and_counted(bad: Detection):
    held, wrong = checked_findings(Findings((bad, detection()), ()), SHAPE)
    assert len(held.detections) == 1
    assert wrong.counts == {"detections_refused": 1}


def test_a_box_smaller_than_its_mask_is_widened_to_the_mask():
    """Only mask pixels within the box are sent."""
    held, wrong = checked_findings(Findings((detection(box=(10, 5, 15, 15)),), ()), SHAPE)
    assert held.detections[0].box_xyxy == (8, 5, 15, 15)
    assert wrong.counts == {"boxes_widened": 1}
    assert wrong.sentence == ""


@settings(deadline=None)
@given(
    score=st.floats(allow_nan=True, allow_infinity=True),
    box=st.tuples(*[st.integers(-5, 65)] * 4),
)
def test_any_score_and_box_gives_an_observation_that_can_be_sent_and_read(
    score: float, box: tuple[int, int, int, int]
):
    frame = frame_of()
    mask = np.zeros(frame.depth_m.shape, bool)
    mask[8:12, 8:12] = True
    held, _ = checked_findings(
        Findings((Detection("mug", score, box, mask),), ()), frame.depth_m.shape
    )
    sent = observation_to_proto(Observation(frame, "c", held.detections, {}, "d"))
    for d in observation_from_proto(sent).detections:
        assert 0 <= d.score <= 1
        assert d.mask.sum() == 16


def test_layer_scores_are_clipped_and_nan_is_dropped():
    held, wrong = checked_judgement(Judgement({"pick": 1.5, "place": 0.5}), {"pick", "place"})
    assert held.scores == {"pick": 1.0, "place": 0.5}
    assert wrong.counts == {"scores_clipped": 1}
    held, wrong = checked_judgement(
        Judgement({"pick": float("nan"), "place": 0.5}), {"pick", "place"}
    )
    assert held.scores == {"place": 0.5}
    assert "nan as the score of 'pick', wanted a number from 0 to 1" in wrong.sentence


def test_the_service_clips_and_counts_a_score_above_1_and_sends_the_detection():
    class Boasting(GroundTruthDetector):
        name = "boasting"

        def detect(self, frame, context) -> Findings:
            found = super().detect(frame, context)
            louder = tuple(replace(d, score=3.0) for d in found.detections)
            return Findings(louder, found.seen)

    truth, hub, health, seen = SceneTruth(), MemoryHub(), Health(), []
    bus = MemoryBus(hub)
    bus.subscribe(OBSERVATION, seen.append)
    DetectorService(MemoryBus(hub), Boasting(truth), LexicalScorer(), health)
    bus.publish(CONTEXT, context_to_proto(context_of("mug")))
    bus.publish(KEYFRAME, frame_to_proto(truth.frame()))
    assert [d.score for d in observation_from_proto(seen[0]).detections] == [1.0]
    assert health.metrics()["scores_clipped"] == 1
    assert health.metrics()["keyframes_answered"] == 1


def test_a_received_observation_with_a_score_outside_0_to_1_is_refused():
    truth, hub, seen = SceneTruth(), MemoryHub(), []
    bus = MemoryBus(hub)
    bus.subscribe(OBSERVATION, seen.append)
    DetectorService(MemoryBus(hub), GroundTruthDetector(truth), LexicalScorer(), Health())
    bus.publish(CONTEXT, context_to_proto(context_of("mug")))
    bus.publish(KEYFRAME, frame_to_proto(truth.frame()))
    for score in (1.7, -0.1, float("nan")):
        seen[0].detections[0].score = score
        with pytest.raises(InvalidInput, match="send a number from 0 to 1"):
            observation_from_proto(seen[0])


def test_a_mask_may_exceed_its_box_slightly_and_distant_specks_are_dropped():
    mask = np.zeros(SHAPE, bool)
    mask[10:20, 10:22] = True  # the object, beyond a box that ends at 20
    mask[12, 22:58] = True  # a leak out of the object
    mask[30:33, 50:53] = mask[8, 22] = True  # specks
    kept = near_box(mask, (10, 10, 20, 20))
    assert box_of(kept) == (10, 10, 22, 20)
    assert kept.sum() == 120
    assert not near_box(mask, (40, 0, 60, 10)).any()
    assert not near_box(np.zeros(SHAPE, bool), (0, 0, 10, 10)).any()
    full = np.ones(SHAPE, bool)
    assert near_box(full, (0, 0, 60, 40)).all()
