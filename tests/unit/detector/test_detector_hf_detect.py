"""Every detection path of transformers, end to end, on tiny models with random weights.

The detections of a random model mean nothing. The tests compare boxes, scores and masks with those
of the library's own classes, and check that they reach the detections.
"""

from pathlib import Path

import numpy as np
import pytest
import tiny_models
import torch
from detector_scene import context_of, frame_of
from helios_core.errors import InvalidInput, Unavailable
from helios_core.types import Role, SearchClass, SearchContext
from helios_detector.backend import DetectorOptions
from helios_detector.hf.detector import HfDetector
from helios_detector.hf.model_runtime import HfModel, Placement, picture
from helios_detector.hf.sam2_masks import BoxesToMasks
from helios_detector.hf.sam3_detection import TextToMasks
from helios_detector.hf.zero_shot_detection import TextToBoxes, joined
from helios_detector.model_loading import open_detector

CPU = Placement("cpu", "float32")
PHRASES = ["mug", "coffee table", "bowl"]
TEXT_TO_BOXES = ("owlvit", "owlv2", "grounding-dino", "mm-grounding-dino", "omdet-turbo")


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    root = tmp_path_factory.mktemp("models")
    names = (*TEXT_TO_BOXES, "sam2", "sam3")
    return {name: tiny_models.write(name, root / name) for name in names}


@pytest.fixture(autouse=True)
def no_suppression(monkeypatch: pytest.MonkeyPatch) -> None:
    """OmDet-Turbo's suppression needs compiled code of torchvision; here it keeps all boxes."""
    monkeypatch.setattr(
        "transformers.models.omdet_turbo.processing_omdet_turbo.batched_nms",
        lambda boxes, scores, labels, iou: scores.argsort(descending=True),
    )


def library_answer(family: str, folder: Path, color: np.ndarray) -> dict:
    """The result of the library's own post-processing for the same image and phrases."""
    import transformers

    processor = transformers.AutoProcessor.from_pretrained(folder)
    model = transformers.AutoModelForZeroShotObjectDetection.from_pretrained(folder).eval()
    text = joined(PHRASES) if "dino" in family else [PHRASES]
    inputs = processor(images=picture(color), text=text, return_tensors="pt")
    with torch.inference_mode():
        out = model(**inputs)
        return processor.post_process_grounded_object_detection(
            out, threshold=0.0, target_sizes=[color.shape[:2]]
        )[0]


@pytest.mark.parametrize("family", TEXT_TO_BOXES)
def test_boxes_and_best_scores_equal_the_librarys(family: str, models: dict[str, Path]):
    color = frame_of().color[:, :200]  # not square
    found = TextToBoxes(str(models[family]), family, CPU).find(
        color, PHRASES, np.zeros(3, np.float32)
    )
    wanted = library_answer(family, models[family], color)
    boxes, scores = wanted["boxes"].numpy(), wanted["scores"].numpy()
    if family == "omdet-turbo":  # which sorts, keeps one entry per class and clips to the image
        i, phrase = np.unravel_index(found.scores.argmax(), found.scores.shape)
        assert scores[0] == pytest.approx(found.scores.max(), abs=1e-5)
        assert wanted["labels"][0] == phrase
        clipped = np.clip(found.boxes[i], 0, [200, 240, 200, 240])
        np.testing.assert_allclose(boxes[0], clipped, atol=1e-2)
        return
    np.testing.assert_allclose(found.boxes, boxes, atol=1e-3)
    if family != "mm-grounding-dino":  # which takes the mean of a phrase's tokens, see below
        ours = found.scores.max(1)
        assert (ours <= scores + 1e-5).all()
        same = np.isclose(ours, scores, atol=1e-5)
        assert same.any() if "dino" in family else same.all()


def test_grounding_dino_scores_by_the_best_token_and_mm_grounding_dino_by_the_mean(
    models: dict[str, Path],
):
    import transformers

    color = frame_of().color
    for family, merge in (("grounding-dino", np.max), ("mm-grounding-dino", np.mean)):
        found = TextToBoxes(str(models[family]), family, CPU).find(
            color, PHRASES, np.zeros(3, np.float32)
        )
        processor = transformers.AutoProcessor.from_pretrained(models[family])
        model = transformers.AutoModelForZeroShotObjectDetection.from_pretrained(models[family])
        inputs = processor(images=picture(color), text=joined(PHRASES), return_tensors="pt")
        with torch.inference_mode():
            tokens = model.eval()(**inputs).logits[0].sigmoid().numpy()
        # The vocabulary is letters: [CLS] m u g . c o f f e e t a b l e . b o w l . [SEP]
        spans = ([1, 2, 3], range(5, 16), range(17, 21))
        wanted = np.stack([merge(tokens[:, list(s)], axis=1) for s in spans], 1)
        np.testing.assert_allclose(found.scores, wanted, atol=1e-5)


