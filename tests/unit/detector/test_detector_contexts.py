"""Search contexts that are wrong, beyond the vocabulary, or that the back end cannot take now."""

import numpy as np
import pytest
from detector_house import CONTEXT_1, Faulty, House
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


def test_a_class_outside_the_vocabulary_is_said_and_the_service_lives_on():
    house = House(Faulty())
    house.look_for(context_of("unicorn"))
    state, reason = house.health.state
    assert state == "degraded"
    assert "'unicorn' is not among the 80 classes" in reason
    assert (house.count("contexts_unknown"), house.count("classes_refused")) == (1, 1)
    house.look_for(context_of("cup", id="c2"))
    assert house.health.state[0] == "ready"
    assert (house.count("contexts_sought"), house.count("classes_refused")) == (1, 0)


def test_a_wrong_context_is_refused_and_the_old_one_stays():
    house = House()
    house.look_for()
    wrong = context_to_proto(CONTEXT_1)
    wrong.id = "c2"
    wrong.classes[0].role = "hero"
    house.bus.publish(CONTEXT, wrong)
    house.bus.publish(KEYFRAME, house.frame())
    assert [o.context_id for o in house.observations] == ["c1"]
    assert house.count("contexts_refused") == 1


def test_a_context_that_seeks_nothing_is_answered_without_asking_the_models():
    class Untouched(Faulty):
        def refused(self, context):
            raise AssertionError("it was asked")

        def detect(self, frame, context) -> Findings:
            raise AssertionError("it was asked")

    house = House(Untouched())
    house.look_for(SearchContext("empty", ()))
    house.bus.publish(KEYFRAME, house.frame())
    [observation] = house.observations
    assert (observation.context_id, len(observation.detections)) == ("empty", 0)
    assert house.health.state == ("ready", "")


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
def test_a_context_beyond_all_measure_is_refused_and_counted(context: pb.SearchContext):
    house = House()
    house.bus.publish(CONTEXT, context)
    assert house.count("contexts_refused") == 1
    assert not house.service.knows_context


def test_a_class_outside_the_vocabulary_in_two_spellings_keeps_nothing_from_being_sought():
    class Strict(Faulty):
        def detect(self, frame, context) -> Findings:
            refuse_unknown(fixed_wanted(context, COCO_NAMES)[1])
            return Findings((), ())

    house = House(Strict())
    house.look_for(context_of("cup", "Sofa foot", "sofa  foot"))
    assert "is not among the 80 classes" in house.health.state[1]
    house.bus.publish(KEYFRAME, house.frame())
    assert len(house.observations) == 1
    assert house.count("keyframes_refused") == 0


class Moody(GroundTruthDetector):
    """Cannot always say what it would find."""

    def __init__(self, truth: SceneTruth) -> None:
        super().__init__(truth)
        self.fault: Exception | None = None
        self.asked: list[str] = []
        self.meanwhile = lambda: None  # what happens while it is asked

    def refused(self, context):
        self.asked.append(context.id)
        self.meanwhile()
        if self.fault is not None:
            raise self.fault
        return super().refused(context)


def moody_house() -> tuple[House, Moody]:
    truth = SceneTruth()
    moody = Moody(truth)
    house = House(moody)
    house.truth = truth
    return house, moody


AWAY = Unavailable("the text model is away")


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        (AWAY, "the text model is away"),
        (KeyError("x"), "the detector ground-truth failed in refused() (KeyError: 'x')"),
    ],
)
def test_a_context_that_the_back_end_cannot_take_is_kept_and_tried_again(
    fault: Exception, said: str, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("helios_detector.service.AGAIN_S", 0.0)
    house, moody = moody_house()
    moody.fault = fault
    house.look_for()
    house.bus.publish(KEYFRAME, house.frame())  # held
    house.service.seek_again()
    assert house.observations == []
    assert (house.count("contexts_refused"), house.count("context_retries")) == (1, 1)
    assert house.health.state[0] == "degraded"
    assert f"search context c1 is not sought: {said}" in house.health.state[1]
    moody.fault = None
    house.service.seek_again()
    assert [o.context_id for o in house.observations] == ["c1"]
    assert house.health.state == ("ready", "")
    asked = len(moody.asked)
    house.service.seek_again()
    assert len(moody.asked) == asked  # there is nothing left to ask


def test_a_keyframe_that_goes_well_does_not_hide_a_context_that_is_not_sought():
    house, moody = moody_house()
    house.look_for()
    moody.fault = AWAY
    house.look_for(context_of("bowl", id="c2"))
    house.bus.publish(KEYFRAME, house.frame())
    assert [o.context_id for o in house.observations] == ["c1"]
    assert house.health.state == (
        "degraded", "search context c2 is not sought: the text model is away"
    )  # fmt: skip
    house.service.seek_again()
    assert moody.asked == ["c1", "c2"]  # too early to ask again


def test_a_newer_context_takes_the_place_of_one_that_waits(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("helios_detector.service.AGAIN_S", 0.0)
    house, moody = moody_house()
    moody.fault = AWAY
    house.look_for()
    moody.fault = None
    house.look_for(context_of("bowl", id="c2"))
    house.service.seek_again()
    assert moody.asked == ["c1", "c2"]
    house.bus.publish(KEYFRAME, house.frame())
    assert [o.context_id for o in house.observations] == ["c2"]
    assert house.health.state == ("ready", "")


def test_a_context_is_not_asked_for_again_while_the_back_end_is_at_it():
    house, moody = moody_house()
    moody.meanwhile = house.service.seek_again
    house.look_for()
    assert moody.asked == ["c1"]
    assert house.count("context_retries") == 0


def test_a_context_that_the_back_end_calls_wrong_is_said_and_not_tried_again(
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.setattr("helios_detector.service.AGAIN_S", 0.0)
    house, moody = moody_house()
    moody.fault = InvalidInput("no mugs, please; ask for cups")
    house.look_for()
    house.service.seek_again()
    assert moody.asked == ["c1"]
    assert "search context c1 is not sought: no mugs, please" in house.health.state[1]
