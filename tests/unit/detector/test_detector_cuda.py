"""Models on a GPU against the same models on the CPU. Skipped without one."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tiny_models
import torch
from detector_scene import context_of, frame_of
from helios_detector.backend import DetectorOptions
from helios_detector.hf.model_runtime import Placement
from helios_detector.hf.sam2_masks import BoxesToMasks
from helios_detector.hf.sam3_detection import TextToMasks
from helios_detector.hf.zero_shot_detection import TextToBoxes
from helios_detector.model_loading import open_detector, open_scorer

pytestmark = pytest.mark.skipif(not torch.cuda.is_available(), reason="torch finds no CUDA device")

CPU, GPU = Placement("cpu", "float32"), Placement("cuda", "float32")
PHRASES = ["mug", "coffee table", "bowl"]
NO_LIMIT = np.zeros(len(PHRASES), np.float32)
TEXT_TO_BOXES = ("owlvit", "owlv2", "grounding-dino", "mm-grounding-dino", "omdet-turbo")
SCORERS = ("clip", "siglip", "siglip2", "blip-2")
PROMPTS = {"pick": "Seems like there is a mug ahead", "place": "a bed"}
# Products of matrices may be rounded as TF32 on a GPU.
SCORE_TOLERANCE, BOX_TOLERANCE_PX = 5e-3, 1.0


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    root = tmp_path_factory.mktemp("models")
    names = (*TEXT_TO_BOXES, *SCORERS, "sam2", "sam3")
    return {name: tiny_models.write(name, root / name) for name in names}


@pytest.mark.parametrize("family", TEXT_TO_BOXES)
def test_boxes_and_scores_on_a_gpu_equal_those_on_the_cpu(family: str, models: dict[str, Path]):
    color = frame_of().color
    one, other = (
        TextToBoxes(str(models[family]), family, placement).find(color, PHRASES, NO_LIMIT)
        for placement in (GPU, CPU)
    )
    np.testing.assert_allclose(one.scores, other.scores, atol=SCORE_TOLERANCE)
    np.testing.assert_allclose(one.boxes, other.boxes, atol=BOX_TOLERANCE_PX)


def test_masks_of_boxes_on_a_gpu_equal_those_on_the_cpu(models: dict[str, Path]):
    color, boxes = frame_of().color, np.array([[10, 20, 90, 100], [50, 5, 300, 200]], np.float32)
    one, other = (
        BoxesToMasks(f"transformers:{models['sam2']}", placement).masks(color, boxes)
        for placement in (GPU, CPU)
    )
    assert (one != other).mean() < 0.01


def test_masks_of_phrases_on_a_gpu_equal_those_on_the_cpu(models: dict[str, Path]):
    one, other = (
        TextToMasks(str(models["sam3"]), placement).find(frame_of().color, PHRASES, NO_LIMIT)
        for placement in (GPU, CPU)
    )
    assert one.masks is not None
    assert other.masks is not None
    np.testing.assert_allclose(one.scores, other.scores, atol=SCORE_TOLERANCE)
    assert (one.masks != other.masks).mean() < 0.01


# In half precision all mask values of the tiny SAM 3 are rounded to its threshold.
@pytest.mark.parametrize(
    ("family", "precision"),
    [(f, p) for f in TEXT_TO_BOXES for p in ("auto", "float32")] + [("sam3", "float32")],
)
def test_a_frame_becomes_detections_on_a_gpu(family: str, precision: str, models: dict[str, Path]):
    options = DetectorOptions(device="cuda", precision=precision)
    detector = open_detector(f"transformers:{models[family]}", options)
    detector.warm_up()
    findings = detector.detect(frame_of(), context_of("mug", "dining table", threshold=0.01))
    assert findings.detections
    assert all(0.01 <= d.score <= 1 and d.mask.any() for d in findings.detections)


@pytest.mark.parametrize(
    ("precision", "apart"), [("float32", SCORE_TOLERANCE), ("auto", 0.05), ("float16", 0.05)]
)
@pytest.mark.parametrize(("family", "head"), [(f, "itc") for f in SCORERS] + [("blip-2", "itm")])
def test_image_text_scores_on_a_gpu_equal_those_on_the_cpu(
    family: str, head: str, precision: str, apart: float, models: dict[str, Path]
):
    image = np.random.default_rng(0).integers(0, 256, (240, 320, 3), np.uint8)
    frame = replace(frame_of(), color=image)

    def scores(device: str, precision: str) -> dict[str, float]:
        options = DetectorOptions(device=device, precision=precision, score_head=head)
        return open_scorer(f"transformers:{models[family]}", options).score(frame, (), PROMPTS)

    assert scores("cuda", precision) == pytest.approx(scores("cpu", "float32"), abs=apart)
