"""Broken frames, wrong contexts and faults of a back end: counted, said, and outlived."""

import copy
import random

import numpy as np
import pytest
from detector_house import CONTEXT_1, Faulty, House
from detector_scene import SceneTruth, context_of
from helios_core import proto as pb
from helios_core.codec import context_to_proto
from helios_core.errors import Unavailable
from helios_core.topics import CONTEXT, FRAME, KEYFRAME
from helios_detector.backend import Findings
from helios_detector.simulation.ground_truth import GroundTruthDetector


def test_a_class_outside_the_vocabulary_is_said_and_the_service_lives_on():
    house = House(Faulty())
    house.look_for(context_of("unicorn"))
    state, reason = house.health.state
    assert state == "degraded"
    assert "'unicorn' is not among the 80 classes" in reason
    house.look_for(context_of("cup", id="c2"))
    assert house.health.state[0] == "ready"


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


def test_a_fault_of_the_back_end_is_counted_and_said():
    house = House(Faulty())
    house.look_for(context_of("cup"))
    house.bus.publish(KEYFRAME, house.frame())
    assert house.observations == []
    assert house.count("keyframes_failed") == 1
    assert house.health.state[0] == "degraded"
    assert "ZeroDivisionError" in house.health.state[1]


def test_while_the_world_is_away_keyframes_fail_with_the_reason_and_work_again_after():
    house = House()
    house.look_for()
    first, second = house.frame(1), house.frame(2)
    house.truth.down = True
    house.bus.publish(KEYFRAME, first)
    assert house.health.state == (
        "degraded", "the last keyframe could not be answered: the world is away"
    )  # fmt: skip
    house.truth.down = False
    house.bus.publish(KEYFRAME, second)
    assert [o.frame.id.seq for o in house.observations] == [2]
    assert house.health.state[0] == "ready"


def broken(what: str, good: pb.Frame) -> pb.Frame:
    """The frame with one thing wrong."""
    out = copy.deepcopy(good)
    if what == "corrupt jpeg":
        out.compressed_color.format = "jpeg"
        out.compressed_color.data = b"\xff\xd8\xff\xe0" + b"rubbish" * 20
    elif what == "empty image":
        out.raw_color.width = 0
    elif what == "sizes":
        out.raw_depth.height //= 2
        out.raw_depth.data = out.raw_depth.data[: len(out.raw_depth.data) // 2]
    elif what == "encoding":
        out.raw_color.encoding = "yuv"
    elif what == "bomb":
        out.raw_color.width = out.raw_color.height = 10_000
    elif what == "pose":
        out.T_world_cam.pose.position.x = float("nan")
    elif what == "no depth":
        out.ClearField("raw_depth")
    else:
        del out.calibration.K[:]
    return out


@pytest.mark.parametrize(
    "what",
    ["corrupt jpeg", "empty image", "sizes", "encoding", "bomb", "pose", "no depth", "no camera"],
)
def test_a_broken_frame_is_counted_and_the_next_one_answered(what):
    house = House()
    house.look_for()
    good = house.frame()
    house.bus.publish(KEYFRAME, broken(what, good))
    house.bus.publish(FRAME, broken(what, good))
    assert house.observations == []
    assert house.count("keyframes_refused") == 1
    assert house.count("previews_refused") == 1
    house.bus.publish(KEYFRAME, good)
    assert len(house.observations) == 1
    assert house.health.state[0] == "ready"


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


class Leaking(GroundTruthDetector):
    """Fails where nobody expects it: after the detection, or when it is told what is sought."""

    def __init__(self, truth: SceneTruth) -> None:
        super().__init__(truth)
        self.fails = ""

    def refused(self, context):
        if self.fails == "refused":
            raise ZeroDivisionError("names")
        return super().refused(context)

    def accelerator_mb(self) -> float:
        if self.fails == "accelerator":
            raise RuntimeError("CUDA error: unspecified launch failure")
        return 0.0


def test_a_fault_after_the_detection_is_counted_and_said_and_the_next_frame_answered():
    truth = SceneTruth()
    leaking = Leaking(truth)
    house = House(leaking)
    house.truth = truth
    house.look_for()
    leaking.fails = "accelerator"
    house.bus.publish(KEYFRAME, house.frame(1))
    assert house.count("keyframes_failed") == 1
    assert house.health.state[0] == "degraded"
    assert "could not be answered: RuntimeError: CUDA error" in house.health.state[1]
    leaking.fails = ""
    house.bus.publish(KEYFRAME, house.frame(2))
    assert [o.frame.id.seq for o in house.observations] == [2]
    assert house.health.state == ("ready", "")


@pytest.mark.parametrize(("silent", "answered"), [(2, 1), (3, 0)])
def test_a_back_end_that_does_not_answer_is_asked_three_times(silent: int, answered: int):
    class Shy(GroundTruthDetector):
        asked = 0

        def detect(self, frame, context) -> Findings:
            self.asked += 1
            if self.asked <= silent:
                raise Unavailable("the world does not answer")
            return super().detect(frame, context)

    truth = SceneTruth()
    house = House(Shy(truth))
    house.truth = truth
    house.look_for()
    house.bus.publish(KEYFRAME, house.frame())
    assert len(house.observations) == answered
    assert house.count("detect_retries") == silent
    assert house.count("keyframes_failed") == 1 - answered
    assert ("the world does not answer" in house.health.state[1]) == (not answered)


def test_a_context_that_the_back_end_cannot_read_is_counted_and_said():
    truth = SceneTruth()
    leaking = Leaking(truth)
    house = House(leaking)
    house.truth = truth
    leaking.fails = "refused"
    house.look_for()
    assert house.count("contexts_refused") == 1
    assert "search context c1 is not sought: ZeroDivisionError: names" in house.health.state[1]
    leaking.fails = ""
    house.look_for()
    house.bus.publish(KEYFRAME, house.frame())
    assert house.health.state == ("ready", "")


def test_500_mutated_frames_kill_nothing():
    house = House()
    house.look_for()
    good = house.frame()
    data, rng = good.SerializeToString(), random.Random(0)
    handled = 0
    for _ in range(500):
        mutated = bytearray(data)
        for _ in range(rng.randint(1, 4)):
            end = 200 if rng.random() < 0.7 else len(mutated)
            mutated[rng.randrange(end)] = rng.randrange(256)
        try:
            message = pb.Frame.FromString(bytes(mutated))
        except Exception:  # does not parse: the bus drops it before the service
            continue
        house.service.on_keyframe(message)
        handled += 1
    answered = house.count("keyframes_answered")
    assert handled > 50
    failed = house.count("keyframes_refused") + house.count("keyframes_failed")
    assert answered + failed == handled
    house.bus.publish(KEYFRAME, good)
    assert house.count("keyframes_answered") == answered + 1
