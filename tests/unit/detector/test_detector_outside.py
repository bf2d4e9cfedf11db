"""An external package adds back ends by entry points; the service runs them like its own."""

import sys
from pathlib import Path

import outside_package
import pytest
from detector_scene import context_of, frame_of
from helios_core.codec import context_to_proto, frame_to_proto
from helios_core.errors import InvalidInput
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import CONTEXT, KEYFRAME, OBSERVATION
from helios_core.types import SearchContext
from helios_detector.backend import DetectorOptions
from helios_detector.model_loading import check_plugins, open_detector, open_scorer
from helios_detector.robot_detector import RobotDetector
from helios_detector.settings import Settings

from tests.support import wait_until


@pytest.fixture
def outside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = outside_package.write(tmp_path / "outside")
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.delitem(sys.modules, "helios_outside", raising=False)
    return folder


def test_external_back_ends_are_found_by_name_and_get_argument_and_options(outside: Path):
    detector = open_detector("patient:0", DetectorOptions(threads=3))
    assert detector.name == "patient:0"
    assert vars(detector)["_threads"] == 3
    found = detector.detect(frame_of(), context_of("mug"))
    assert [d.class_name for d in found.detections] == ["mug"]
    assert open_scorer("half").score(frame_of(), (), {"pick": "a mug"}) == {"pick": 0.5}


def test_an_unknown_back_end_name_is_refused_with_the_available_names(outside: Path):
    with pytest.raises(InvalidInput, match=r"there is no detector 'oracle'.*one of .*patient"):
        open_detector("oracle", DetectorOptions())


def test_a_service_with_external_back_ends_answers_keyframes(outside: Path):
    hub, health, seen = MemoryHub(), Health(), []
    bus = MemoryBus(hub)
    bus.subscribe(OBSERVATION, seen.append)
    context = SearchContext("c", context_of("mug").classes, {"pick": "a mug"})
    bus.publish(CONTEXT, context_to_proto(context))
    service = RobotDetector(
        MemoryBus(hub), health, Settings(detector="patient:0", scorer="half:0.25")
    )
    wait_until(lambda: health.state[0] == "ready", 60, "ready")
    bus.publish(KEYFRAME, frame_to_proto(frame_of()))
    assert (seen[0].detector, seen[0].scorer) == ("patient:0", "half")
    assert dict(seen[0].layer_scores) == {"pick": 0.25}
    service.close()


def test_an_unexpected_fault_in_the_warm_up_is_reported_and_not_retried(outside: Path):
    health = Health()
    service = RobotDetector(MemoryBus(MemoryHub()), health, Settings(detector="patient:-1"))
    wait_until(lambda: health.state[0] == "degraded", 60, "degraded")
    assert "patient:-1 or lexical cannot be loaded (ValueError: time runs" in health.state[1]
    service.close()


def test_a_plug_in_is_opened_by_its_module_and_class(outside: Path):
    detector = open_detector("helios_outside:Patient:0", DetectorOptions())
    assert detector.name == "patient:0"
    scorer = open_scorer("helios_outside:Half:0.75")
    assert scorer.score(frame_of(), (), {"pick": "a mug"}) == {"pick": 0.75}
    check_plugins("helios_outside:Patient", "half")
    check_plugins("onnx:x", "lexical")


@pytest.mark.parametrize(
    ("detector", "scorer", "said"),
    [
        ("helios_outside:Half", "lexical", "is the class Half; wanted .*DetectorBackend"),
        ("paint", "helios_outside:Patient", "is the class Patient; wanted .*ScorerBackend"),
        ("helios_outside:Bare", "lexical", "lacks the methods close, detect, refused, vocabulary"),
        ("helios_outside:np", "lexical", "is the module numpy; wanted a class"),
        ("paint", "helios_outside:Hlaf", "did you mean Half"),
    ],
)
def test_a_plug_in_of_the_wrong_type_is_refused_before_the_process_serves(
    outside: Path, detector: str, scorer: str, said: str
):
    source = outside / "helios_outside.py"
    source.write_text(source.read_text() + "\n\nclass Bare(DetectorBackend):\n    name = 'bare'\n")
    with pytest.raises(InvalidInput, match=said):
        check_plugins(detector, scorer)


def test_a_plug_in_without_a_name_is_refused(outside: Path):
    source = outside / "helios_outside.py"
    source.write_text(source.read_text() + "\n\nclass Nameless(Half):\n    name = ''\n")
    with pytest.raises(InvalidInput, match="give the class a name"):
        open_scorer("helios_outside:Nameless")