@pytest.mark.parametrize("family", TEXT_TO_BOXES)
@pytest.mark.parametrize("precision", ["float32", "bfloat16", "float16"])
def test_a_frame_becomes_detections_with_masks_in_every_precision(
    family: str, precision: str, models: dict[str, Path]
):
    options = DetectorOptions(device="cpu", precision=precision)
    detector = open_detector(f"transformers:{models[family]}", options)
    detector.warm_up()
    frame = frame_of()
    findings = detector.detect(frame, context_of("mug", "dining table", threshold=0.02))
    assert findings.detections
    for d in findings.detections:
        assert d.class_name in ("mug", "dining table")
        assert 0.02 <= d.score <= 1
        x0, y0, x1, y1 = d.box_xyxy
        inside = np.zeros(d.mask.shape, bool)
        inside[y0:y1, x0:x1] = True
        assert d.mask.shape == frame.depth_m.shape
        assert d.mask.any()
        assert not (d.mask & ~inside).any()
        assert (frame.depth_m[d.mask] > 0).all()
    assert {s.class_name for s in findings.seen} <= {"mug", "dining table"}


def test_each_class_has_its_own_threshold(models: dict[str, Path]):
    detector = HfDetector(f"transformers:{models['owlv2']}", CPU)
    low = detector.detect(frame_of(), context_of("mug", "bowl", threshold=0.01))
    classes = (SearchClass("mug", Role.OBJECT, 1.0), SearchClass("bowl", Role.OBJECT, 0.01))
    high = detector.detect(frame_of(), SearchContext("c", classes))
    assert {d.class_name for d in low.detections} == {"mug", "bowl"} or low.detections
    assert {d.class_name for d in high.detections} == {"bowl"}


def test_a_detection_by_synonym_carries_the_name_of_its_class(models: dict[str, Path]):
    detector = HfDetector(f"transformers:{models['owlv2']}", CPU)
    classes = (SearchClass("zzz", Role.OBJECT, 0.01, ("mug", "bowl")),)
    found = detector.detect(frame_of(), SearchContext("c", classes)).detections
    assert found
    assert {d.class_name for d in found} == {"zzz"}


def test_landmarks_are_seen_but_never_detected(models: dict[str, Path]):
    spec, names = f"transformers:{models['owlv2']}", ("bed", "sink", "couch")
    detector = HfDetector(spec, CPU, landmarks=names)
    findings = detector.detect(frame_of(), context_of("mug", threshold=0.99))
    assert findings.detections == ()
    assert findings.seen
    assert {s.class_name for s in findings.seen} <= set(names)


@pytest.mark.parametrize("family", ["owlv2", "sam3"])
def test_landmarks_change_no_detection(family: str, models: dict[str, Path]):
    context = context_of("mug", "bowl", threshold=0.01)
    spec, names = f"transformers:{models[family]}", ("bed", "sink", "couch", "oven")
    alone = HfDetector(spec, CPU).detect(frame_of(), context).detections
    among = HfDetector(spec, CPU, landmarks=names).detect(frame_of(), context).detections
    assert alone
    assert [(d.class_name, d.box_xyxy) for d in among] == [
        (d.class_name, d.box_xyxy) for d in alone
    ]


def test_phrases_beyond_the_text_encoders_limit_take_several_passes(models: dict[str, Path]):
    many = [f"thing{i:02d}" for i in range(20)]  # 7 tokens each, 64 in one pass
    finder = TextToBoxes(str(models["grounding-dino"]), "grounding-dino", CPU)
    found = finder.find(frame_of().color, many, np.zeros(20, np.float32))
    assert found.scores.shape == (20 * 3, 20)  # 20 boxes in each of three passes
    assert (found.scores > 0).any(0).all()
    assert ((found.scores > 0).sum(1) <= 8).all()


def test_masks_of_boxes_equal_those_of_sam_2(models: dict[str, Path]):
    import transformers

    color, boxes = frame_of().color, np.array([[10, 20, 90, 100], [50, 5, 300, 200]], np.float32)
    ours = BoxesToMasks(f"transformers:{models['sam2']}", CPU).masks(color, boxes)
    processor = transformers.Sam2Processor.from_pretrained(models["sam2"])
    model = transformers.Sam2Model.from_pretrained(models["sam2"]).eval()
    for box, mask in zip(boxes, ours, strict=True):
        inputs = processor(images=picture(color), input_boxes=[[box.tolist()]], return_tensors="pt")
        with torch.inference_mode():
            out = model(**inputs, multimask_output=False)
        wanted = processor.post_process_masks(out.pred_masks, inputs["original_sizes"])[0][0, 0]
        assert mask.shape == color.shape[:2]
        assert (mask != wanted.numpy()).mean() < 1e-3


