"""Image-text scoring with transformers, on tiny models with random weights."""

from pathlib import Path

import numpy as np
import pytest
import tiny_models
import torch
from detector_scene import SceneTruth, context_of, frame_of
from helios_core import proto as pb
from helios_core.codec import (
    context_to_proto,
    embedding_from_proto,
    embedding_to_proto,
    frame_to_proto,
    observation_from_proto,
)
from helios_core.embedding_similarity import image_text_score
from helios_core.errors import HeliosError, InvalidInput
from helios_core.health import Health
from helios_core.memory_bus import MemoryBus, MemoryHub
from helios_core.topics import CONTEXT, EMBED_TEXT, KEYFRAME, OBSERVATION
from helios_core.types import Embedding, SearchContext
from helios_detector.backend import DetectorOptions, ScorerBackend
from helios_detector.hf.model_runtime import need_library, picture
from helios_detector.hf.scorer import Blip2, HfScorer
from helios_detector.lexical_scorer import LexicalScorer
from helios_detector.model_loading import open_scorer
from helios_detector.service import DetectorService
from helios_detector.simulation.ground_truth_detector import GroundTruthDetector

PROMPTS = {"pick": "Seems like there is a mug ahead", "place": "a bed", "other": "no 5"}
FAMILIES = ("clip", "siglip", "siglip2", "blip-2")
hf = need_library()


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    root = tmp_path_factory.mktemp("models")
    return {name: tiny_models.write(name, root / name) for name in FAMILIES}


def opened(folder: Path, head: str = "itc", precision: str = "float32") -> ScorerBackend:
    options = DetectorOptions(device="cpu", precision=precision, score_head=head)
    return open_scorer(f"transformers:{folder}", options)


def noise_image(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (240, 320, 3), np.uint8)


def frame(seed: int = 0):
    from dataclasses import replace

    return replace(frame_of(), color=noise_image(seed))


def test_clip_scores_equal_the_cosines_of_the_models_own_forward_pass(models: dict[str, Path]):
    scores = opened(models["clip"]).score(frame(), (), PROMPTS)
    model = hf.CLIPModel.from_pretrained(models["clip"]).eval()
    processor = hf.AutoProcessor.from_pretrained(models["clip"])
    inputs = processor(
        text=list(PROMPTS.values()),
        images=picture(noise_image()),
        padding=True,
        truncation=True,
        return_tensors="pt",
    )
    with torch.inference_mode():
        out = model(**inputs)
        cosines = (out.logits_per_image[0] / model.logit_scale.exp()).clamp(0, 1)
    np.testing.assert_allclose(list(scores.values()), cosines.numpy(), atol=1e-5)
    assert scores.keys() == PROMPTS.keys()


@pytest.mark.parametrize("family", ["siglip", "siglip2"])
def test_siglip_scores_map_the_models_own_cosines_to_0_to_1(family: str, models: dict[str, Path]):
    scorer = opened(models[family])
    sizes = {"patch_size": 8, "max_num_patches": 16} if family == "siglip2" else {}
    model = hf.AutoModel.from_pretrained(models[family]).eval()
    processor = hf.AutoProcessor.from_pretrained(models[family])
    inputs = processor(
        text=list(PROMPTS.values()),
        images=picture(noise_image()),
        padding="max_length",
        max_length=16,
        truncation=True,
        return_tensors="pt",
        **sizes,
    )
    with torch.inference_mode():
        logits = model(**inputs).logits_per_image[0]
        cosines = (logits - model.logit_bias) / model.logit_scale.exp()
    scores = scorer.score(frame(), (), PROMPTS)
    np.testing.assert_allclose(list(scores.values()), (1 + cosines.numpy()) / 2, atol=1e-4)


