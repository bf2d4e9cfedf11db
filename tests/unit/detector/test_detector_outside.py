"""A package from outside adds back ends by entry points; the service runs them like its own."""

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
from helios_detector.hosted import Hosted
from helios_detector.opening import open_detector, open_scorer
from helios_detector.settings import Settings

from tests.support import wait_until


@pytest.fixture
def outside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = outside_package.write(tmp_path / "outside")
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.delitem(sys.modules, "helios_outside", raising=False)
    return folder


def test_back_ends_are_found_by_name_and_given_argument_and_options(outside: Path):
    detector = open_detector("patient:0", DetectorOptions(threads=3))
    assert detector.name == "patient:0"
    assert vars(detector)["_threads"] == 3
    found = detector.detect(frame_of(), context_of("mug"))
    assert [d.class_name for d in found.detections] == ["mug"]
    assert open_scorer("half").score(frame_of(), (), {"pick": "a mug"}) == {"pick": 0.5}


def test_a_name_that_no_package_has_is_refused_with_those_that_are_there(outside: Path):
    with pytest.raises(InvalidInput, match=r"there is no detector 'oracle'.*one of .*patient"):
        open_detector("oracle", DetectorOptions())


def test_a_service_of_outside_back_ends_answers(outside: Path):
    hub, health, seen = MemoryHub(), Health(), []
    bus = MemoryBus(hub)
    bus.subscribe(OBSERVATION, seen.append)
    context = SearchContext("c", context_of("mug").classes, {"pick": "a mug"})
    bus.publish(CONTEXT, context_to_proto(context))
    service = Hosted(MemoryBus(hub), health, Settings(detector="patient:0", scorer="half:0.25"))
    wait_until(lambda: health.state[0] == "ready", 20, "ready")
    bus.publish(KEYFRAME, frame_to_proto(frame_of()))
    assert (seen[0].detector, seen[0].scorer) == ("patient:0", "half")
    assert dict(seen[0].layer_scores) == {"pick": 0.25}
    service.close()


def test_a_back_end_that_breaks_while_it_warms_up_is_said_and_not_tried_again(outside: Path):
    health = Health()
    service = Hosted(MemoryBus(MemoryHub()), health, Settings(detector="patient:-1"))
    wait_until(lambda: health.state[0] == "degraded", 20, "degraded")
    assert "patient:-1 or lexical cannot be loaded (ValueError: time runs" in health.state[1]
    service.close()
