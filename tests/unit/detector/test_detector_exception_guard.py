"""Faults in the detector's own threads are retried or reported in health, never lost."""

import threading
from typing import Any

import pytest
from detector_scene import SceneTruth, context_of
from helios_core import proto as pb
from helios_core.codec import context_to_proto, frame_to_proto
from helios_core.errors import Unavailable
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import CONTEXT, KEYFRAME, OBSERVATION, VOCABULARY, Method, status_topic
from helios_detector import detector_fleet as fleet_module
from helios_detector import robot_detector as hosted_module
from helios_detector.detector_fleet import Fleet, RobotSlot
from helios_detector.lexical_scorer import LexicalScorer
from helios_detector.model_set import Models
from helios_detector.model_usage import ModelUsage
from helios_detector.robot_assignment import Members
from helios_detector.robot_detector import RobotDetector
from helios_detector.settings import Settings
from helios_detector.simulation.ground_truth_detector import GroundTruthDetector

from tests.support import wait_until


def working_models() -> Models:
    return Models(GroundTruthDetector(SceneTruth()), LexicalScorer())


def test_an_unexpected_fault_at_the_start_of_a_detector_is_reported_in_health(
    monkeypatch: pytest.MonkeyPatch,
):
    def broken(*_: Any) -> Models:
        raise RuntimeError("torch is torn")

    monkeypatch.setattr(hosted_module, "load_models", broken)
    hub, health = MemoryHub(), Health()
    service = RobotDetector(MemoryBus(hub), health, Settings())
    wait_until(lambda: health.state[0] == "degraded", 60, "it is said")
    assert "the detector is not at work: RuntimeError: torch is torn" in health.state[1]
    with pytest.raises(Unavailable, match=r"is not ready: .*torch is torn"):
        MemoryBus(hub).call(VOCABULARY, pb.Empty(), 1.0)
    service.close()


class Moody(GroundTruthDetector):
    """Raises Unavailable for a context the first two times."""

    asked = 0

    def refused(self, context):
        self.asked += 1
        if self.asked < 3:
            raise Unavailable("the text model is away")
        return super().refused(context)


def test_a_hosted_detector_retries_a_context_that_its_back_end_could_not_take(
    monkeypatch: pytest.MonkeyPatch,
):
    hub, health = MemoryHub(), Health()
    models = Models(Moody(SceneTruth()), LexicalScorer())
    monkeypatch.setattr(hosted_module, "load_models", lambda *_: models)
    monkeypatch.setattr(hosted_module, "CHECK_S", 0.01)
    monkeypatch.setattr("helios_detector.service.CONTEXT_RETRY_S", 0.0)
    MemoryBus(hub).publish(CONTEXT, context_to_proto(context_of("mug")))
    service = RobotDetector(MemoryBus(hub), health, Settings())
    wait_until(lambda: health.state == ("ready", ""), 60, "the context is sought")
    assert health.metrics()["context_retries"] == 2
    service.close()


def test_a_fleet_detector_retries_a_context_and_then_answers_the_held_keyframe(
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.setattr("helios_detector.service.CONTEXT_RETRY_S", 0.0)
    hub, truth, members = MemoryHub(), SceneTruth(), Members("me", ["ada"])
    bus, answers = MemoryBus(hub, "ada"), []
    bus.subscribe(OBSERVATION, answers.append)
    slot = RobotSlot("ada", MemoryBus(hub, "ada"), members, threading.Lock(), Health())
    try:
        members.change(members.me, True, -10.0)
        slot.begin(Models(Moody(truth), LexicalScorer()), ModelUsage())
        bus.publish(CONTEXT, context_to_proto(context_of("mug")))
        bus.publish(KEYFRAME, frame_to_proto(truth.frame()))
        wait_until(lambda: len(answers) == 1, 60, "the keyframe is answered")
    finally:
        slot.stop()
        slot.finish(1.0)


def test_an_unexpected_fault_at_the_start_of_a_fleet_is_reported_to_every_robot(
    monkeypatch: pytest.MonkeyPatch,
):
    hub, health = MemoryHub(), Health()
    reported = {"ada": pb.ServiceStatus(), "bob": pb.ServiceStatus()}
    for robot, status in reported.items():
        MemoryBus(hub, robot).subscribe(status_topic("detector"), status.CopyFrom)

    class FaultyBus(MemoryBus):
        """Raises when somebody subscribes to keyframes."""

        def subscribe_in_place(self, topic: Any, handler: Any) -> Any:
            if topic is KEYFRAME:
                raise RuntimeError("the session is torn")
            return super().subscribe_in_place(topic, handler)

    def connect(_: Fleet, robot: str) -> MemoryBus:
        return (FaultyBus if robot == "bob" else MemoryBus)(hub, robot)

    monkeypatch.setattr(Fleet, "_connect", connect)
    monkeypatch.setattr(fleet_module, "load_models", lambda *_: working_models())
    settings = Settings(robots="ada,bob", detector="onnx:x")
    fleet = Fleet(MemoryBus(hub, "_detectors"), health, settings)
    try:
        wait_until(lambda: health.state[0] == "degraded", 60, "it is said")
        assert "cannot be started: RuntimeError: the session is torn" in health.state[1]
        wait_until(
            lambda: all(s.state == "degraded" for s in reported.values()), 60, "every robot is told"
        )
        assert all("the session is torn" in s.reason for s in reported.values())
        MemoryBus(hub, "ada").publish(CONTEXT, context_to_proto(context_of("mug")))
        with pytest.raises(Unavailable, match=r"is not ready: .*torn"):
            MemoryBus(hub, "ada").call(VOCABULARY, pb.Empty(), 1.0)
    finally:
        fleet.close()


def test_a_robot_slot_survives_an_unexpected_fault_and_reports_it_meanwhile():
    class FaultyBus(MemoryBus):
        torn = True

        def serve(self, method: Method[Any, Any], handler: Any) -> Any:
            if self.torn:
                raise RuntimeError("the session is torn")
            return super().serve(method, handler)

    hub, loading, members = MemoryHub(), Health(), Members("me", ["ada"])
    bus, reported = FaultyBus(hub, "ada"), pb.ServiceStatus()
    MemoryBus(hub, "ada").subscribe(status_topic("detector"), reported.CopyFrom)
    slot = RobotSlot("ada", bus, members, threading.Lock(), loading)
    try:
        wait_until(lambda: "RuntimeError: the session is torn" in reported.reason, 60, "it is told")
        assert reported.state == "degraded"
        bus.torn = False
        slot.begin(working_models(), ModelUsage())
        members.change(members.me, True, -10.0)
        wait_until(lambda: reported.state == "ready", 60, "it works")
    finally:
        slot.stop()
        slot.finish(1.0)