@pytest.mark.parametrize("head", ["itc", "itm"])
def test_blip_2_scores_equal_those_of_the_models_own_heads(head: str, models: dict[str, Path]):
    scores = opened(models["blip-2"], head).score(frame(), (), PROMPTS)
    model = hf.Blip2ForImageTextRetrieval.from_pretrained(models["blip-2"]).eval()
    processor = hf.AutoProcessor.from_pretrained(models["blip-2"])
    for layer, prompt in PROMPTS.items():
        inputs = processor(images=picture(noise_image()), text=prompt, return_tensors="pt")
        with torch.inference_mode():
            out = model(**inputs, use_image_text_matching_head=head == "itm")
        logits = out.logits_per_image[0]
        wanted = logits.softmax(-1)[1] if head == "itm" else logits.clamp(0, 1)[0]
        assert scores[layer] == pytest.approx(float(wanted), abs=1e-4)


@pytest.mark.parametrize("precision", ["bfloat16", "float16"])
@pytest.mark.parametrize(("family", "head"), [(f, "itc") for f in FAMILIES] + [("blip-2", "itm")])
def test_half_precision_changes_scores_by_at_most_0_05(
    family: str, head: str, precision: str, models: dict[str, Path]
):
    exact = opened(models[family], head).score(frame(), (), PROMPTS)
    scorer = opened(models[family], head, precision)
    scorer.warm_up()
    half = scorer.score(frame(), (), PROMPTS)
    assert half == pytest.approx(exact, abs=0.05)


@pytest.mark.parametrize("family", FAMILIES)
def test_a_prompt_scored_later_by_its_embedding_scores_the_same(
    family: str, models: dict[str, Path]
):
    scorer = opened(models[family])
    judged = scorer.judge(frame(), (), PROMPTS)
    assert judged.image is not None
    np.testing.assert_allclose(np.linalg.norm(judged.image.vectors, axis=1), 1, atol=1e-4)
    later = scorer.embed_text(list(PROMPTS.values()))
    image = embedding_from_proto(embedding_to_proto(judged.image))  # float16 on the wire
    for score, text in zip(judged.scores.values(), later.texts, strict=True):
        assert image_text_score(image, text, later.scale, later.offset) == pytest.approx(
            score, abs=2e-3
        )


def test_the_matching_head_sends_no_embedding_and_embeds_no_text(models: dict[str, Path]):
    scorer = opened(models["blip-2"], "itm")
    judged = scorer.judge(frame(), (), PROMPTS)
    assert judged.scores.keys() == PROMPTS.keys()
    assert judged.image is None  # its score is no cosine: one layer must not mix the two
    with pytest.raises(
        InvalidInput, match=r"\(itm\) looks at the image and the text together.*itc"
    ):
        scorer.embed_text(["a mug"])


def test_texts_are_embedded_once(models: dict[str, Path], monkeypatch: pytest.MonkeyPatch):
    scorer = opened(models["clip"])
    assert isinstance(scorer, HfScorer)
    asked: list[list[str]] = []
    tokens = scorer._tower.tokens
    monkeypatch.setattr(
        scorer._tower, "tokens", lambda m, p, texts: (asked.append(texts), tokens(m, p, texts))[1]
    )
    first = scorer.score(frame(), (), PROMPTS)
    assert scorer.score(frame(), (), PROMPTS) == first
    scorer.score(frame(), (), PROMPTS | {"new": "a sofa"})
    assert asked == [list(PROMPTS.values()), ["a sofa"]]


