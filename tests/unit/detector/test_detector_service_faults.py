"""Broken frames and faults of a back end: counted, said, and outlived."""

import copy
import random
import time
from typing import Any

import pytest
from detector_house import Faulty, House
from detector_scene import SceneTruth, context_of
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.errors import Unavailable
from helios_core.topics import FRAME, KEYFRAME, OBSERVATION, PREVIEW, Topic
from helios_detector.backend import Findings
from helios_detector.simulation.ground_truth_detector import GroundTruthDetector


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


class Leaking(GroundTruthDetector):
    """Fails where nobody expects it: after the detection."""

    fails = False

    def accelerator_mb(self) -> float:
        if self.fails:
            raise RuntimeError("CUDA error: unspecified launch failure")
        return 0.0


def test_a_fault_after_the_detection_is_counted_and_said_and_the_next_frame_answered():
    truth = SceneTruth()
    leaking = Leaking(truth)
    house = House(leaking)
    house.truth = truth
    house.look_for()
    leaking.fails = True
    house.bus.publish(KEYFRAME, house.frame(1))
    assert house.count("keyframes_failed") == 1
    assert house.health.state[0] == "degraded"
    assert "could not be answered: RuntimeError: CUDA error" in house.health.state[1]
    leaking.fails = False
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


def failing_at(topic: Topic[Any], bus: Bus, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let what the bus publishes there fail."""
    publish = bus.publish

    def failing(to: Topic[Any], message: Any) -> None:
        if to is topic:
            raise Unavailable("the session is closed")
        publish(to, message)

    monkeypatch.setattr(bus, "publish", failing)


def test_an_observation_that_cannot_be_sent_counts_as_failed_alone(monkeypatch):
    house = House()
    house.look_for()
    failing_at(OBSERVATION, house.service._bus, monkeypatch)
    house.bus.publish(KEYFRAME, house.frame())
    assert (house.count("keyframes_answered"), house.count("keyframes_failed")) == (0, 1)
    assert "could not be answered: the session is closed" in house.health.state[1]


def test_a_preview_that_cannot_be_sent_leaves_the_keyframe_answered(monkeypatch):
    house = House()
    house.look_for()
    failing_at(PREVIEW, house.service._bus, monkeypatch)
    house.bus.publish(KEYFRAME, house.frame())
    assert len(house.observations) == 1
    assert (house.count("keyframes_answered"), house.count("keyframes_failed")) == (1, 0)
    assert (house.count("previews"), house.count("previews_refused")) == (0, 1)
    assert house.health.state == ("ready", "")


def test_models_that_cannot_be_unloaded_are_said_and_go_on_working(monkeypatch):
    house = House()
    house.look_for()

    def stuck() -> None:
        raise RuntimeError("device lost")

    monkeypatch.setattr(house.service._models.detector, "unload", stuck)
    clock = time.monotonic() + 60
    monkeypatch.setattr("helios_detector.model_usage.time.monotonic", lambda: clock)
    house.service.unload_if_idle(10.0)
    assert house.health.state[0] == "degraded"
    assert "the models cannot be unloaded: RuntimeError: device lost" in house.health.state[1]
    house.bus.publish(KEYFRAME, house.frame())
    assert len(house.observations) == 1


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