def test_boxes_beyond_the_limit_of_one_pass_all_get_masks(models: dict[str, Path]):
    boxes = np.tile(np.array([[10, 20, 90, 100]], np.float32), (40, 1))
    masks = BoxesToMasks(f"transformers:{models['sam2']}", CPU).masks(frame_of().color, boxes)
    assert masks.shape == (40, 240, 320)
    assert (masks == masks[0]).all()


@pytest.mark.parametrize("precision", ["float32", "bfloat16"])
def test_boxes_of_one_model_get_masks_from_another_model(precision: str, models: dict[str, Path]):
    detector = HfDetector(
        f"transformers:{models['owlv2']}",
        Placement("cpu", precision),
        f"transformers:{models['sam2']}",
    )
    detector.warm_up()
    found = detector.detect(frame_of(), context_of("mug", threshold=0.01)).detections
    assert found
    for d in found:
        rows, columns = np.flatnonzero(d.mask.any(1)), np.flatnonzero(d.mask.any(0))
        assert d.box_xyxy == (columns[0], rows[0], columns[-1] + 1, rows[-1] + 1)


def test_sam_3_gives_the_same_result_for_phrases_together_and_one_by_one(models: dict[str, Path]):
    finder, color = TextToMasks(str(models["sam3"]), CPU), frame_of().color
    phrases = [f"thing {i}" for i in range(11)]
    together = finder.find(color, phrases, np.zeros(11, np.float32))
    assert together.masks is not None
    assert together.masks.shape == (12 * 11, 240, 320)  # 12 queries a phrase
    for i in (0, 7, 10):
        alone = finder.find(color, [phrases[i]], np.zeros(1, np.float32))
        own = together.scores[:, i] > 0
        np.testing.assert_allclose(together.scores[own, i], alone.scores[:, 0], atol=1e-4)
        np.testing.assert_allclose(together.boxes[own], alone.boxes, atol=0.1)
        assert alone.masks is not None
        assert (together.masks[own] != alone.masks).mean() < 1e-3


def test_sam_3_is_recognised_by_its_folder_and_makes_its_own_masks(models: dict[str, Path]):
    detector = open_detector(
        f"transformers:{models['sam3']}", DetectorOptions(device="cpu", masks="depth")
    )
    detector.warm_up()
    found = detector.detect(frame_of(), context_of("mug", "bowl", threshold=0.01)).detections
    assert found
    assert {d.class_name for d in found} <= {"mug", "bowl"}


def test_an_unloaded_model_loads_again_with_the_next_frame(models: dict[str, Path]):
    detector = HfDetector(f"transformers:{models['owlv2']}", CPU)
    context = context_of("mug", threshold=0.01)
    before = detector.detect(frame_of(), context)
    detector.unload()
    assert not detector._finder.model.loaded
    after = detector.detect(frame_of(), context)
    assert [d.box_xyxy for d in after.detections] == [d.box_xyxy for d in before.detections]


def test_a_context_without_classes_does_not_load_the_model(models: dict[str, Path]):
    detector = HfDetector(f"transformers:{models['owlv2']}", CPU)
    assert detector.detect(frame_of(), SearchContext("c", ())).detections == ()
    assert not detector._finder.model.loaded


def test_a_model_of_the_wrong_kind_is_refused_with_the_setting_to_change(models: dict[str, Path]):
    with pytest.raises(InvalidInput, match=r"is a 'sam2' model.*set detector to a model of one of"):
        HfDetector(f"transformers:{models['sam2']}", CPU)
    with pytest.raises(InvalidInput, match=r"is a 'owlv2' model, which makes no mask.*set masks"):
        HfDetector(f"transformers:{models['owlv2']}", CPU, f"transformers:{models['owlv2']}")


def test_a_missing_device_and_an_unknown_precision_are_refused(models: dict[str, Path]):
    if torch.cuda.is_available():
        pytest.skip("this machine has CUDA")
    model = HfModel(
        str(models["owlv2"]), "detector", Placement("cuda"), "AutoModelForZeroShotObjectDetection"
    )
    with (
        pytest.raises(Unavailable, match=r"device is 'cuda' and torch .* finds none here"),
        model.use(),
    ):
        pass
    with pytest.raises(InvalidInput, match="precision is 'int4'; set one of auto"):
        HfModel(str(models["owlv2"]), "detector", Placement("cpu", "int4"), "AutoModel")