def test_the_text_cache_has_a_limit(models: dict[str, Path], monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("helios_detector.hf.scorer.TEXTS_REMEMBERED", 2)
    scorer = opened(models["clip"])
    assert isinstance(scorer, HfScorer)
    assert scorer.score(frame(), (), PROMPTS) == opened(models["clip"]).score(frame(), (), PROMPTS)
    assert len(scorer._texts) == 2


def test_the_image_is_encoded_once_for_all_prompts(
    models: dict[str, Path], monkeypatch: pytest.MonkeyPatch
):
    for head in ("itc", "itm"):
        scorer = opened(models["blip-2"], head)
        assert isinstance(scorer, HfScorer)
        tower, asked = scorer._tower, []
        assert isinstance(tower, Blip2)
        pixels = tower.pixels
        monkeypatch.setattr(
            tower, "pixels", lambda m, i, asked=asked, f=pixels: asked.append(1) or f(m, i)
        )
        assert len(scorer.score(frame(), (), PROMPTS)) == 3
        assert asked == [1]


def test_scoring_without_prompts_does_not_load_the_model(models: dict[str, Path]):
    scorer = opened(models["clip"])
    assert isinstance(scorer, HfScorer)
    assert scorer.judge(frame(), (), {}).scores == {}
    assert not scorer._model.loaded


def test_a_long_prompt_is_truncated_and_not_refused(models: dict[str, Path]):
    for family in FAMILIES[:3]:
        scores = opened(models[family]).score(frame(), (), {"pick": "a very long mug " * 50})
        assert 0 <= scores["pick"] <= 1


def test_an_observation_carries_an_embedding_that_scores_later_prompts_over_the_bus(
    models: dict[str, Path],
):
    hub, truth, out = MemoryHub(), SceneTruth(), []
    bus = MemoryBus(hub)
    bus.subscribe(OBSERVATION, out.append)
    scorer = opened(models["blip-2"])
    DetectorService(MemoryBus(hub), GroundTruthDetector(truth), scorer, Health())
    context = SearchContext("c1", context_of("mug").classes, PROMPTS)
    bus.publish(CONTEXT, context_to_proto(context))
    bus.publish(KEYFRAME, frame_to_proto(truth.frame()))
    observation = observation_from_proto(out[0])
    assert observation.image_embedding is not None
    assert observation.image_embedding.vectors.shape == (4, 16)  # one row per query token
    reply = bus.call(EMBED_TEXT, pb.EmbedTextRequest(prompts=["a bed"]), 5.0)
    text = embedding_from_proto(reply.embeddings[0])
    later = image_text_score(observation.image_embedding, text, reply.scale, reply.offset)
    assert later == pytest.approx(observation.layer_scores["place"], abs=2e-3)
    with pytest.raises(HeliosError, match="0 prompts came; send 1 to 64"):
        bus.call(EMBED_TEXT, pb.EmbedTextRequest(), 5.0)
    with pytest.raises(HeliosError, match="65 prompts came; send 1 to 64"):
        bus.call(EMBED_TEXT, pb.EmbedTextRequest(prompts=["a bed"] * 65), 5.0)


def test_the_lexical_scorer_refuses_to_embed_text():
    with pytest.raises(InvalidInput, match="lexical looks at no image and has no embeddings"):
        LexicalScorer().embed_text(["a mug"])


def test_embeddings_of_two_models_are_not_compared():
    a, b = Embedding("a", np.ones((1, 4), np.float32)), Embedding("b", np.ones((1, 4), np.float32))
    with pytest.raises(InvalidInput, match="embed the text with the same model"):
        image_text_score(a, b)


@pytest.mark.parametrize(("rows", "size"), [(0, 8), (1, 0), (3, 8), (1, 3)])
def test_an_embedding_with_inconsistent_sizes_is_refused(rows: int, size: int):
    with pytest.raises(InvalidInput, match="send float16 values row by row"):
        embedding_from_proto(pb.Embedding(model="m", rows=rows, values=b"\0" * size))


def test_an_unsupported_score_head_is_refused(models: dict[str, Path]):
    with pytest.raises(InvalidInput, match="score_head itm is of BLIP-2 alone"):
        opened(models["clip"], "itm")
    with pytest.raises(InvalidInput, match="score_head is 'best'; set one of itc, itm"):
        opened(models["clip"], "best")


def test_a_detection_model_is_refused_as_a_scorer(tmp_path: Path):
    folder = tiny_models.write("owlv2", tmp_path)
    with pytest.raises(InvalidInput, match="compares no image with a text; set scorer to"):
        opened(folder)
