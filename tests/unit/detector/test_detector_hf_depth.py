"""Depth from colour with tiny models of random weights: metres, focal lengths, service calls."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import tiny_models
import torch
from detector_scene import CAMERA, SceneTruth, frame_of
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from helios_bridge.depth_estimation import with_estimated_depth
from helios_core import proto as pb
from helios_core.codec import frame_from_proto, frame_to_proto
from helios_core.errors import HeliosError, InvalidInput, Unavailable
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import ESTIMATE_DEPTH
from helios_detector.backend import DetectorOptions
from helios_detector.hf.depth import HfDepth
from helios_detector.hf.model_runtime import Placement, need_library, picture
from helios_detector.lexical_scorer import LexicalScorer
from helios_detector.model_loading import open_depth
from helios_detector.service import DetectorService
from helios_detector.simulation.ground_truth_detector import GroundTruthDetector

hf = need_library()
CPU = Placement("cpu", "float32")
COLOR = np.random.default_rng(0).integers(0, 256, (200, 320, 3), np.uint8)
KINDS = ("depth-pro", "depth-pro without focal", "depth-anything", "depth-anything relative")


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    root = tmp_path_factory.mktemp("models")
    return {kind: tiny_models.write(kind, root / kind.replace(" ", "-")) for kind in KINDS}


def opened(folder: Path, focal: str = "calibrated", placement: Placement = CPU) -> HfDepth:
    return HfDepth(f"transformers:{folder}", placement, focal)


def library_answer(folder: Path, color: np.ndarray) -> dict:
    processor = hf.AutoImageProcessor.from_pretrained(folder)
    model = hf.AutoModelForDepthEstimation.from_pretrained(folder).eval()
    with torch.inference_mode():
        out = model(**processor(images=picture(color), return_tensors="pt"))
        return processor.post_process_depth_estimation(out, target_sizes=[color.shape[:2]])[0]


def test_depth_pro_with_its_own_focal_length_equals_the_librarys_result(models: dict[str, Path]):
    wanted = library_answer(models["depth-pro"], COLOR)
    for made in (
        opened(models["depth-pro"], "own").estimate(COLOR, 300.0),
        opened(models["depth-pro"]).estimate(COLOR, None),
    ):
        assert made.focal_px == pytest.approx(float(wanted["focal_length"]), rel=1e-4)
        np.testing.assert_allclose(made.depth_m, wanted["predicted_depth"].numpy(), rtol=1e-3)


def test_depth_is_proportional_to_the_calibrated_focal_length(models: dict[str, Path]):
    """depth = focal / (width * inverse depth)."""
    for kind in ("depth-pro", "depth-pro without focal"):
        depth = opened(models[kind])
        near, far = depth.estimate(COLOR, 250.0), depth.estimate(COLOR, 500.0)
        assert (near.focal_px, far.focal_px) == (250.0, 500.0)
        assert (near.depth_m > 0).all()
        np.testing.assert_allclose(far.depth_m, 2 * near.depth_m, rtol=1e-3)


def test_a_metric_depth_anything_model_gives_its_depth_unscaled(models: dict[str, Path]):
    wanted = library_answer(models["depth-anything"], COLOR)["predicted_depth"].numpy()
    made = opened(models["depth-anything"]).estimate(COLOR, 300.0)
    assert made.focal_px == 300.0
    np.testing.assert_allclose(made.depth_m, wanted, rtol=1e-4)


@pytest.mark.parametrize("precision", ["bfloat16", "float16"])
@pytest.mark.parametrize("kind", ["depth-pro", "depth-anything"])
def test_half_precision_changes_depth_by_at_most_10_percent(
    kind: str, precision: str, models: dict[str, Path]
):
    exact = opened(models[kind]).estimate(COLOR, 300.0).depth_m
    depth = opened(models[kind], placement=Placement("cpu", precision))
    depth.warm_up()
    np.testing.assert_allclose(depth.estimate(COLOR, 300.0).depth_m, exact, rtol=0.1)


def test_a_model_without_metric_depth_is_refused(models: dict[str, Path], tmp_path: Path):
    with pytest.raises(InvalidInput, match="gives no metres; set depth to a Depth Pro"):
        opened(models["depth-anything relative"])
    with pytest.raises(InvalidInput, match="gives no metres"):
        opened(tiny_models.write("clip", tmp_path))


def test_an_unknown_focal_length_is_refused(models: dict[str, Path]):
    for kind in ("depth-anything", "depth-pro without focal"):
        with pytest.raises(InvalidInput, match=r"came without a calibration.*send K"):
            opened(models[kind]).estimate(COLOR, None)
        with pytest.raises(InvalidInput, match="guesses no focal length; set it to calibrated"):
            opened(models[kind], "own")


def test_depth_beyond_the_range_of_a_message_becomes_no_depth(models: dict[str, Path]):
    far = opened(models["depth-pro"]).estimate(COLOR, 1e6)
    assert (far.depth_m == 0).all()


def test_an_impossible_estimated_field_of_view_is_refused(models: dict[str, Path]):
    depth = opened(models["depth-pro"], "own")
    with depth._model.use() as (model, _):
        model.fov_model.head.layers[-1].bias.fill_(200.0)  # degrees
    with pytest.raises(InvalidInput, match=r"guesses a field of view of \d+ degrees"):
        depth.estimate(COLOR, 300.0)


def test_depth_none_opens_no_model_and_unknown_depth_settings_are_refused(models: dict[str, Path]):
    assert open_depth("none", DetectorOptions(), "calibrated") is None
    with pytest.raises(InvalidInput, match="set none or transformers:ID"):
        open_depth("stereo", DetectorOptions(), "calibrated")
    with pytest.raises(InvalidInput, match="depth_focal is 'guess'"):
        opened(models["depth-pro"], "guess")


@pytest.fixture
def bus(models: dict[str, Path]) -> MemoryBus:
    hub = MemoryHub()
    depth = open_depth(
        f"transformers:{models['depth-pro']}", DetectorOptions(device="cpu"), "calibrated"
    )
    DetectorService(
        MemoryBus(hub), GroundTruthDetector(SceneTruth()), LexicalScorer(), Health(), depth=depth
    )
    return MemoryBus(hub)


def test_the_bridge_adds_estimated_depth_to_a_frame(bus: MemoryBus, models: dict[str, Path]):
    blind = frame_of()
    filled = with_estimated_depth(blind, bus, 20.0)
    assert filled.camera == CAMERA
    wanted = opened(models["depth-pro"]).estimate(blind.color, CAMERA.fx).depth_m
    np.testing.assert_allclose(filled.depth_m, wanted, atol=6e-4)  # millimetres on the wire
    frame_from_proto(frame_to_proto(filled))  # is still a valid frame


def test_the_reply_without_a_calibration_holds_the_estimated_focal_length(bus: MemoryBus):
    good, png = cv2.imencode(".png", COLOR[..., ::-1])
    assert good
    request = pb.DepthRequest()
    request.compressed_color.format, request.compressed_color.data = "png", png.tobytes()
    reply = bus.call(ESTIMATE_DEPTH, request, 20.0)
    assert reply.estimate_ms > 0
    assert reply.focal_px == pytest.approx(160 / np.tan(np.deg2rad(30)), rel=0.4)  # about 60 deg
    assert (reply.raw_depth.width, reply.raw_depth.height) == (320, 200)


def test_bad_requests_are_refused(bus: MemoryBus):
    with pytest.raises(InvalidInput, match="no colour image"):
        bus.call(ESTIMATE_DEPTH, pb.DepthRequest(), 5.0)
    for K in ([float("nan")] * 9, [1.0] * 9, [1e6] * 9, [300.0] * 8):
        request = pb.DepthRequest(
            raw_color=frame_to_proto(frame_of()).raw_color, calibration=CameraCalibration(K=K)
        )
        with pytest.raises(InvalidInput, match="send 9 numbers"):
            bus.call(ESTIMATE_DEPTH, request, 5.0)


def test_depth_estimates_are_counted_and_timed(models: dict[str, Path]):
    hub, health = MemoryHub(), Health()
    depth = opened(models["depth-pro"])
    DetectorService(
        MemoryBus(hub), GroundTruthDetector(SceneTruth()), LexicalScorer(), health, depth=depth
    )
    with_estimated_depth(frame_of(), MemoryBus(hub), 20.0)
    assert health.metrics()["depths_estimated"] == 1
    assert health.metrics()["depth_ms_median"] > 0


def test_a_detector_without_a_depth_model_names_the_setting():
    hub = MemoryHub()
    with pytest.raises(Unavailable):
        with_estimated_depth(frame_of(), MemoryBus(hub), 0.1)
    DetectorService(MemoryBus(hub), GroundTruthDetector(SceneTruth()), LexicalScorer(), Health())
    with pytest.raises(HeliosError, match="makes no depth; set its depth to transformers:ID"):
        with_estimated_depth(frame_of(), MemoryBus(hub), 5.0)
