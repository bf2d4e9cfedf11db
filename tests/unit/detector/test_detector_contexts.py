"""Search contexts that are invalid, outside the vocabulary, or not yet taken by the back end."""

import numpy as np
import pytest
from detector_rig import CONTEXT_1, Faulty, Rig
from detector_scene import SceneTruth, context_of
from helios_core import proto as pb
from helios_core.codec import context_to_proto
from helios_core.errors import InvalidInput, Unavailable
from helios_core.topics import CONTEXT, KEYFRAME
from helios_core.types import SearchContext
from helios_detector.backend import Findings
from helios_detector.coco_classes import COCO_NAMES
from helios_detector.simulation.ground_truth_detector import GroundTruthDetector
from helios_detector.vocabulary_matching import fixed_wanted, refuse_unknown


def test_a_class_outside_the_vocabulary_is_reported_and_the_next_context_works():
    rig = Rig(Faulty())
    rig.look_for(context_of("unicorn"))
    state, reason = rig.health.state
    assert state == "degraded"
    assert "'unicorn' is not among the 80 classes" in reason
    assert (rig.count("contexts_unknown"), rig.count("classes_refused")) == (1, 1)
    rig.look_for(context_of("cup", id="c2"))
    assert rig.health.state[0] == "ready"
    assert (rig.count("contexts_sought"), rig.count("classes_refused")) == (1, 0)


def test_an_invalid_context_is_refused_and_the_previous_context_stays():
    rig = Rig()
    rig.look_for()
    wrong = context_to_proto(CONTEXT_1)
    wrong.id = "c2"
    wrong.classes[0].role = "hero"
    rig.bus.publish(CONTEXT, wrong)
    rig.bus.publish(KEYFRAME, rig.frame())
    assert [o.context_id for o in rig.observations] == ["c1"]
    assert rig.count("contexts_refused") == 1


def test_keyframes_of_an_empty_context_are_answered_without_calling_the_models():
    class Untouched(Faulty):
        def refused(self, context):
            raise AssertionError("it was asked")

        def detect(self, frame, context) -> Findings:
            raise AssertionError("it was asked")

    rig = Rig(Untouched())
    rig.look_for(SearchContext("empty", ()))
    rig.bus.publish(KEYFRAME, rig.frame())
    [observation] = rig.observations
    assert (observation.context_id, len(observation.detections)) == ("empty", 0)
    assert rig.health.state == ("ready", "")


LONG = "x" * 301


@pytest.mark.parametrize(
    "context",
    [
        pb.SearchContext(id=LONG),
        pb.SearchContext(classes=[pb.SearchClass(name=LONG, role="object")]),
        pb.SearchContext(classes=[pb.SearchClass(name="m", role="object", synonyms=[LONG])]),
        pb.SearchContext(classes=[pb.SearchClass(name="m", role="object", synonyms=["x"] * 65)]),
        pb.SearchContext(classes=[pb.SearchClass(name="m", role="object", threshold=np.nan)]),
        pb.SearchContext(classes=[pb.SearchClass(name="m", role="object")] * 129),
        pb.SearchContext(prompts={"pick": "x" * 2001}),
        pb.SearchContext(prompts={f"layer{i}": "x" for i in range(17)}),
    ],
)
def test_a_context_beyond_the_limits_is_refused_and_counted(context: pb.SearchContext):
    rig = Rig()
    rig.bus.publish(CONTEXT, context)
    assert rig.count("contexts_refused") == 1
    assert not rig.service.knows_context


def test_two_spellings_of_an_unknown_class_do_not_block_the_known_class():
    class Strict(Faulty):
        def detect(self, frame, context) -> Findings:
            refuse_unknown(fixed_wanted(context, COCO_NAMES)[1])
            return Findings((), ())

    rig = Rig(Strict())
    rig.look_for(context_of("cup", "Sofa foot", "sofa  foot"))
    assert "is not among the 80 classes" in rig.health.state[1]
    rig.bus.publish(KEYFRAME, rig.frame())
    assert len(rig.observations) == 1
    assert rig.count("keyframes_refused") == 0


class Moody(GroundTruthDetector):
    """Raises `fault` in `refused` while it is set."""

    def __init__(self, truth: SceneTruth) -> None:
        super().__init__(truth)
        self.fault: Exception | None = None
        self.asked: list[str] = []
        self.meanwhile = lambda: None  # runs during the call

    def refused(self, context):
        self.asked.append(context.id)
        self.meanwhile()
        if self.fault is not None:
            raise self.fault
        return super().refused(context)


def moody_rig() -> tuple[Rig, Moody]:
    truth = SceneTruth()
    moody = Moody(truth)
    rig = Rig(moody)
    rig.truth = truth
    return rig, moody


AWAY = Unavailable("the text model is away")


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        (AWAY, "the text model is away"),
        (KeyError("x"), "the detector ground-truth failed in refused() (KeyError: 'x')"),
    ],
)
def test_a_context_that_the_back_end_cannot_take_yet_is_kept_and_retried(
    fault: Exception, said: str, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("helios_detector.service.CONTEXT_RETRY_S", 0.0)
    rig, moody = moody_rig()
    moody.fault = fault
    rig.look_for()
    rig.bus.publish(KEYFRAME, rig.frame())  # held
    rig.service.retry_context()
    assert rig.observations == []
    assert (rig.count("contexts_refused"), rig.count("context_retries")) == (1, 1)
    assert rig.health.state[0] == "degraded"
    assert f"search context c1 is not sought: {said}" in rig.health.state[1]
    moody.fault = None
    rig.service.retry_context()
    assert [o.context_id for o in rig.observations] == ["c1"]
    assert rig.health.state == ("ready", "")
    asked = len(moody.asked)
    rig.service.retry_context()
    assert len(moody.asked) == asked  # nothing is left to retry


def test_an_answered_keyframe_does_not_hide_a_pending_context_in_health():
    rig, moody = moody_rig()
    rig.look_for()
    moody.fault = AWAY
    rig.look_for(context_of("bowl", id="c2"))
    rig.bus.publish(KEYFRAME, rig.frame())
    assert [o.context_id for o in rig.observations] == ["c1"]
    assert rig.health.state == (
        "degraded",
        "search context c2 is not sought: the text model is away",
    )
    rig.service.retry_context()
    assert moody.asked == ["c1", "c2"]  # too early for a retry


def test_a_newer_context_replaces_a_pending_context(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("helios_detector.service.CONTEXT_RETRY_S", 0.0)
    rig, moody = moody_rig()
    moody.fault = AWAY
    rig.look_for()
    moody.fault = None
    rig.look_for(context_of("bowl", id="c2"))
    rig.service.retry_context()
    assert moody.asked == ["c1", "c2"]
    rig.bus.publish(KEYFRAME, rig.frame())
    assert [o.context_id for o in rig.observations] == ["c2"]
    assert rig.health.state == ("ready", "")


def test_a_context_is_not_retried_while_the_back_end_works_on_it():
    rig, moody = moody_rig()
    moody.meanwhile = rig.service.retry_context
    rig.look_for()
    assert moody.asked == ["c1"]
    assert rig.count("context_retries") == 0


def test_a_context_that_the_back_end_calls_invalid_is_reported_and_not_retried(
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.setattr("helios_detector.service.CONTEXT_RETRY_S", 0.0)
    rig, moody = moody_rig()
    moody.fault = InvalidInput("no mugs, please; ask for cups")
    rig.look_for()
    rig.service.retry_context()
    assert moody.asked == ["c1"]
    assert "search context c1 is not sought: no mugs, please" in rig.health.state[1]
