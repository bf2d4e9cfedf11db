"""Unusable output of a plug-in is dropped, reported and logged; good output clears the report."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest
from detector_rig import Rig
from detector_scene import SceneTruth, context_of
from helios_core import proto as pb
from helios_core.codec import observation_from_proto
from helios_core.errors import Internal
from helios_core.log_rate_limit import LogRateLimit
from helios_core.topics import KEYFRAME, VOCABULARY
from helios_core.types import SearchContext
from helios_detector.backend import Findings
from helios_detector.lexical_scorer import LexicalScorer
from helios_detector.simulation.ground_truth_detector import GroundTruthDetector

Slip = Callable[[Findings], Any]

LOOSE: Any = Findings  # accepts values of any type, as an untyped plug-in gives


class Slipping(GroundTruthDetector):
    """Passes its findings through `slip`, a faulty change, if one is set."""

    name = "slipping"
    slip: Slip | None = None

    def detect(self, frame, context) -> Any:
        found = super().detect(frame, context)
        return found if self.slip is None else self.slip(found)


class Scoring(LexicalScorer):
    """Returns `given` as its scores, if it is set."""

    name = "scoring"
    given: Any = None

    def score(self, frame, seen, prompts) -> Any:
        return super().score(frame, seen, prompts) if self.given is None else self.given


def slipping(slip: Slip | None = None) -> tuple[Rig, Slipping]:
    truth = SceneTruth()
    detector = Slipping(truth)
    detector.slip = slip
    rig = Rig(detector)
    rig.truth = truth
    rig.look_for(context_of("mug", "bowl"))
    return rig, detector


def each(**changes: Any) -> Slip:
    """A slip that replaces these fields of every detection."""

    def slip(found: Findings) -> Findings:
        return Findings(tuple(replace(d, **changes) for d in found.detections), found.seen)

    return slip


def small_masks(found: Findings) -> Findings:
    return Findings(tuple(replace(d, mask=d.mask[:100]) for d in found.detections), found.seen)


@pytest.mark.parametrize(
    ("slip", "said"),
    [
        (small_masks, "a mask bool (100, 320), wanted bool (240, 320)"),
        (each(mask=np.zeros((240, 320), np.uint8)), "a mask uint8 (240, 320), wanted bool"),
        (each(mask=None), "None as its mask, wanted bool (240, 320)"),
        (each(class_name="zebra"), "class_name 'zebra', wanted one of 'bowl', 'mug'"),
        (each(class_name=3), "class_name 3, wanted one of"),
        (each(score=float("nan")), "nan as the score of a detection of"),
        (each(score="high"), "'high' as the score of a detection of"),
        (each(score=None), "None as the score of a detection of"),
        (each(box_xyxy=(9, 9, 3, 3)), "box_xyxy (9, 9, 3, 3), wanted whole x0 < x1 of 0 to 320"),
        (each(box_xyxy=(1.5, 2.0, 30.0, 40.0)), "box_xyxy (1.5, 2.0, 30.0, 40.0), wanted whole"),
        (each(box_xyxy=None), "box_xyxy None, wanted whole"),
        (lambda found: LOOSE(({"box": 1}, *found.detections), ()), "type dict among detections"),
        (lambda found: LOOSE((), ("mug", *found.seen)), "type str in seen, wanted Seen("),
    ],
)
def test_unusable_output_is_dropped_and_the_reason_is_reported(slip: Slip, said: str) -> None:
    rig, detector = slipping(slip)
    rig.bus.publish(KEYFRAME, rig.frame(1))
    assert len(rig.observations) == 1  # the frame is still answered
    state, reason = rig.health.state
    assert state == "degraded"
    assert "the detector slipping gave in detect()" in reason
    assert said in reason
    assert "; see its log" in reason
    detector.slip = None
    rig.bus.publish(KEYFRAME, rig.frame(2))
    assert rig.health.state == ("ready", "")


def test_valid_detections_beside_an_invalid_one_are_used() -> None:
    def one_bad(found: Findings) -> Findings:
        first, *rest = found.detections
        return Findings((replace(first, score=float("nan")), *rest), found.seen)

    rig, _ = slipping(one_bad)
    rig.bus.publish(KEYFRAME, rig.frame(1))
    assert len(observation_from_proto(rig.observations[0]).detections) == 1
    assert rig.count("detections_refused") == 1


def test_a_score_out_of_range_is_clipped_and_reported_but_a_rounding_error_is_not_reported() -> (
    None
):
    rig, detector = slipping(each(score=3.0))
    rig.bus.publish(KEYFRAME, rig.frame(1))
    assert "3 as the score of a detection of" in rig.health.state[1]
    assert "it was cut to 1" in rig.health.state[1]
    detector.slip = each(score=1.0000001)
    rig.bus.publish(KEYFRAME, rig.frame(2))
    assert rig.health.state == ("ready", "")
    assert [d.score for d in observation_from_proto(rig.observations[1]).detections] == [1.0, 1.0]


@pytest.mark.parametrize(
    ("slip", "said"),
    [
        (lambda found: list(found.detections), "type list, wanted Findings(detections, seen)"),
        (lambda found: None, "None, wanted Findings(detections, seen)"),
        (lambda found: LOOSE(3, ()), "type int as detections, wanted a tuple"),
    ],
)
def test_findings_of_the_wrong_type_fail_the_frame_and_name_the_expected_type(
    slip: Slip, said: str
) -> None:
    rig, detector = slipping(slip)
    rig.bus.publish(KEYFRAME, rig.frame(1))
    assert rig.observations == []
    assert rig.count("keyframes_failed") == 1
    assert rig.health.state[0] == "degraded"
    assert "the detector slipping gave what cannot be used, in detect(): " in rig.health.state[1]
    assert said in rig.health.state[1]
    detector.slip = None
    rig.bus.publish(KEYFRAME, rig.frame(2))
    assert rig.health.state == ("ready", "")


def test_a_frame_without_detections_does_not_clear_a_reported_fault() -> None:
    rig, detector = slipping(small_masks)
    rig.bus.publish(KEYFRAME, rig.frame(1))
    detector.slip = lambda found: Findings((), ())
    rig.bus.publish(KEYFRAME, rig.frame(2))
    assert rig.health.state[0] == "degraded"
    rig.look_for(context_of("mug", id="another search"))
    assert rig.health.state == ("ready", "")


@pytest.mark.parametrize(
    ("given", "said", "sent"),
    [
        ({"foo": 0.5}, "a score for 'foo', wanted a score of 0 to 1 for each of 'pick'", {}),
        ({}, "no score for 'pick', wanted", {}),
        ({"pick": float("inf")}, "inf as the score of 'pick', wanted 0 to 1", {"pick": 1.0}),
        ({"pick": float("nan")}, "nan as the score of 'pick'", {}),
        ({"pick": "much"}, "'much' as the score of 'pick'", {}),
        ({"pick": 0.5, "x": 1.0}, "a score for 'x'", {"pick": 0.5}),
    ],
)
def test_invalid_scores_are_reported_and_the_detections_are_used(
    given: Any, said: str, sent: dict[str, float]
) -> None:
    scorer, context = Scoring(), context_of("mug")
    truth = SceneTruth()
    rig = Rig(GroundTruthDetector(truth), scorer)
    rig.truth = truth
    rig.look_for(SearchContext(context.id, context.classes, {"pick": "a mug"}))
    scorer.given = given
    rig.bus.publish(KEYFRAME, rig.frame(1))
    assert len(rig.observations[0].detections) == 1
    assert dict(rig.observations[0].layer_scores) == sent
    assert rig.health.state[0] == "degraded"
    assert "the scorer scoring gave in score() " in rig.health.state[1]
    assert said in rig.health.state[1]
    scorer.given = None
    rig.bus.publish(KEYFRAME, rig.frame(2))
    assert rig.health.state == ("ready", "")


@pytest.mark.parametrize("given", [[0.5], 0.5, "much"])
def test_scores_of_the_wrong_type_fail_the_frame_and_name_the_expected_type(given: Any) -> None:
    scorer, truth = Scoring(), SceneTruth()
    rig = Rig(GroundTruthDetector(truth), scorer)
    rig.truth = truth
    context = context_of("mug")
    rig.look_for(SearchContext(context.id, context.classes, {"pick": "a mug"}))
    scorer.given = given
    rig.bus.publish(KEYFRAME, rig.frame(1))
    assert rig.count("keyframes_failed") == 1
    assert (
        f"type {type(given).__name__}, wanted a score of 0 to 1 for each of 'pick'"
        in (rig.health.state[1])
    )


def test_a_repeated_fault_is_logged_with_its_traceback_only_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    def boom(_: Findings) -> Findings:
        raise RuntimeError("the GPU fell off")

    rig, _ = slipping(boom)
    with caplog.at_level(logging.WARNING):
        for number in range(1, 4):
            rig.bus.publish(KEYFRAME, rig.frame(number))
    said = "the detector slipping failed in detect() (RuntimeError: the GPU fell off)"
    assert f"{said}; the traceback is in its log" in rig.health.state[1]
    assert [r.getMessage() for r in caplog.records if r.exc_info] == [said]


def test_a_repeated_reason_is_logged_again_after_the_period_with_its_count(
    caplog: pytest.LogCaptureFixture,
) -> None:
    now_s = 0.0
    seldom = LogRateLimit(logging.getLogger("seldom"), 30.0, lambda: now_s)
    with caplog.at_level(logging.WARNING):
        for now_s in (0.0, 1.0, 2.0, 31.0, 32.0):
            seldom.warn("masks", f"at {now_s:g}")
        seldom.warn("names", "another")
    reported = [r.getMessage() for r in caplog.records]
    assert reported == ["at 0", "at 31 (and 2 times since it was last said)", "another"]


@pytest.mark.parametrize(
    ("given", "said"),
    [("mug", "type str ('mug'), wanted a tuple of names"), ((), "type tuple"), (7, "type int")],
)
def test_a_vocabulary_of_the_wrong_type_is_reported_to_the_caller(given: Any, said: str) -> None:
    rig, detector = slipping()
    detector.vocabulary = lambda: given
    with pytest.raises(Internal, match=r"the detector slipping .* in vocabulary") as error:
        rig.bus.call(VOCABULARY, pb.Empty(), 1.0)
    assert said in error.value.message


def test_refusals_of_the_wrong_type_are_reported() -> None:
    truth = SceneTruth()
    detector = Slipping(truth)
    cast(Any, detector).refused = lambda context: ["mug"]
    rig = Rig(detector)
    rig.look_for(context_of("mug"))
    assert rig.health.state[0] == "degraded"
    assert (
        "in refused(): a value of type list, wanted a dict of class name" in (rig.health.state[1])
    )
