"""Error models in the map: a file changes beliefs, a bad one is named and changes nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helios_core import proto as pb
from helios_core.detector_error_model import (
    DetectorErrorModel,
    Estimate,
    FitSource,
    NameErrorEstimates,
    to_text,
)
from helios_core.errors import InvalidInput
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_objectmap.error_model import NO_MODEL, ErrorModelInUse, name_errors, shipped_models
from helios_objectmap.instances.clustering import distinct, voxel_centers_m, voxel_keys
from helios_objectmap.instances.name_sightings import BROAD_PRIOR, VOXEL_M
from helios_objectmap.object_map import ObjectMap
from helios_objectmap.service import ObjectMapService
from objectmap_scene import SETTINGS

COMPARED = SETTINGS.model_copy(update={"look_alikes": "compared"})
DETECTOR = "onnx:a.onnx"


@pytest.fixture
def file(tmp_path: Path) -> str:
    values = {"hit": 0.7, "mistaken": 0.3, "sides_correlate": 0.5, "rival": 0.6}
    names = {k: Estimate(value=v, low=v, high=v) for k, v in values.items()}
    source = FitSource(
        what="a test",
        truth="truth",
        views=1,
        things=1,
        things_with_truth=1,
        sides=1.0,
        made_with="0",
    )
    model = DetectorErrorModel(detector=DETECTOR, source=source, names=NameErrorEstimates(**names))
    path = tmp_path / "model.json"
    path.write_text(to_text(model))
    return str(path)


def using(error_model: str):
    return COMPARED.model_copy(update={"error_model": error_model})


def test_a_map_takes_the_numbers_of_its_file(file: str) -> None:
    errors = name_errors(file)
    assert (errors.hit, errors.mistaken, errors.sides_correlate, errors.rival) == (
        0.7,
        0.3,
        0.5,
        0.6,
    )
    assert ObjectMap(using(file))._name_errors == errors
    assert ObjectMap(COMPARED)._name_errors == BROAD_PRIOR


@pytest.mark.parametrize("name", shipped_models())
def test_every_shipped_model_can_be_used(name: str) -> None:
    assert name_errors(name) != BROAD_PRIOR


def test_a_map_of_its_own_refuses_a_missing_file() -> None:
    with pytest.raises(InvalidInput, match="shipped are"):
        ObjectMap(using("missing.json"))


def test_health_says_which_model_is_used(file: str) -> None:
    assert ErrorModelInUse(COMPARED).said == NO_MODEL
    assert ErrorModelInUse(using(file)).said == f"error model of {DETECTOR}"
    assert ErrorModelInUse(SETTINGS).said == ""  # names are not compared at all


def test_health_says_when_another_detector_gives_the_detections(file: str) -> None:
    used = ErrorModelInUse(using(file))
    assert not used.hear(DETECTOR)
    assert used.hear("onnx:b.onnx")
    assert not used.hear("onnx:b.onnx")
    assert used.said == f"error model of {DETECTOR}, but onnx:b.onnx gives the detections"
    assert used.hear(DETECTOR)


def test_a_damaged_file_does_not_end_the_service(tmp_path: Path) -> None:
    path = tmp_path / "damaged.json"
    path.write_text("{")
    health = Health()
    service = ObjectMapService(MemoryBus(MemoryHub()), using(str(path)), health)
    service.warm_up()
    state, said = health.state
    assert state == "ready"
    assert "damaged.json is no error model" in said
    assert "broad prior" in said
    assert not service.objects(pb.ObjectsRequest()).objects
    service.close()


def test_the_middle_of_a_voxel_is_in_it() -> None:
    points = np.random.default_rng(0).uniform(-30, 30, (500, 3)).astype(np.float32)
    keys = distinct(voxel_keys(points, VOXEL_M))[0]
    middles = voxel_centers_m(keys, VOXEL_M)
    assert (voxel_keys(middles.astype(np.float32), VOXEL_M) == keys).all()
