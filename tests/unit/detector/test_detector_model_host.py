"""From settings to a service: ready only when the models work; until then it reports why not."""

import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import tiny_models
from detector_scene import SceneTruth, context_of, frame_of
from helios_core import proto as pb
from helios_core.codec import context_to_proto, frame_to_proto
from helios_core.errors import HeliosError, InvalidInput, Unavailable
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import CONTEXT, KEYFRAME, OBSERVATION, VOCABULARY
from helios_core.types import Role, SearchClass, SearchContext
from helios_detector import model_set as models_module
from helios_detector.backend import DetectorBackend, DetectorOptions, Findings
from helios_detector.lexical_scorer import LexicalScorer, furniture_names
from helios_detector.model_set import Models, landmarks_of, open_models
from helios_detector.robot_detector import RobotDetector
from helios_detector.service import DetectorService
from helios_detector.settings import Settings
from helios_detector.simulation.ground_truth_detector import GroundTruthDetector
from helios_detector.vocabulary_matching import fixed_wanted

from tests.support import wait_until


def settings(**kwargs: Any) -> Settings:
    values: dict[str, Any] = {"retry_s": 0.01} | kwargs
    return Settings(**values)


@pytest.fixture(scope="module")
def owl(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny_models.write("owlv2", tmp_path_factory.mktemp("owl"))


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny_models.write("clip", tmp_path_factory.mktemp("clip"))


def test_a_service_with_models_from_folders_becomes_ready_and_answers(owl: Path, clip: Path):
    hub, health, seen = MemoryHub(), Health(), []
    bus = MemoryBus(hub)
    bus.subscribe(OBSERVATION, seen.append)
    bus.publish(
        CONTEXT,
        context_to_proto(
            SearchContext("c", context_of("mug", threshold=0.01).classes, {"pick": "a mug"})
        ),
    )
    service = RobotDetector(
        MemoryBus(hub),
        health,
        settings(detector=f"transformers:{owl}", scorer=f"transformers:{clip}", device="cpu"),
    )
    wait_until(lambda: health.state[0] == "ready", 60, "ready")
    bus.publish(KEYFRAME, frame_to_proto(frame_of()))
    assert len(seen) == 1
    assert seen[0].detections
    assert seen[0].detector == f"transformers:{owl}"
    assert seen[0].image_embedding.rows == 1
    metrics = health.metrics()
    assert metrics["memory_mb"] > 50
    assert metrics["detect_ms_median"] > 0
    assert metrics["score_ms_median"] > 0
    service.close()


def test_the_service_waits_for_a_missing_model_and_reports_the_reason(owl: Path, tmp_path: Path):
    hub, health, link = MemoryHub(), Health(), tmp_path / "model"
    service = RobotDetector(MemoryBus(hub), health, settings(detector=f"transformers:{link}"))
    wait_until(lambda: "is not there; put config.json" in health.state[1], 60, "the reason")
    assert health.state[0] == "waiting"
    with pytest.raises(Unavailable, match=r"the detector is not ready: .*is not there; put c"):
        MemoryBus(hub).call(VOCABULARY, pb.Empty(), 1.0)
    link.symlink_to(owl)
    wait_until(lambda: health.state[0] == "ready", 60, "ready")
    assert MemoryBus(hub).call(VOCABULARY, pb.Empty(), 1.0).open
    service.close()


def test_a_wrong_setting_is_reported_as_degraded_and_not_retried():
    health = Health()
    service = RobotDetector(MemoryBus(MemoryHub()), health, settings(scorer="oracle"))
    wait_until(lambda: health.state[0] == "degraded", 60, "degraded")
    assert "there is no scorer 'oracle'" in health.state[1]
    service.close()


def test_a_model_that_fails_in_its_warm_up_is_retried_and_never_ready(
    monkeypatch: pytest.MonkeyPatch,
):
    class Starved(GroundTruthDetector):
        def warm_up(self) -> None:
            raise Unavailable("there is too little memory for a/b; use a smaller model")

    truth, health, opened = SceneTruth(), Health(), []

    def open_starved(s: Settings, source) -> Models:
        opened.append(s)
        return Models(Starved(truth), LexicalScorer(), None)

    monkeypatch.setattr(models_module, "open_models", open_starved)
    service = RobotDetector(MemoryBus(MemoryHub()), health, settings())
    wait_until(lambda: len(opened) > 2, 60, "three tries")
    wait_until(lambda: "too little memory for a/b" in health.state[1], 60, "the reason")
    assert health.state[0] == "waiting"
    service.close()


def test_the_models_of_a_failed_attempt_are_closed(monkeypatch: pytest.MonkeyPatch):
    steps: list[str] = []

    class Recorded(GroundTruthDetector):
        def close(self) -> None:
            steps.append("detector closed")
            raise RuntimeError("it was never warm")

    class Missing(LexicalScorer):
        def warm_up(self) -> None:
            steps.append("scorer fails")
            if steps.count("scorer fails") < 3:
                raise Unavailable("the model is not there")
            raise InvalidInput("the model is of no kind")

        def close(self) -> None:
            steps.append("scorer closed")

    monkeypatch.setattr(models_module, "open_scorer", lambda *_: Missing())
    monkeypatch.setattr(models_module, "open_detector", lambda *_: Recorded(SceneTruth()))
    health = Health()
    assert models_module.load_models(settings(), None, health, threading.Event()) is None
    assert steps == ["scorer fails", "detector closed", "scorer closed"] * 3
    assert health.state == ("degraded", "the model is of no kind")
    steps.clear()
    with pytest.raises(InvalidInput, match="there is no depth model 'x'"):
        open_models(settings(depth="x"), None)
    monkeypatch.undo()
    monkeypatch.setattr(models_module, "open_scorer", lambda *_: Missing())
    with pytest.raises(InvalidInput, match="there is no detector 'x'"):
        open_models(settings(detector="x"), None)
    assert steps == ["detector closed", "scorer closed", "scorer closed"]


class Counting(GroundTruthDetector):
    unloads = 0

    def unload(self) -> None:
        self.unloads += 1


def test_models_are_unloaded_once_when_idle_and_never_while_they_work(
    monkeypatch: pytest.MonkeyPatch,
):
    truth, health, hub = SceneTruth(), Health(), MemoryHub()
    detector, clock = Counting(truth), [0.0]
    monkeypatch.setattr("helios_detector.model_usage.time.monotonic", lambda: clock[0])
    service = DetectorService(MemoryBus(hub), detector, LexicalScorer(), health)
    bus = MemoryBus(hub)
    bus.publish(CONTEXT, context_to_proto(context_of("mug")))
    clock[0] = 9.0
    service.unload_if_idle(10.0)
    assert detector.unloads == 0
    clock[0] = 11.0
    service.unload_if_idle(10.0)
    service.unload_if_idle(10.0)
    assert detector.unloads == 1
    bus.publish(KEYFRAME, frame_to_proto(truth.frame()))
    service.unload_if_idle(10.0)
    assert detector.unloads == 1  # it has just worked
    clock[0] = 30.0
    with service._usage.work():
        service.unload_if_idle(10.0)
    assert detector.unloads == 1
    assert health.metrics()["unloads"] == 1


class Slow(DetectorBackend):
    """Blocks in `detect` until `go` is set."""

    name = "slow"

    def __init__(self) -> None:
        self.begun, self.go = threading.Event(), threading.Event()
        self.frames: list[int] = []

    def vocabulary(self) -> None:
        return None

    def refused(self, context):
        return {}

    def detect(self, frame, context) -> Findings:
        self.frames.append(frame.id.seq)
        self.begun.set()
        assert self.go.wait(10)
        return Findings((), ())

    def warm_up(self) -> None:
        """Needs no warm-up."""

    def close(self) -> None:
        """Holds no resources."""


def test_a_busy_detector_skips_stream_frames_and_answers_keyframes():
    detector, health, truth = Slow(), Health(), SceneTruth()
    service = DetectorService(MemoryBus(MemoryHub()), detector, LexicalScorer(), health)
    service.on_context(context_to_proto(context_of("mug")))
    first = threading.Thread(
        target=service.on_frame, args=(frame_to_proto(truth.frame(seq=1)),), daemon=True
    )
    first.start()
    assert detector.begun.wait(10)
    for seq in (2, 3):
        service.on_frame(frame_to_proto(truth.frame(seq=seq)))
    keyframe = threading.Thread(
        target=service.on_keyframe, args=(frame_to_proto(truth.frame(seq=4)),), daemon=True
    )
    keyframe.start()
    detector.go.set()
    first.join(10)
    keyframe.join(10)
    assert detector.frames == [1, 4]
    assert health.metrics()["previews_skipped"] == 2
    assert health.metrics()["keyframes_answered"] == 1


def test_auto_landmarks_are_furniture_names_for_the_lexical_scorer():
    assert landmarks_of("auto", LexicalScorer()) == furniture_names()
    assert landmarks_of("none", LexicalScorer()) == ()
    assert landmarks_of("sink, bed ,", LexicalScorer()) == ("sink", "bed")


def test_open_models_applies_landmarks_and_refuses_an_unknown_depth_model(owl: Path):
    models = open_models(
        settings(detector=f"transformers:{owl}", device="cpu", landmarks="sink"), SceneTruth()
    )
    findings = models.detector.detect(frame_of(), context_of("mug", threshold=0.01))
    assert {s.class_name for s in findings.seen} <= {"mug", "sink"}
    assert models.depth is None
    with pytest.raises(InvalidInput, match="there is no depth model 'x'"):
        open_models(settings(detector=f"transformers:{owl}", depth="x"), SceneTruth())


def test_similar_names_serve_classes_outside_a_fixed_vocabulary_if_enabled():
    from helios_detector.coco_classes import COCO_NAMES
    from helios_detector.name_similarity import NearestName

    classes = (
        SearchClass("settee bench", Role.WATCH, 0.3),
        SearchClass("cup", Role.OBJECT, 0.3),
        SearchClass("zeitgeist", Role.OBJECT, 0.3),
    )
    context = SearchContext("c", classes)
    wanted, refused = fixed_wanted(context, COCO_NAMES)
    assert [w.name for w in wanted] == ["cup"]
    assert refused.keys() == {"settee bench", "zeitgeist"}
    wanted, refused = fixed_wanted(context, COCO_NAMES, NearestName(COCO_NAMES))
    assert {w.name: set(w.names) for w in wanted}["settee bench"] == {"bench"}
    assert refused.keys() == {"zeitgeist"}


def test_every_model_setting_reaches_its_model(monkeypatch: pytest.MonkeyPatch):
    truth, caught = SceneTruth(), {}

    def opener(what: str, made: Any) -> Any:
        return lambda *given: caught.update({what: given}) or made

    monkeypatch.setattr(models_module, "open_scorer", opener("scorer", LexicalScorer()))
    monkeypatch.setattr(models_module, "open_detector", opener("it", GroundTruthDetector(truth)))
    monkeypatch.setattr(models_module, "open_depth", opener("depth", None))
    open_models(
        settings(
            detector="a", scorer="b", depth="c", depth_focal="own", threads=3, noise="x",
            noise_seed=4, noise_level=0.5, noise_correlation=0.25, device="cuda:1",
            precision="float16", masks="m", score_head="itm", by_similarity=True, landmarks="sink",
        ),
        truth,
    )  # fmt: skip
    options = DetectorOptions(
        truth=truth, threads=3, noise="x", noise_seed=4, noise_level=0.5, noise_correlation=0.25,
        device="cuda:1", precision="float16", masks="m", by_similarity=True, score_head="itm",
        landmarks=("sink",),
    )  # fmt: skip
    assert caught["it"] == ("a", options)
    assert caught["depth"] == ("c", options, "own")
    assert caught["scorer"] == ("b", replace(options, landmarks=()))


def test_a_hosted_model_is_unloaded_when_idle_and_loads_again_for_a_keyframe(
    owl: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("helios_detector.robot_detector.CHECK_S", 0.02)
    hub, health, seen = MemoryHub(), Health(), []
    bus = MemoryBus(hub)
    bus.subscribe(OBSERVATION, seen.append)
    bus.publish(CONTEXT, context_to_proto(context_of("mug", threshold=0.01)))
    service = RobotDetector(
        MemoryBus(hub),
        health,
        settings(detector=f"transformers:{owl}", device="cpu", unload_after_s=0.05),
    )
    wait_until(lambda: health.metrics().get("unloads") == 1, 60, "unloaded")
    bus.publish(KEYFRAME, frame_to_proto(frame_of()))
    assert len(seen) == 1
    assert seen[0].detections
    wait_until(lambda: health.metrics().get("unloads") == 2, 60, "unloaded again")
    service.close()


def test_pauses_between_load_attempts_double_up_to_one_minute(monkeypatch: pytest.MonkeyPatch):
    pauses: list[float] = []

    class Ending(threading.Event):
        def wait(self, timeout: float | None = None) -> bool:
            assert timeout is not None
            pauses.append(timeout)
            if len(pauses) == 8:
                self.set()
            return self.is_set()

    def nothing_there(s: Settings, truth) -> Models:
        raise Unavailable("the model is not there")

    monkeypatch.setattr(models_module, "open_models", nothing_there)
    assert models_module.load_models(settings(retry_s=2.0), None, Health(), Ending()) is None
    assert pauses == [2, 4, 8, 16, 32, 60, 60, 60]


def test_the_vocabulary_reply_of_an_open_detector_says_open(owl: Path):
    hub = MemoryHub()
    models = open_models(settings(detector=f"transformers:{owl}", device="cpu"), SceneTruth())
    DetectorService(MemoryBus(hub), models.detector, models.scorer, Health())
    reply = MemoryBus(hub).call(VOCABULARY, pb.Empty(), 1.0)
    assert reply.open
    assert reply.detector == f"transformers:{owl}"


def test_a_fault_inside_a_scorer_is_counted_and_reported():
    class Broken(LexicalScorer):
        name = "broken"

        def score(self, frame, seen, prompts):
            raise KeyError("x")

    truth, health, hub = SceneTruth(), Health(), MemoryHub()
    service = DetectorService(MemoryBus(hub), GroundTruthDetector(truth), Broken(), health)
    service.on_context(context_to_proto(context_of("mug")))
    service.on_keyframe(frame_to_proto(truth.frame()))
    assert health.metrics()["keyframes_failed"] == 1
    assert "the scorer broken failed in score() (KeyError" in health.state[1]
    assert issubclass(Unavailable, HeliosError)
