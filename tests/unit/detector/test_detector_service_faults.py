"""The service counts and reports broken frames and back-end faults, and keeps running."""

import copy
import random
import time
from typing import Any

import pytest
from detector_rig import Faulty, Rig
from detector_scene import SceneTruth, context_of
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.errors import Unavailable
from helios_core.topics import FRAME, KEYFRAME, OBSERVATION, PREVIEW, Topic
from helios_detector.backend import Findings
from helios_detector.simulation.ground_truth_detector import GroundTruthDetector


def test_a_fault_of_the_back_end_is_counted_and_reported():
    rig = Rig(Faulty())
    rig.look_for(context_of("cup"))
    rig.bus.publish(KEYFRAME, rig.frame())
    assert rig.observations == []
    assert rig.count("keyframes_failed") == 1
    assert rig.health.state[0] == "degraded"
    assert "ZeroDivisionError" in rig.health.state[1]


def test_keyframes_fail_with_the_reason_until_the_ground_truth_is_available_again():
    rig = Rig()
    rig.look_for()
    first, second = rig.frame(1), rig.frame(2)
    rig.truth.down = True
    rig.bus.publish(KEYFRAME, first)
    assert rig.health.state == (
        "degraded",
        "the last keyframe could not be answered: the world is away",
    )
    rig.truth.down = False
    rig.bus.publish(KEYFRAME, second)
    assert [o.frame.id.seq for o in rig.observations] == [2]
    assert rig.health.state[0] == "ready"


def broken(what: str, good: pb.Frame) -> pb.Frame:
    """A copy of the frame with one fault."""
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
def test_a_broken_frame_is_counted_and_the_next_frame_is_answered(what):
    rig = Rig()
    rig.look_for()
    good = rig.frame()
    rig.bus.publish(KEYFRAME, broken(what, good))
    rig.bus.publish(FRAME, broken(what, good))
    assert rig.observations == []
    assert rig.count("keyframes_refused") == 1
    assert rig.count("previews_refused") == 1
    rig.bus.publish(KEYFRAME, good)
    assert len(rig.observations) == 1
    assert rig.health.state[0] == "ready"


def test_refused_previews_are_counted_and_logged_once(caplog: pytest.LogCaptureFixture):
    rig = Rig()
    wrong = broken("pose", rig.frame())
    for _ in range(20):
        rig.bus.publish(FRAME, wrong)
    assert rig.count("previews_refused") == 20
    assert caplog.text.count("previews_refused: frame 1: ") == 1


class Leaking(GroundTruthDetector):
    """Raises in `accelerator_mb`, after the detection, if `fails` is set."""

    fails = False

    def accelerator_mb(self) -> float:
        if self.fails:
            raise RuntimeError("CUDA error: unspecified launch failure")
        return 0.0


def test_a_fault_after_the_detection_is_reported_and_the_next_frame_is_answered():
    truth = SceneTruth()
    leaking = Leaking(truth)
    rig = Rig(leaking)
    rig.truth = truth
    rig.look_for()
    leaking.fails = True
    rig.bus.publish(KEYFRAME, rig.frame(1))
    assert rig.count("keyframes_failed") == 1
    assert rig.health.state[0] == "degraded"
    assert "could not be answered: RuntimeError: CUDA error" in rig.health.state[1]
    leaking.fails = False
    rig.bus.publish(KEYFRAME, rig.frame(2))
    assert [o.frame.id.seq for o in rig.observations] == [2]
    assert rig.health.state == ("ready", "")


@pytest.mark.parametrize(("silent", "answered"), [(2, 1), (3, 0)])
def test_an_unavailable_back_end_is_called_up_to_three_times(silent: int, answered: int):
    class Shy(GroundTruthDetector):
        asked = 0

        def detect(self, frame, context) -> Findings:
            self.asked += 1
            if self.asked <= silent:
                raise Unavailable("the world does not answer")
            return super().detect(frame, context)

    truth = SceneTruth()
    rig = Rig(Shy(truth))
    rig.truth = truth
    rig.look_for()
    rig.bus.publish(KEYFRAME, rig.frame())
    assert len(rig.observations) == answered
    assert rig.count("detect_retries") == silent
    assert rig.count("keyframes_failed") == 1 - answered
    assert ("the world does not answer" in rig.health.state[1]) == (not answered)


def failing_at(topic: Topic[Any], bus: Bus, monkeypatch: pytest.MonkeyPatch) -> None:
    """Makes `publish` of the bus fail on this topic."""
    publish = bus.publish

    def failing(to: Topic[Any], message: Any) -> None:
        if to is topic:
            raise Unavailable("the session is closed")
        publish(to, message)

    monkeypatch.setattr(bus, "publish", failing)


def test_an_observation_that_cannot_be_sent_counts_as_failed_and_not_as_answered(monkeypatch):
    rig = Rig()
    rig.look_for()
    failing_at(OBSERVATION, rig.service._bus, monkeypatch)
    rig.bus.publish(KEYFRAME, rig.frame())
    assert (rig.count("keyframes_answered"), rig.count("keyframes_failed")) == (0, 1)
    assert "could not be answered: the session is closed" in rig.health.state[1]


def test_a_preview_that_cannot_be_sent_leaves_the_keyframe_answered(monkeypatch):
    rig = Rig()
    rig.look_for()
    failing_at(PREVIEW, rig.service._bus, monkeypatch)
    rig.bus.publish(KEYFRAME, rig.frame())
    assert len(rig.observations) == 1
    assert (rig.count("keyframes_answered"), rig.count("keyframes_failed")) == (1, 0)
    assert (rig.count("previews"), rig.count("previews_refused")) == (0, 1)
    assert rig.health.state == ("ready", "")


def test_models_that_cannot_be_unloaded_are_reported_and_keep_working(monkeypatch):
    rig = Rig()
    rig.look_for()

    def stuck() -> None:
        raise RuntimeError("device lost")

    monkeypatch.setattr(rig.service._models.detector, "unload", stuck)
    clock = time.monotonic() + 60
    monkeypatch.setattr("helios_detector.model_usage.time.monotonic", lambda: clock)
    rig.service.unload_if_idle(10.0)
    assert rig.health.state[0] == "degraded"
    assert "the models cannot be unloaded: RuntimeError: device lost" in rig.health.state[1]
    rig.bus.publish(KEYFRAME, rig.frame())
    assert len(rig.observations) == 1


def test_the_service_survives_500_mutated_frames():
    rig = Rig()
    rig.look_for()
    good = rig.frame()
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
        rig.service.on_keyframe(message)
        handled += 1
    answered = rig.count("keyframes_answered")
    assert handled > 50
    failed = rig.count("keyframes_refused") + rig.count("keyframes_failed")
    assert answered + failed == handled
    rig.bus.publish(KEYFRAME, good)
    assert rig.count("keyframes_answered") == answered + 1
